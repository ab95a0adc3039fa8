"""Speed of the walks through planar grids: accumulation, forward model, and forward model with gradient.

Real returns of a CARMEN log (or of a simulated office, where there is no data) are walked by the package, by a plain
loop compiled alike, and by plain C++. The C++ reference does less than the package: it adds up float lengths in the
order of the rays and counts no misses, where the package counts them and keeps lengths in fixed point.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from benchmarks.bars import Bar, plot_bars
from benchmarks.harness import Benchmark, arguments, one_line_errors
from benchmarks.reference import build_reference
from benchmarks.returns import Returns, load_returns
from benchmarks.timing import interleave, ratio, spread
from benchmarks.walks import ACCUMULATION, FORWARD, GRADIENT, Walk, all_walks
from factorloc import set_threads
from factorloc.errors import MapError

ROUNDS = {False: 41, True: 11}
"""Rounds of a full and of a quick run."""

_SAME = 1e-5  # of the largest magnitude; float lengths keep seven digits, fixed ones end at a micrometre
_TIES = 1e-3  # of all values: which cell a ray along a line or through a corner is in, rounding decides


@one_line_errors
def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; the exit code is 1 if a goal is missed."""
    given = arguments("raycast", __doc__ or "", argv, log="intel", scans=0, resolution=0.1, rounds=0)
    rounds = given.options["rounds"] or ROUNDS[given.quick]
    returns = load_returns(given.data, given.options["log"], given.options["scans"], given.options["resolution"])
    reference = build_reference()
    walks = {walk.name: walk for walk in all_walks(returns, reference, min(2, given.threads))}
    cells = check_agreement(list(walks.values()))
    settings = {
        "rays": returns.source,
        "returns": len(returns.lengths),
        "cells visited a ray": cells / len(returns.lengths),
        "grid": returns.shape,
        "resolution (m)": returns.resolution,
        "reference": reference.compiler if reference else "no compiler found: its goals are not judged",
        "threads": given.threads,
        "rounds": rounds,
        "quick": given.quick,
    }
    bench = Benchmark("raycast", settings)
    seconds = interleave(
        {name: walk.run for name, walk in walks.items()}, rounds, lambda name: set_threads(walks[name].threads)
    )
    set_threads(given.threads)
    for name, walk in walks.items():
        bench.figure(
            name, float(np.median(seconds[name])) / cells * 1e9, "ns/cell", spread(seconds[name] / cells * 1e9)
        )
        for rival, most in walk.goals.items():
            if rival in walks:
                against = walks[rival].label if walks[rival].kind == walk.kind else rival
                bench.goal(f"{name} / {against}", ratio(seconds, name, rival), "1", most)
    for name, walk in walks.items():
        if walk.label.startswith("factorloc"):
            bench.figure(f"{name}, rays", len(returns.lengths) / float(np.median(seconds[name])) / 1e6, "million/s")
    add_memory(bench, returns)
    return bench.finish(given, plot_bars(_bars(bench, list(walks.values())), "ns/cell"))


def check_agreement(walks: Sequence[Walk]) -> int:
    """Run every walk once and compare what it leaves behind; returns the number of cells the rays visit.

    Raises
    ------
    MapError
        If a walk does not agree with the first of its kind.
    """
    first: dict[str, Walk] = {}
    cells = 0
    for walk in walks:
        visited = walk.run()
        rival = first.setdefault(walk.kind, walk)
        if walk is rival and isinstance(visited, int):
            cells = visited
        for own, expected in zip(walk.results(), rival.results(), strict=True):
            differ = ~(np.abs(own - expected) <= _SAME * np.abs(expected).max())
            if differ.mean() > _TIES:
                raise MapError(f"{walk.name}: does not agree with {rival.label}; nothing was timed")
    return cells


def add_memory(bench: Benchmark, returns: Returns) -> None:
    """Add what a cell takes: in a map at rest, in the private grid of a thread, and in a level of the forward model."""
    statistics, cells = returns.statistics, returns.statistics.grid.cells
    at_rest = statistics.hits.nbytes + statistics.misses.nbytes + statistics.path_fixed.nbytes
    # Path length is one 64-bit integer, misses and hits share another.
    private = (returns.shape[0] + 2) * returns.stride * 2 * np.int64().nbytes
    bench.figure("memory: map at rest", at_rest / cells, "bytes/cell")
    bench.figure("memory: private grid of a thread", private / cells, "bytes/cell")
    bench.figure("memory: rates and log rates", (returns.rates.nbytes + returns.log_rates.nbytes) / cells, "bytes/cell")


def _bars(bench: Benchmark, walks: Sequence[Walk]) -> dict[str, list[Bar]]:
    groups: dict[str, list[Bar]] = {kind: [] for kind in (ACCUMULATION, FORWARD, GRADIENT)}
    for walk in walks:
        bounds = [most * bench.figures[rival][0] for rival, most in walk.goals.items() if rival in bench.figures]
        value = bench.figures[walk.name][0]
        groups[walk.kind].append(Bar(walk.label, value, bench.spreads[walk.name], *bounds))
    return groups


if __name__ == "__main__":
    sys.exit(main())
