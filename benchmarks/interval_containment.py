"""Do intervals enclose what they should: operations and contractors on tens of millions of samples, and how tightly.

Intervals have all magnitudes, with infinite, subnormal and single-number ones; numbers in them are often their bounds.
Values are computed with longdoubles. The excess is the median width of the result for single numbers, in units in the
last place. A violation is a number whose value is not enclosed, or a solution that a contractor lost: the goal is none.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.harness import Benchmark, arguments, one_line_errors
from benchmarks.interval_samples import (
    CONSTRAINTS,
    EXTENDED,
    OPERATIONS,
    Containment,
    Operation,
    check_constraint,
    check_operation,
)
from factorloc.errors import SimulationError
from factorloc.viewer.style import FONT_SIZE, INK, OKABE_ITO, WIDTH, dress, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SAMPLES = {False: 10_000_000, True: 1_000_000}
"""Fewest samples of each operation in a full and in a quick run."""

_AT_ONCE = 250_000
_NUMBERS = 4  # in each interval


@one_line_errors
def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; the exit code is 1 if a number was lost."""
    given = arguments("interval_containment", __doc__ or "", argv, seed=0, samples=0)
    if not EXTENDED:
        raise SimulationError("longdouble is no wider than double on this machine; run where it is, as on x86-64")
    wanted = given.options["samples"] or SAMPLES[given.quick]
    settings = {"samples": wanted, "seed": given.options["seed"], "quick": given.quick}
    bench = Benchmark("interval_containment", settings)
    rng = np.random.default_rng(given.options["seed"])
    excess = {}
    for name, operation in OPERATIONS.items():
        found = repeat(partial(check_numbers, operation, rng), wanted)
        excess[name] = found.excess
        report(bench, name, found)
        bench.figure(f"{name}: excess", found.excess, "ulp")
    for name, constraint in CONSTRAINTS.items():
        report(bench, f"contractor {name}", repeat(partial(check_constraint, constraint, rng), wanted))
    return bench.finish(given, plot_excess(excess))


def check_numbers(operation: Operation, rng: np.random.Generator, count: int) -> Containment:
    """Check an operation on so many numbers, a few in each interval."""
    return check_operation(operation, rng, max(1, count // _NUMBERS), _NUMBERS)


def repeat(check: Callable[[int], Containment], wanted: int) -> Containment:
    """Check part after part until there are as many samples as wanted."""
    samples = violations = 0
    excess = []
    while samples < wanted:
        part = check(min(wanted, _AT_ONCE))
        samples, violations = samples + part.samples, violations + part.violations
        excess.append(part.excess)
    return Containment(samples, violations, float(np.median(excess)))


def report(bench: Benchmark, name: str, found: Containment) -> None:
    """Add figures and the goal of no violation."""
    bench.figure(f"{name}: samples", found.samples / 1e6, "million")
    bench.goal(f"{name}: violations", found.violations, "1", most=0)


def plot_excess(excess: dict[str, float]) -> Figure:
    """Bars of the width of results for single numbers."""
    names = [name for name, width in excess.items() if math.isfinite(width)]
    figure = new_figure(WIDTH, 0.6 + 0.22 * len(names))
    axes = figure.subplots()
    axes.barh(names, [excess[name] for name in names], color=OKABE_ITO[0], height=0.6)
    axes.invert_yaxis()
    dress(axes)
    axes.grid(False, axis="y")
    axes.set_xlabel("median width of the result for single numbers (ulp)", fontsize=FONT_SIZE, color=INK)
    return figure


if __name__ == "__main__":
    sys.exit(main())
