"""Speed of the walks through grids: accumulation, forward model, and forward model with gradient.

Real returns of a CARMEN log (or of a simulated office, where there is no data) are walked through a planar grid, those
of a KITTI drive and of a simulated street through a dense spatial grid and through bricks: by the package, by a plain
loop compiled alike, and by plain C++. The C++ reference does less than the package: it adds up float lengths in the
order of the rays and counts no misses, where the package counts them and keeps lengths in fixed point.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from benchmarks.bars import Bar, plot_columns
from benchmarks.harness import Arguments, Benchmark, arguments, one_line_errors
from benchmarks.reference import CompiledReference, build_reference
from benchmarks.returns import Returns, load_returns
from benchmarks.spatial_returns import DRIVE_0005, RANGE, STREET, SpatialReturns, load_spatial_drive, spatial_returns
from benchmarks.spatial_walks import BYTES_AT_REST, NEW_ARRAYS, all_spatial_walks
from benchmarks.timing import interleave, ratio, spread
from benchmarks.walks import ACCUMULATION, FORWARD, GRADIENT, Walk, all_walks
from factorloc import set_threads
from factorloc.errors import MapError

LOGS = ("intel", DRIVE_0005, STREET)
"""What is walked by default."""

ROUNDS, SPATIAL_ROUNDS = {False: 41, True: 11}, {False: 21, True: 7}
"""Rounds of a full and of a quick run, in the plane and in space."""

RESOLUTION, SPATIAL_RESOLUTIONS = 0.1, (0.2, 0.5)
"""Edge lengths of cells in the plane and in space, m."""

SPATIAL_SCANS = 4
"""Spatial scans whose returns are timed; the map is made of all."""

RAY_CELLS, LEAST_RAYS = 75, 3.0
"""Goal in space: rays of so many cells accumulated by one thread, million/s."""

MOST_BRICKS = 1 / 8
"""Goal on the street: memory of a map in bricks, as a multiple of that of the dense map."""

_SAME = 1e-5  # of a value or the mean magnitude; float lengths keep seven digits, fixed ones end at a micrometre
_TIES = 1e-3  # of all values: which cell a ray along a line or through a corner is in, rounding decides


@dataclass(frozen=True)
class Scene:
    """Returns in a map, and who walks them.

    Parameters
    ----------
    name : str
        Log and resolution.
    settings : mapping
        What the figures depend on.
    rays : int
        Number of returns.
    walks : sequence of Walk
        The competitors.
    memory : mapping of str to (float, str)
        What maps take, with units.
    rounds : int
        How often each is timed.
    most_memory : mapping of str to float
        Goals among them.
    least_rays : float, optional
        Goal of accumulation by one thread, in million rays of :data:`RAY_CELLS` cells a second.
    """

    name: str
    settings: Mapping[str, Any]
    rays: int
    walks: Sequence[Walk]
    memory: Mapping[str, tuple[float, str]]
    rounds: int
    most_memory: Mapping[str, float] = field(default_factory=dict)
    least_rays: float | None = None


@one_line_errors
def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; the exit code is 1 if a goal is missed."""
    given = arguments("raycast", __doc__ or "", argv, log=LOGS, scans=0, resolution=0.0, rounds=0)
    reference = build_reference()
    scenes: dict[str, Any] = {}
    settings = {
        "reference": reference.compiler if reference else "no compiler found: its goals are not judged",
        "threads": given.threads,
        "quick": given.quick,
        "scenes": scenes,
    }
    bench = Benchmark("raycast", settings)
    columns = {}
    for make in scene_makers(given, reference):
        # One scene after the other: the arrays of the largest take gigabytes.
        name, facts, bars = measure(bench, make(), given.options["rounds"], given.threads)
        scenes[name], columns[name] = facts, bars
    if given.data is None and DRIVE_0005 in given.options["log"]:
        scenes[DRIVE_0005] = "left out: no real data"
    return bench.finish(given, plot_columns(columns, "ns/cell"))


