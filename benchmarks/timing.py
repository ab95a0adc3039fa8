"""Interleaved timing: whatever slows the machine down meets all competitors alike."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt

__all__ = ["interleave", "ratio", "spread"]

Array = npt.NDArray[np.float64]


def interleave(
    functions: Mapping[str, Callable[[], object]],
    rounds: int,
    prepare: Callable[[str], object] | None = None,
) -> dict[str, Array]:
    """Time functions in turn, round by round, after one call each to compile and warm up.

    Parameters
    ----------
    functions : mapping of str to callable
        Competitors by name.
    rounds : int
        How often each is timed. Every round begins with another competitor, so that none always follows the same one.
    prepare : callable, optional
        Called with the name of a competitor before each of its calls, outside of the time.

    Returns
    -------
    dict of str to ndarray, shape (rounds,)
        Seconds of wall time, by name in the order given.
    """
    names = list(functions)
    seconds = {name: np.empty(rounds) for name in names}
    collecting = gc.isenabled()
    gc.disable()  # a collection would be charged to whoever happens to run
    try:
        for n in range(-1, rounds):
            first = n % len(names)
            for name in names[first:] + names[:first]:
                if prepare is not None:
                    prepare(name)
                began = time.perf_counter()
                functions[name]()
                elapsed = time.perf_counter() - began
                if n >= 0:
                    seconds[name][n] = elapsed
    finally:
        if collecting:
            gc.enable()
    return seconds


def ratio(seconds: Mapping[str, Array], name: str, reference: str) -> float:
    """Median over the rounds of the time of ``name`` over that of ``reference`` in the same round."""
    return float(np.median(seconds[name] / seconds[reference]))


def spread(values: Array) -> tuple[float, float]:
    """Lower and upper quartile."""
    low, high = np.percentile(values, [25, 75])
    return float(low), float(high)
