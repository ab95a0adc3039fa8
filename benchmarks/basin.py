"""Convergence of the scan factor in space: from how far off it finds the pose, how exactly, and how fast.

Scans of a simulated street, and of a real one (KITTI raw drive 0005), are registered in a map that other scans made,
from starts ever further off: by factorloc, and by small_gicp with the points of the same scans. The street's poses are
true; those of the drive are scan-to-map GICP: what agrees with them is consistent with them, no more.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from pydantic import Field
from rich.table import Table

from benchmarks.basin_competitors import REGISTER, Competitor, PointMap, Rivals, own
from benchmarks.basin_picture import basin_picture
from benchmarks.basin_scenes import DRIVE, STREET, DriveQueries, Scene, StreetQueries, drive_scene, street_scene
from benchmarks.harness import Arguments, Benchmark, arguments, one_line_errors
from benchmarks.starts import random_starts
from benchmarks.timing import interleave, spread
from factorloc.config import Block, read_config
from factorloc.errors import ConfigError, MapError
from factorloc.evaluation import nees
from factorloc.geometry import se3
from factorloc.localization import PreparedMap, register

Array = npt.NDArray[np.float64]

SETTINGS = Path(__file__).with_name("basin.json")

PREPARE, ALIGN, POSITION, ROTATION = (
    "preparing a scan",
    "registering it",
    "median position error",
    "median rotation error",
)
CONSISTENT, BARE = "NEES per degree of freedom, as reported", "NEES per degree of freedom, Hessian alone"
COLUMNS = {PREPARE: "prepare\nms", ALIGN: "align\nms", POSITION: "error\nmm", ROTATION: "\ndeg"}


class Goals(Block):
    """Bounds of figures by name.

    Parameters
    ----------
    least, most : dict of str to float
        In their units.
    """

    least: dict[str, float] = Field(default_factory=dict)
    most: dict[str, float] = Field(default_factory=dict)


class BasinSettings(Block):
    """What ``basin.json`` holds.

    Parameters
    ----------
    seed : int
        Of world, noise and starts.
    resolution : float
        Edge length of a cell, m.
    offsets : tuple of (float, float)
        How far off starts are: horizontally, m, and in yaw, deg.
    judged : (float, float)
        The one of them after which errors, consistency and times are taken.
    tilt : float
        Vertical offset, roll and pitch as shares of these.
    success : (float, float)
        A registration has converged if it ends nearer to the truth, m and deg.
    street, drive, rivals
        Scenes and competitors.
    goals : dict of str to Goals
        Of :data:`REGISTER`, by scene.
    """

    seed: int = Field(ge=0)
    resolution: float = Field(gt=0)
    offsets: tuple[tuple[float, float], ...]
    judged: tuple[float, float]
    tilt: float = Field(ge=0)
    success: tuple[float, float]
    street: StreetQueries
    drive: DriveQueries
    rivals: Rivals
    goals: dict[str, Goals]


class BasinBenchmark(Benchmark):
    """Figures of all competitors side by side."""

    def _figure_table(self) -> Table:
        reached = list(dict.fromkeys(name.split(": ")[1] for name in self.figures if ": success from " in name))
        short = {name: name.removeprefix("success from ").replace(", ", "\n").replace(" deg", "°") for name in reached}
        table = Table(title=f"{self.name} (share converged by offset of the start in %)", title_justify="left")
        table.add_column("competitor", no_wrap=True)
        for header in [*COLUMNS.values(), *short.values(), "NEES", "NEES\nbare"]:
            table.add_column(header, justify="right")
        scenes = list(dict.fromkeys(name.split(", ", 1)[0] for name in self.figures))
        for scene in scenes:
            table.add_row(f"[bold]{scene}[/bold]")
            mine = [name.split(": ")[0] for name in self.figures if name.startswith(f"{scene}, ")]
            for who in dict.fromkeys(mine):
                cells = [self._cell(f"{who}: {name}") for name in (*COLUMNS, *reached, CONSISTENT, BARE)]
                table.add_row(who.split(", ", 1)[1], *cells)
            table.add_section()
        return table

    def _cell(self, name: str) -> str:
        if name not in self.figures:
            return ""
        value, unit = self.figures[name]
        return f"{1e3 * value:.1f}" if unit == "m" else f"{value:.3g}"


@dataclass(frozen=True)
class Outcome:
    """Where one competitor ended from one offset.

    Parameters
    ----------
    position, rotation : ndarray, shape (Q,)
        Distance from the truth, m and deg.
    converged : ndarray of bool, shape (Q,)
    """

    position: Array
    rotation: Array
    converged: npt.NDArray[np.bool_]


@one_line_errors
def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; the exit code is 1 if a goal is missed."""
    given = arguments("basin", __doc__ or "", argv, scenes=(STREET, DRIVE), settings=str(SETTINGS))
    settings = read_config(given.options["settings"], BasinSettings)
    facts: dict[str, Any] = {}
    bench = BasinBenchmark("basin", {"quick": given.quick, **settings.model_dump(), "scenes": facts})
    for name in given.options["scenes"]:
        if name == DRIVE and given.data is None and len(given.options["scenes"]) > 1:
            facts[name] = "left out: no real data"
        else:
            facts[name] = measure(bench, open_scene(name, given, settings), settings)
    return bench.finish(given, basin_picture(bench.figures, [PREPARE, ALIGN]))