def scene_makers(given: Arguments, reference: CompiledReference | None) -> list[Callable[[], Scene]]:
    """What is to be measured, each made when it is called for."""
    threads, scans, resolution = min(2, given.threads), given.options["scans"], given.options["resolution"]
    makers: list[Callable[[], Scene]] = []
    for log in given.options["log"]:
        if log not in (DRIVE_0005, STREET):
            makers.append(partial(planar_scene, given, log, scans, resolution or RESOLUTION, reference, threads))
        elif log == STREET or given.data is not None:
            edges = (resolution,) if resolution else SPATIAL_RESOLUTIONS
            makers += [partial(spatial_scene, given, log, scans, edge, reference, threads) for edge in edges]
    if not makers:
        raise MapError(f"drive {DRIVE_0005}: no real data; set FACTORLOC_DATA, give --data, or --log {STREET}")
    return makers


def planar_scene(
    given: Arguments, log: str, scans: int, resolution: float, reference: CompiledReference | None, threads: int
) -> Scene:
    """The returns of a CARMEN log, or of a simulated office."""
    returns = load_returns(given.data, log, scans, resolution)
    name, rays, memory = f"{log}, {resolution:g} m", len(returns.lengths), planar_memory(returns)
    settings = {"rays": returns.source, "returns": rays, "grid": returns.shape}
    return Scene(name, settings, rays, all_walks(returns, reference, threads), memory, ROUNDS[given.quick])


def spatial_scene(
    given: Arguments, log: str, scans: int, resolution: float, reference: CompiledReference | None, threads: int
) -> Scene:
    """Some returns of a drive, in the map of all of its scans."""
    drive = load_spatial_drive(given.data, log)
    returns = spatial_returns(drive, scans or SPATIAL_SCANS, resolution)
    settings = {
        "rays": returns.source,
        "maximum range (m)": RANGE,
        "scans in the map": len(drive.scans),
        "scans walked": min(scans or SPATIAL_SCANS, len(drive.scans)),
        "returns": len(returns.lengths),
        "grid": returns.grid.shape,
        "visited cells": len(returns.statistics.cells),
        "bricks": len(returns.statistics.cells.bricks),
    }
    rounds, memory = SPATIAL_ROUNDS[given.quick], spatial_memory(returns)
    goals = {"memory: bricks / dense": MOST_BRICKS} if log == STREET else {}
    walks = all_spatial_walks(returns, reference, threads)
    return Scene(f"{log}, {resolution:g} m", settings, len(returns.lengths), walks, memory, rounds, goals, LEAST_RAYS)


