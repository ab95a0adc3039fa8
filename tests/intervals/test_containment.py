"""No number is lost: operations and contractors on millions of random intervals, in extended precision."""

import os

import numpy as np
import pytest

from benchmarks.interval_samples import CONSTRAINTS, EXTENDED, OPERATIONS, check_constraint, check_operation
from factorloc.intervals import Interval, Sum
from factorloc.intervals.box import Box

SCALE = 1 if os.environ.get("NUMBA_DISABLE_JIT", "0") == "0" else 1000  # what is not compiled is only walked through

extended = pytest.mark.skipif(
    not EXTENDED, reason="longdouble is no wider than double here: values are not known better"
)


@extended
@pytest.mark.parametrize("name", OPERATIONS)
def test_operations_enclose_all_values(name: str) -> None:
    found = check_operation(OPERATIONS[name], np.random.default_rng(5), 260_000 // SCALE, each=4)
    assert found.violations == 0
    assert found.samples >= (400_000 if name == "sqrt x" else 1_000_000) // SCALE


@extended
@pytest.mark.parametrize("name", CONSTRAINTS)
def test_contractors_lose_no_solution(name: str) -> None:
    found = check_constraint(CONSTRAINTS[name], np.random.default_rng(6), 200_000 // SCALE)
    assert (found.samples, found.violations) == (200_000 // SCALE, 0)


@extended
def test_the_check_finds_rounding_to_nearest(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = OPERATIONS["x + y"].__class__(
        lambda x, y: Interval.from_bounds(x.lo + y.lo, x.hi + y.hi), np.add, OPERATIONS["x + y"].ranges
    )
    with np.errstate(all="ignore"):
        assert check_operation(plain, np.random.default_rng(5), 10_000).violations > 100

    def careless(box: Box) -> Box:
        return Box.of(box[0], box[1], Interval.from_bounds(box.lo[0] + box.lo[1], box.hi[0] + box.hi[1]) & box[2])

    constraint = CONSTRAINTS["z = x + y"]
    monkeypatch.setattr(Sum, "contract", lambda self, box: careless(box))
    assert check_constraint(constraint, np.random.default_rng(6), 20_000).violations > 100