def open_scene(name: str, given: Arguments, settings: BasinSettings) -> Scene:
    """Simulate or read a scene.

    Raises
    ------
    MapError
        If there is no such scene.
    DataError
        If it needs data that are not there.
    """
    if name == STREET:
        return street_scene(settings.street, settings.resolution, settings.seed, given.quick)
    if name == DRIVE:
        return drive_scene(given.data, settings.drive, settings.resolution, given.quick)
    raise MapError(f"scene {name}: unknown; take {STREET} or {DRIVE}")


def measure(bench: Benchmark, scene: Scene, settings: BasinSettings) -> dict[str, Any]:
    """Add all figures and goals of a scene; return what it is made of."""
    prepared, points = PreparedMap.of(scene.statistics), PointMap(scene.points, settings.rivals)
    guesses = {
        offset: random_starts(scene.truth, offset[0], np.radians(offset[1]), settings.tilt,
                       np.random.default_rng([settings.seed, 2, k]))
        for k, offset in enumerate(dict.fromkeys([*settings.offsets, settings.judged]))
    }  # fmt: skip
    for competitor in [*own(prepared), *points.rivals()]:
        add_outcomes(bench, f"{scene.name}, {competitor.name}", competitor, scene, guesses, settings)
    add_consistency(bench, f"{scene.name}, {REGISTER}", prepared, scene, guesses[settings.judged], settings)
    add_times(bench, scene, [*own(prepared), *points.rivals()], guesses[settings.judged])
    add_goals(bench, f"{scene.name}, {REGISTER}", settings.goals.get(scene.name, Goals()))
    return {
        "queries": len(scene),
        "poses are": scene.truth_is,
        "scans in the map": scene.statistics.scans,
        "rays in the map": len(scene.points),
        "bytes of the map": scene.statistics.nbytes,
        "points in the map of the rivals": len(points),
        "information": prepared.information,
        "times": "each competitor on one thread",
    }


def add_goals(bench: Benchmark, who: str, goals: Goals) -> None:
    """Bound figures of a competitor.

    Raises
    ------
    ConfigError
        If a goal names no figure.
    """
    bounds = [(name, (np.inf, bound)) for name, bound in goals.least.items()]
    bounds += [(name, (bound, -np.inf)) for name, bound in goals.most.items()]
    for name, (most, least) in bounds:
        figure = f"{who}: {name}"
        if figure not in bench.figures:
            raise ConfigError(f"goals: there is no figure '{name}' of {who}")
        bench.goal(figure, *bench.figures[figure], most, least)