def measure(
    bench: Benchmark, scene: Scene, rounds: int, threads: int
) -> tuple[str, dict[str, Any], dict[str, list[Bar]]]:
    """Check and time the walks of a scene and add figures and goals; returns its name, settings and bars.

    Parameters
    ----------
    bench : Benchmark
        Added to.
    scene : Scene
        What to measure.
    rounds : int
        How often each walk is timed; as the scene says if 0.
    threads : int
        Threads to go on with afterwards.
    """
    rounds = rounds or scene.rounds
    walks = {walk.name: walk for walk in scene.walks}
    cells = check_agreement(scene.walks)
    seconds = interleave(
        {name: walk.run for name, walk in walks.items()}, rounds, lambda name: set_threads(walks[name].threads)
    )
    set_threads(threads)
    bars: dict[str, list[Bar]] = {kind: [] for kind in (ACCUMULATION, NEW_ARRAYS, FORWARD, GRADIENT)}
    medians = {name: float(np.median(seconds[name])) / cells * 1e9 for name in walks}
    for name, walk in walks.items():
        quartiles = spread(seconds[name] / cells * 1e9)
        bench.figure(f"{scene.name}: {name}", medians[name], "ns/cell", quartiles)
        for rival, most in walk.goals.items():
            if rival in walks:
                against = walks[rival].label if walks[rival].kind == walk.kind else rival
                bench.goal(f"{scene.name}: {name} / {against}", ratio(seconds, name, rival), "1", most)
        bounds = [most * medians[rival] for rival, most in walk.goals.items() if rival in walks]
        bars[walk.kind].append(Bar(walk.label, medians[name], quartiles, *bounds))
    for name, walk in walks.items():
        if walk.label.startswith("factorloc"):
            rays = scene.rays / float(np.median(seconds[name])) / 1e6
            bench.figure(f"{scene.name}: {name}, rays", rays, "million/s")
    if scene.least_rays is not None:
        name = f"{ACCUMULATION}: factorloc, 1 thread"
        rays = 1e3 / (RAY_CELLS * medians[name])
        bench.goal(f"{scene.name}: {name}, rays of {RAY_CELLS} cells", rays, "million/s", least=scene.least_rays)
    for name, (value, unit) in scene.memory.items():
        bench.figure(f"{scene.name}: {name}", value, unit)
        if name in scene.most_memory:
            bench.goal(f"{scene.name}: {name}", value, unit, scene.most_memory[name])
    return scene.name, {**scene.settings, "cells visited a ray": cells / scene.rays, "rounds": rounds}, bars


def check_agreement(walks: Sequence[Walk]) -> int:
    """Run every walk once and compare what it leaves behind; returns the number of cells the rays visit.

    Raises
    ------
    MapError
        If a walk does not agree with the first of its kind.
    """
    first: dict[str, tuple[Walk, tuple[np.ndarray[Any, Any], ...]]] = {}
    cells = 0
    for walk in walks:
        visited = walk.run()
        if walk.kind not in first:
            first[walk.kind] = walk, walk.results()
            cells = visited if isinstance(visited, int) else cells
            continue
        rival, expectations = first[walk.kind]
        for own, expected in zip(walk.results(), expectations, strict=True):
            magnitude = np.abs(expected)
            differ = ~(np.abs(own - expected) <= _SAME * (magnitude + magnitude.mean()))
            if differ.mean() > _TIES:
                raise MapError(f"{walk.name}: does not agree with {rival.label}; nothing was timed")
    return cells


def planar_memory(returns: Returns) -> dict[str, tuple[float, str]]:
    """What a cell takes: in a map at rest, in the private grid of a thread, and in a level of the forward model."""
    statistics, cells = returns.statistics, returns.statistics.grid.cells
    at_rest = statistics.hits.nbytes + statistics.misses.nbytes + statistics.path_fixed.nbytes
    # Path length and misses share a 64-bit integer; hits have 32 bits.
    private = (returns.shape[0] + 2) * returns.stride * 12
    return {
        "memory: map at rest": (at_rest / cells, "bytes/cell"),
        "memory: private grid of a thread": (private / cells, "bytes/cell"),
        "memory: rates and log rates": ((returns.rates.nbytes + returns.log_rates.nbytes) / cells, "bytes/cell"),
    }


def spatial_memory(returns: SpatialReturns) -> dict[str, tuple[float, str]]:
    """What the map takes at rest, and the rates of the forward model, dense and in bricks."""
    statistics, dense = returns.statistics, BYTES_AT_REST * returns.grid.cells
    bricks = returns.layout.directory.nbytes + returns.brick_rates.nbytes
    return {
        "memory: map at rest, dense": (dense / 2**20, "MiB"),
        "memory: map at rest, bricks": (statistics.nbytes / 2**20, "MiB"),
        "memory: bricks / dense": (statistics.nbytes / dense, "1"),
        "memory: rates, dense": (returns.dense_rates.nbytes / 2**20, "MiB"),
        "memory: rates, bricks": (bricks / 2**20, "MiB"),
    }


if __name__ == "__main__":
    sys.exit(main())
