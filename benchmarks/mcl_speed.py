"""Speed of weighing particles: particle-beams a second of the sensor models, beside a k-d tree and plain loops.

Scans of a CARMEN log (or of a simulated office, where there is no data) and of a simulated street weigh particles in
the map of the other scans, around the true pose (tracking) and all over free space (global). Compared are the
likelihood field with a k-d tree of the occupied cells (scipy's, vectorized, one thread) and with a plain loop of
look-ups, and the ray-cast models with plain loops of walks. Before anything is timed, all must have computed the same;
the tree is asked at the centres of cells for that.

In space the package lays out small maps in full, like the plain loop, and these are small. Larger ones stay in bricks:
what that costs stands beside it, without a goal.

Beams are counted that are weighed: rays with a return for the likelihood field, all rays for the others. The figures of
beluga are from another machine. Absolute figures are bars, not goals; goals are ratios, the worst of all cases.
"""

from __future__ import annotations

import sys
import tracemalloc
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from pydantic import Field
from rich.table import Table

from benchmarks.bars import Bar, plot_columns
from benchmarks.harness import Benchmark, arguments, one_line_errors
from benchmarks.particle_weights import (
    DECAY,
    FIELD,
    OWN,
    PLAIN,
    POSTERIOR,
    REFLECTION,
    TREE,
    Weigher,
    all_weighers,
    check_agreement,
)
from benchmarks.particle_weights_scenes import GLOBAL, TRACKING, Drive, Query, load_drive, make_scene
from benchmarks.resident_memory import peak_resident
from benchmarks.spatial_returns import DRIVE_0005, STREET
from benchmarks.timing import interleave, spread
from factorloc import set_threads
from factorloc.config import Block, read_config
from factorloc.errors import ConfigError

SETTINGS = Path(__file__).with_name("mcl_speed.json")

ROUNDS = {False: 5, True: 2}
"""Rounds of a full and of a quick run."""

KINDS = (FIELD, DECAY, POSTERIOR, REFLECTION)

TABLES, ARRAYS, TIME = "tables", "arrays of a call", "time"
IN_SPACE = (f"{STREET}, ", f"{DRIVE_0005}, ")

Array = npt.NDArray[np.float64]


class SpatialCases(Block):
    """Cases in space.

    Parameters
    ----------
    resolutions : tuple of float
        Edges of cells, m.
    particles, beams : tuple of int
    """

    resolutions: tuple[float, ...]
    particles: tuple[int, ...]
    beams: tuple[int, ...]


class SpeedSettings(Block):
    """What ``mcl_speed.json`` holds.

    Parameters
    ----------
    seed : int
        Of the particles.
    resolutions : tuple of float
        Edges of cells in the plane, m.
    particles, beams : tuple of int
        In the plane, each with each; a quick run takes the last ones.
    tracking : (float, float)
        How far off particles are at most, m and deg.
    queries : int
        Scans that weigh particles, in turn.
    floor : float
        Under the rates of the decay-rate map, 1/m.
    spatial : SpatialCases
        Cases in space.
    goals : dict of str to float
        The most time as a multiple of a rival's, by ``kind / rival``.
    bars, elsewhere : dict of str to tuple of float
        Million particle-beams a second: what one core should reach, and what beluga did on another machine.
    """

    seed: int = Field(ge=0)
    resolutions: tuple[float, ...]
    particles: tuple[int, ...]
    beams: tuple[int, ...]
    tracking: tuple[float, float]
    queries: int = Field(gt=0)
    floor: float = Field(gt=0)
    spatial: SpatialCases
    goals: dict[str, float]
    bars: dict[str, tuple[float, ...]]
    elsewhere: dict[str, tuple[float, ...]]


