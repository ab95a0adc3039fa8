"""What guaranteed bounds cost: interval loops of the package on one thread, and against the same loop unrounded.

The scene is a scan of 100 000 points with bounded range and bearing errors among 200 facades. With codac installed, its
Python calls are timed for some of the same items in a process of its own (it changes the rounding of its process).
The whole localization is timed for a scan of as many returns in a town of 500 facades, beside one plain pass over its
points.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from benchmarks._plain_interval_kernels import plain_move, scattered_increments
from benchmarks.bars import Bar, plot_bars
from benchmarks.harness import Benchmark, arguments, one_line_errors
from benchmarks.interval_pipeline import FULL, Pipeline
from benchmarks.timing import interleave, ratio, spread
from factorloc.errors import MapError
from factorloc.intervals import (
    Box,
    ConvexPolygon,
    Heading,
    Interval,
    Polar,
    Strips,
    atan2,
    lines_met,
    move,
    relaxed_intersection,
    sector,
)
from factorloc.intervals._elementary_kernels import move_arrays
from factorloc.intervals.hough import HoughAccumulator

MOVE, PLAIN = "rotation and translation: rounded outwards", "rotation and translation: unrounded"
SECTOR, STRIP, HEADING, CLIP = "sector to box", "box against facade", "heading contraction", "polygon clip"
HOUGH, INCREMENTS = "box and direction: votes", "box and direction: plain increment"
RELAXED, ANGLE, POLAR = "relaxed intersection of 20", "angle of a box", "polar contraction"
MOVE_CALL = "rotation and translation: whole call"

PANELS = {
    "boxes of points": (MOVE, PLAIN, MOVE_CALL, SECTOR, ANGLE, STRIP),
    "contractions": (HEADING, POLAR, CLIP, RELAXED),
    "Hough transform": (HOUGH, INCREMENTS),
}
"""Bars drawn together."""

MOST_ROUNDING = 2.0
"""Goal: time of the loop with outward rounding over that without."""

MOST_VOTES = 8.0
"""Goal: time of the Hough transform over that of one scattered increment for each box and direction."""

MOST_MILLISECONDS = 50.0
"""Goal: the pipeline for a scan, on one core."""

LEAST_SPEED = 100.0
"""Goal: codac's time for an item over the package's."""

CODAC = """
import json, sys, time
import codac
sector, move, heading = [], [], []
I = codac.Interval
r, b, x, y = I(9.9, 10.1), I(0.3, 0.31), I(3, 3.1), I(4, 4.1)
t, u, v = I(0.3, 0.32), I(10, 10.4), I(-3, -2.7)
def timed(run, count=2000):
    began = time.perf_counter()
    for _ in range(count):
        run()
    return (time.perf_counter() - began) / count
def turn():
    c, s = codac.cos(t), codac.sin(t)
    return c * x - s * y + u, s * x + c * y + v
def contract():
    a, b, c, d = I(0, 10), I(0, 10), I(9.9, 10.1), I(0.3, 0.31)
    polar.contract(a, b, c, d)
polar = codac.CtcPolar()
runs = {"sector": lambda: (r * codac.cos(b), r * codac.sin(b)), "move": turn, "polar": contract}
print(json.dumps({name: min(timed(run) for _ in range(7)) for name, run in runs.items()}))
"""


@dataclass(frozen=True)
class Loop:
    """Something to be timed.

    Parameters
    ----------
    run : callable
        One call.
    items : int
        What it does, counted.
    """

    run: Callable[[], object]
    items: int


@one_line_errors
def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; the exit code is 1 if a goal is missed."""
    given = arguments("interval_speed", __doc__ or "", argv, points=100_000, facades=200, town_facades=500, rounds=0)
    points, facades = given.options["points"], given.options["facades"]
    rounds = given.options["rounds"] or (9 if given.quick else 41)
    settings = {"points": points, "facades": facades, "rounds": rounds, "quick": given.quick, "threads": 1}
    bench = Benchmark("interval_speed", settings)
    loops = all_loops(np.random.default_rng(0), points, facades)
    seconds = interleave({name: loop.run for name, loop in loops.items()}, rounds)
    nanoseconds = {name: times / loops[name].items * 1e9 for name, times in seconds.items()}
    bars: dict[str, list[Bar]] = {panel: [] for panel in PANELS}
    for name, times in nanoseconds.items():
        bench.figure(name, float(np.median(times)), "ns/item", spread(times))
        panel = next(panel for panel, names in PANELS.items() if name in names)
        bars[panel].append(Bar(name, float(np.median(times)), spread(times)))
    bench.goal("rotation and translation: rounded / unrounded", ratio(seconds, MOVE, PLAIN), "1", most=MOST_ROUNDING)
    bench.goal("Hough transform / as many increments", ratio(seconds, HOUGH, INCREMENTS), "1", most=MOST_VOTES)
    whole = interleave(Pipeline.of(points, given.options["town_facades"]).runs(), rounds)
    for name, times in whole.items():
        bench.figure(name, float(np.median(times)) * 1e3, "ms", spread(times * 1e3))
    bench.goal(FULL, float(np.median(whole[FULL])) * 1e3, "ms", most=MOST_MILLISECONDS)
    of_point = {name: times / points * 1e9 for name, times in whole.items()}
    bars["a scan, by its points"] = [
        Bar(name, float(np.median(times)), spread(times)) for name, times in of_point.items()
    ]
    theirs = codac_seconds()
    settings["codac"] = "timed" if theirs else "not installed: its goals are not judged"
    pairs = {"sector": SECTOR, "move": MOVE_CALL, "polar": POLAR}
    for key, value in theirs.items():
        bench.figure(f"codac: {key}", value * 1e9, "ns/item")
        speed = value * 1e9 / float(np.median(nanoseconds[pairs[key]]))
        bench.goal(f"codac's {key} / {pairs[key]}", speed, "1", least=LEAST_SPEED)
    return bench.finish(given, plot_bars(bars, "ns/item", share=False))