def add_outcomes(
    bench: Benchmark,
    who: str,
    competitor: Competitor,
    scene: Scene,
    guesses: dict[tuple[float, float], Array],
    settings: BasinSettings,
) -> None:
    """Register every query from every start; rows of the same scan share its preparation."""
    ready = {id(scan): competitor.prepare(scan) for scan in scene.scans}
    for offset, rows in guesses.items():
        found = [competitor.align(ready[id(scan)], guess) for scan, guess in zip(scene.scans, rows, strict=True)]
        outcome = judge(np.array(found), scene.truth, settings.success)
        if offset in settings.offsets:
            bench.figure(f"{who}: success from {offset[0]:g} m, {offset[1]:g} deg", 100 * outcome.converged.mean(), "%")
        if offset == settings.judged:
            bench.figure(f"{who}: {POSITION}", np.median(outcome.position), "m", spread(outcome.position))
            bench.figure(f"{who}: {ROTATION}", np.median(outcome.rotation), "deg", spread(outcome.rotation))


def judge(found: Array, truth: Array, success: Sequence[float]) -> Outcome:
    """Compare poses with the true ones; what is not finite has not converged."""
    finite = np.asarray(np.isfinite(found).all((1, 2)))
    error = se3.log(se3.between(truth, np.where(finite[:, None, None], found, truth)))
    position = np.where(finite, np.linalg.norm(found[:, :3, 3] - truth[:, :3, 3], axis=1), np.inf)
    rotation = np.where(finite, np.degrees(np.linalg.norm(error[:, :3], axis=1)), np.inf)
    return Outcome(position, rotation, (position < success[0]) & (rotation < success[1]))


def add_consistency(
    bench: Benchmark, who: str, prepared: PreparedMap, scene: Scene, guesses: Array, settings: BasinSettings
) -> None:
    """Weigh the errors of converged registrations by their covariances, with and without the map's own error."""
    found = [register(scan, prepared, guess).trajectory for scan, guess in zip(scene.scans, guesses, strict=True)]
    poses, reported = np.array([one.poses[0] for one in found]), np.array([one.covariances for one in found])[:, 0]
    converged = judge(poses, scene.truth, settings.success).converged
    bench.figure(f"{who}: converged, of which NEES is taken", converged.sum(), "1")
    if not converged.any():
        return
    errors = se3.log(se3.between(poses, scene.truth))[converged]
    for name, covariances in ((CONSISTENT, reported), (BARE, reported - prepared.floor)):
        weighed = nees(errors, covariances[converged])
        bench.figure(f"{who}: {name}", weighed.mean, "1")
        bench.figure(f"{who}: {name}, rotation", weighed.per_coordinate[:3].mean(), "1")
        bench.figure(f"{who}: {name}, position", weighed.per_coordinate[3:].mean(), "1")


def add_times(bench: Benchmark, scene: Scene, competitors: Sequence[Competitor], guesses: Array) -> None:
    """Time the preparation of each scan and its registration, all competitors in turn on the same scan."""
    turns = dict.fromkeys((f"{one.name}: {part}" for one in competitors for part in (PREPARE, ALIGN)), -1)
    ready: dict[str, Any] = {}

    def next_query(name: str) -> None:
        turns[name] += 1
        who, part = name.split(": ")
        if part == ALIGN:
            row = turns[name] % len(scene)
            ready[who] = by_name[who].prepare(scene.scans[row])

    def prepare(one: Competitor) -> Any:
        return lambda: one.prepare(scene.scans[turns[f"{one.name}: {PREPARE}"] % len(scene)])

    def align(one: Competitor) -> Any:
        return lambda: one.align(ready[one.name], guesses[turns[f"{one.name}: {ALIGN}"] % len(scene)])

    by_name = {one.name: one for one in competitors}
    functions = {f"{one.name}: {PREPARE}": prepare(one) for one in competitors}
    functions |= {f"{one.name}: {ALIGN}": align(one) for one in competitors}
    for name, seconds in interleave(functions, len(scene), next_query).items():
        bench.figure(f"{scene.name}, {name}", 1e3 * np.median(seconds), "ms", spread(1e3 * seconds))


if __name__ == "__main__":
    sys.exit(main())