class SpeedBenchmark(Benchmark):
    """Figures of all competitors side by side."""

    def _figure_table(self) -> Table:
        speeds = [name for name, (_, unit) in self.figures.items() if unit == "million/s" and ": " in name]
        labels = list(dict.fromkeys(name.split(": ")[2] for name in speeds))
        title = f"{self.name} (million particle-beams a second, ratios of time, MiB of tables and arrays of a call)"
        table = Table(title=title, title_justify="left")
        table.add_column("model", no_wrap=True)
        short = {label: label.removeprefix("factorloc, ").replace(" ", "\n") for label in labels}
        headers = [*short.values(), "own/\nplain", "own/\ntree"]
        headers += [f"{what}\n{who}" for what, who in (("tables", "MiB"), ("", "plain"), ("", "tree"))]
        headers += [f"{what}\n{who}" for what, who in (("call", "MiB"), ("", "plain"), ("", "tree"))]
        for header in headers:
            table.add_column(header, justify="right", no_wrap=True)
        cases = dict.fromkeys(name.split(": ")[0] for name in speeds)
        for case in cases:
            table.add_row(f"[bold]{case}[/bold]")
            for kind in dict.fromkeys(name.split(": ")[1] for name in speeds if name.startswith(f"{case}: ")):
                row = [f"{case}: {kind}: {label}" for label in labels]
                row += [f"{case}: {kind}: {TIME}, factorloc / {rival}" for rival in (PLAIN, TREE)]
                scene = ", ".join(case.split(", ")[:2])
                row += [f"{where}: {kind}: {label}: {what}" for where, what in ((scene, TABLES), (case, ARRAYS))
                        for label in (OWN, PLAIN, TREE)]  # fmt: skip
                table.add_row(kind, *(self._cell(name) for name in row))
            table.add_section()
        rest = [name for name in self.figures if ": " not in name]
        table.caption = "\n".join(f"{name}: {self.figures[name][0]:.4g} {self.figures[name][1]}" for name in rest)
        table.caption_justify = "left"
        return table

    def _cell(self, name: str) -> str:
        if name not in self.figures:
            return ""
        value = self.figures[name][0]
        return f"{value:.0f}" if value >= 100 else f"{value:.2g}"


@dataclass(frozen=True)
class Case:
    """Particles in a map, and who weighs them.

    Parameters
    ----------
    name : str
        Drive, resolution, spread, and how many particles and beams.
    weighers : sequence of Weigher
    queries : sequence of Query
        A round takes one after the other.
    """

    name: str
    weighers: Sequence[Weigher]
    queries: Sequence[Query]

    def count(self, weigher: Weigher, turns: npt.NDArray[np.int64]) -> Array:
        """Particle-beams that are weighed in some turns."""
        sizes = [query.particle_returns if weigher.kind == FIELD else query.particle_beams for query in self.queries]
        return np.array(sizes, np.float64)[turns % len(sizes)]