def all_loops(rng: np.random.Generator, points: int, facades: int) -> dict[str, Loop]:
    """Bind the loops to a scene and check that the two that are compared agree.

    Raises
    ------
    MapError
        If the loop with outward rounding does not enclose that without closely.
    """
    r, b = rng.uniform(2, 50, points), rng.uniform(-np.pi, np.pi, points)
    ranges, bearings = Interval.around(r, 0.05), Interval.around(b, 0.002)
    x, y = sector(ranges, bearings)
    local = Box.of(x, y)
    theta, t_x, t_y = Interval(0.3, 0.32), Interval(10.0, 10.4), Interval(-3.0, -2.7)
    world = move(theta, t_x, t_y, local)
    c, s = (Interval(0.9492, 0.9554), Interval(0.2955, 0.3147))
    motion = [float(bound) for side in (c, s, t_x, t_y) for bound in (side.lo, side.hi)]
    bounds = (local.lo[0], local.hi[0], local.lo[1], local.hi[1])
    rounded, plain = (np.empty((4, points)) for _ in range(2))
    move_arrays(*bounds, *motion, *rounded)
    plain_move(*bounds, *motion, *plain)
    lower, upper = plain[::2] - rounded[::2], rounded[1::2] - plain[1::2]
    if not ((lower > 0).all() and (upper > 0).all() and max(lower.max(), upper.max()) < 1e-12):
        raise MapError("rotation and translation: bounds do not enclose the unrounded ones; nothing was timed")

    alpha = rng.uniform(-np.pi, np.pi, facades)
    lines = Interval.around(alpha, 1e-4), Interval.around(rng.uniform(-50, 50, facades), 0.15)
    ends = np.sort(rng.uniform(-60, 60, (2, 2, facades)), axis=0)
    segments = Box(Interval(ends[0], ends[1]))
    which = rng.integers(0, facades, points)
    normals = alpha[which]
    distances = np.cos(normals) * world.mid[0] + np.sin(normals) * world.mid[1]
    seen = Box.of(theta, t_x, t_y, ranges, bearings, lines[0][which], Interval.around(distances, 0.15))
    offsets = Interval.around(rng.normal(0, 0.05, facades), rng.uniform(0.5, 3, facades))
    near = Strips(np.cos(alpha), np.sin(alpha), offsets)
    wide = Box.of(x.inflate(0.3), y.inflate(0.3), ranges, bearings)
    start = ConvexPolygon.from_box(Box.around([0.0, 0.0], 2.0))
    boxes = min(5000, points)
    line = local.select(np.arange(boxes))
    cells = rng.integers(0, 360_000, boxes)
    counts = np.zeros(360_000, np.int32)
    several = [Box.of(Interval.around(r + shift, 0.5)) for shift in rng.uniform(-0.6, 0.6, 20)]
    return {
        MOVE: Loop(partial(move_arrays, *bounds, *motion, *rounded), points),
        PLAIN: Loop(partial(plain_move, *bounds, *motion, *plain), points),
        MOVE_CALL: Loop(partial(move, theta, t_x, t_y, local), points),
        SECTOR: Loop(partial(sector, ranges, bearings), points),
        ANGLE: Loop(partial(atan2, world[1], world[0]), points),
        STRIP: Loop(partial(lines_met, world, *lines, segments), points * facades),
        HEADING: Loop(partial(Heading().contract, seen), points),
        POLAR: Loop(partial(Polar().contract, wide), points),
        CLIP: Loop(partial(start.clip, near), 2 * facades),
        HOUGH: Loop(
            partial(
                HoughAccumulator.from_boxes,
                line,
                Interval(0.0, 0.5 * np.pi - 1e-9),
                Interval(-50.0, 50.0 - 1e-9),
                alpha_step=np.pi / 720,
                d_step=0.1,
            ),
            boxes * 360,
        ),
        INCREMENTS: Loop(partial(scattered_increments, cells, counts, 360), boxes * 360),
        RELAXED: Loop(partial(relaxed_intersection, several, 4), points),
    }


def codac_seconds() -> dict[str, float]:
    """Seconds an item of codac's Python calls; nothing if it is not installed."""
    done = subprocess.run([sys.executable, "-c", CODAC], capture_output=True, text=True, timeout=300, check=False)
    return {} if done.returncode else {name: float(value) for name, value in json.loads(done.stdout).items()}


if __name__ == "__main__":
    sys.exit(main())