@one_line_errors
def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; the exit code is 1 if a goal is missed."""
    given = arguments(
        "mcl_speed", __doc__ or "", argv, log=("intel", STREET), scans=0, rounds=0, settings=str(SETTINGS)
    )
    settings = read_config(given.options["settings"], SpeedSettings)
    rounds = given.options["rounds"] or ROUNDS[given.quick]
    facts: dict[str, Any] = {}
    bench = SpeedBenchmark(
        "mcl_speed",
        {"quick": given.quick, "threads": given.threads, "rounds": rounds, **settings.model_dump(), "drives": facts},
    )
    columns: dict[str, dict[str, list[Bar]]] = {}
    for log in given.options["log"]:
        drive = load_drive(given.data, log, given.options["scans"])
        facts[drive.name] = {"source": drive.source, "scans in the map": -(-len(drive.scans) // 2)}
        columns |= measure(bench, drive, settings, given.quick, rounds, given.threads)
    summarize(bench, settings)
    # In space only one model is timed: it is in the picture if nothing else is.
    drawn = {name: bars for name, bars in columns.items() if bars[FIELD]} or columns
    return bench.finish(given, plot_columns(drawn, "million/s"))


def measure(
    bench: Benchmark, drive: Drive, settings: SpeedSettings, quick: bool, rounds: int, threads: int
) -> dict[str, dict[str, list[Bar]]]:
    """Time all cases of a drive; returns the bars of the largest of each spread in the finest map."""
    sizes = settings if drive.dimension == 2 else settings.spatial
    counts = [(particles, beams) for particles in sizes.particles for beams in sizes.beams][-1 if quick else 0 :]
    tracking = settings.tracking[0], float(np.radians(settings.tracking[1]))
    columns = {}
    for resolution in sizes.resolutions:
        scene = make_scene(drive, resolution, settings.queries)
        weighers = all_weighers(scene, settings.floor, threads)
        for weigher in weighers:
            bench.figure(f"{scene.name}: {weigher.name}: {TABLES}", weigher.table_bytes / 2**20, "MiB")
        for spread_of in (TRACKING, GLOBAL)[: 2 if drive.dimension == 2 else 1]:
            for particles, beams in counts:
                rng = np.random.default_rng([settings.seed, particles, beams])
                queries = scene.queries(spread_of, particles, beams, tracking, rng)
                name = f"{scene.name}, {spread_of}, {particles} x {beams}"
                case = Case(name, weighers, queries)
                bars = time_case(bench, case, settings, rounds, threads)
                if (particles, beams) == counts[-1]:
                    add_arrays(bench, case)
                if resolution == min(sizes.resolutions) and (particles, beams) == counts[-1]:
                    columns[f"{scene.name}, {spread_of}"] = bars
    return columns


def time_case(bench: Benchmark, case: Case, settings: SpeedSettings, rounds: int, threads: int) -> dict[str, list[Bar]]:
    """Check and time all competitors; returns bars by kind."""
    set_threads(1)
    check_agreement(case.weighers, case.queries[0])
    weighers = {weigher.name: weigher for weigher in case.weighers}
    turns = dict.fromkeys(weighers, -1)

    def next_turn(name: str) -> None:
        turns[name] += 1
        set_threads(weighers[name].threads)

    def weigh(name: str) -> Array:
        return weighers[name].weigh(case.queries[turns[name] % len(case.queries)])

    seconds = interleave({name: partial(weigh, name) for name in weighers}, rounds, next_turn)
    set_threads(1)
    bars: dict[str, list[Bar]] = {kind: [] for kind in KINDS}
    for name, weigher in weighers.items():
        # The first turn is to warm up.
        speeds = case.count(weigher, np.arange(1, rounds + 1)) / seconds[name] / 1e6
        median, quartiles = float(np.median(speeds)), spread(speeds)
        bench.figure(f"{case.name}: {name}", median, "million/s", quartiles)
        judged = weigher.label == OWN and weigher.kind in settings.bars and not case.name.startswith(IN_SPACE)
        bar = settings.bars[weigher.kind][0] if judged else None
        bars[weigher.kind].append(Bar(weigher.label, median, quartiles, bar))
    for name, weigher in weighers.items():
        own = f"{weigher.kind}: {OWN}"
        if weigher.label in (PLAIN, TREE):
            ratios = seconds[own] / seconds[name]
            figure = f"{case.name}: {weigher.kind}: {TIME}, factorloc / {weigher.label}"
            bench.figure(figure, float(np.median(ratios)), "1", spread(ratios))
    set_threads(threads)
    return bars


def add_arrays(bench: Benchmark, case: Case) -> None:
    """Add the memory of a call on one thread."""
    for weigher in case.weighers:
        if weigher.threads == 1:
            arrays = arrays_of_a_call(weigher, case.queries[0])
            bench.figure(f"{case.name}: {weigher.name}: {ARRAYS}", arrays, "MiB")


def arrays_of_a_call(weigher: Weigher, query: Query) -> float:
    """Most memory of all arrays and objects a call makes, as tracemalloc counts it, MiB."""
    tracemalloc.start()
    try:
        weigher.weigh(query)
        return tracemalloc.get_traced_memory()[1] / 2**20
    finally:
        tracemalloc.stop()


def summarize(bench: Benchmark, settings: SpeedSettings) -> None:
    """Add the worst ratios, with their goals, and the slowest cases beside the bars.

    Raises
    ------
    ConfigError
        If a goal names no competitor.
    """
    for goal, most in settings.goals.items():
        kind, _, rival = goal.partition(" / ")
        suffix = f": {kind}: {TIME}, factorloc / {rival}"
        found = {name: value for name, (value, _) in bench.figures.items() if name.endswith(suffix)}
        if kind not in KINDS or rival not in (PLAIN, TREE):
            raise ConfigError(f"goals: '{goal}'; there is no such competitor")
        for where, in_space in (("in the plane", False), ("in space", True)):
            values = [value for name, value in found.items() if name.startswith(IN_SPACE) == in_space]
            if values:
                bench.goal(f"{kind} {where}, time / {rival}, worst of {len(values)}", max(values), "1", most)
    for kind, bars in settings.bars.items():
        speeds = [value for name, (value, _) in bench.figures.items()
                  if name.endswith(f": {kind}: {OWN}") and not name.startswith(IN_SPACE)]  # fmt: skip
        if speeds:
            bench.figure(f"{kind}, {OWN}, slowest case", min(speeds), "million/s")
            bench.figure(f"{kind}, {OWN}, fastest case", max(speeds), "million/s")
        for name, bar in zip(("bar", "stretch"), bars, strict=False):
            bench.figure(f"{kind}, {name} for a core", bar, "million/s")
        for value in settings.elsewhere.get(kind, ()):
            bench.figure(f"{kind}, beluga on another machine, {value:g}", value, "million/s")
    bench.figure("peak resident memory of the run", peak_resident() / 2**20, "MiB")


if __name__ == "__main__":
    sys.exit(main())
