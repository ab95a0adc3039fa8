"""The walk of columns: integrals equal to naive ones, and their derivatives equal to differences."""

from itertools import pairwise

import naive
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from naive import Ray
from ray_cases import SEEDS
from strategies import floats

from factorloc.mapping import Grid
from factorloc.mapping._forward_kernels import integrate, walk_columns

N = 12
SHAPE = (N + 2, N + 2)  # with rim
RIMMED = Grid((0, 0), 1.0, SHAPE)
RATES = np.random.default_rng(0).uniform(0, 3, SHAPE)


def walk(p, v, t_in: float, t_out: float) -> tuple[float, ...]:
    return walk_columns(RATES.ravel(), SHAPE[1], *map(float, (*p, *v, t_in, t_out)))


def naive_integral(p, v, t_in: float, t_out: float) -> float:
    p, v = np.asarray(p, float), np.asarray(v, float)
    lengths = naive.lengths_by_cell(Ray(p + v * t_in, v, t_out - t_in, 0), RIMMED)
    return sum(RATES[cell] * length for cell, length in lengths.items() if cell is not None)


def span(p, v, low: float = 1.0, high: float = N + 1.0) -> tuple[float, float]:
    """Ray parameters between which a ray is in the grid (within its rim)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (low - np.asarray(p)) / v, (high - np.asarray(p)) / v
    still = np.equal(v, 0)
    return float(np.where(still, -np.inf, np.minimum(a, b)).max()), float(
        np.where(still, np.inf, np.maximum(a, b)).min()
    )


@st.composite
def walks(draw: st.DrawFn, whole: bool = True) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Rays through the grid, cut anywhere: short, long, in one cell, from border to border."""
    rng = np.random.default_rng(draw(SEEDS))
    p, angle = rng.uniform(1, N + 1, 2), rng.uniform(-np.pi, np.pi)
    v = rng.uniform(0.5, 20) * np.array([np.cos(angle), np.sin(angle)])
    enter, leave = span(p, v)
    ends = [0.0, 1.0] if whole else []
    cut = sorted([*rng.uniform(0, 1, 2), *ends][draw(st.integers(0, len(ends))) :][:2])
    return p, v, enter + cut[0] * (leave - enter), enter + cut[1] * (leave - enter)


@given(walks())
def test_integral_is_the_naive_one(ray: tuple) -> None:
    p, v, t_in, t_out = ray
    assume(not naive.is_ambiguous(Ray(p + v * t_in, v, t_out - t_in, 0), RIMMED) or t_in == t_out)
    total = walk(*ray)[0]
    assert total == pytest.approx(naive_integral(*ray), abs=1e-9)
    assert integrate(RATES.ravel(), SHAPE[1], *map(float, (*p, *v, t_in, t_out))) == pytest.approx(total, abs=1e-12)


@given(walks(), floats(0, 1))
def test_integrals_of_parts_add_up(ray: tuple, part: float) -> None:
    p, v, t_in, t_out = ray
    middle = t_in + part * (t_out - t_in)
    whole, first, second = walk(*ray), walk(p, v, t_in, middle), walk(p, v, middle, t_out)
    assert whole[0] == pytest.approx(first[0] + second[0], abs=1e-9)
    backwards = walk(p + v * (t_in + t_out), -v, t_in, t_out)
    assert backwards[0] == pytest.approx(whole[0], abs=1e-9)


@pytest.mark.parametrize("v", [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (4.0, 0.0), (0.0, -0.5)])
@pytest.mark.parametrize("p", [(3.0, 5.0), (3.5, 5.0), (3.0, 5.25), (1.0, 1.0), (6.75, 6.5), (12.0, 12.0)])
def test_along_an_axis_and_on_the_lines(p: tuple, v: tuple) -> None:
    t_in, t_out = span(p, v)
    for start, stop in [(t_in, t_out), (0.0, t_out), (t_in, 0.25), (0.0, 0.0)]:
        if start > stop:
            continue
        total, jump_x, jump_y, moment_x, moment_y = walk(p, v, start, stop)
        # A point on a line belongs to the cell above it, and so does a ray along it.
        assert total == pytest.approx(naive_integral(p, v, start, stop), abs=1e-12)
        along, across = ((jump_x, moment_x), (jump_y, moment_y))[:: 1 if v[0] else -1]
        assert across == pytest.approx((0, 0), abs=1e-12)
        first, last = (np.floor(np.add(p, np.multiply(v, t))).astype(int) for t in (start, stop))
        assert along[0] == pytest.approx(RATES[tuple(last)] - RATES[tuple(first)], abs=1e-12)


TILTS = [1e-17, 1e-13, 1e-10, 0.9e-9, 1.1e-9, 1e-7]


@pytest.mark.parametrize("tilt", [*TILTS, *(-tilt for tilt in TILTS)])
@pytest.mark.parametrize("turn", [1, -1])
def test_almost_along_an_axis(tilt: float, turn: int) -> None:
    v = np.array([3.0, tilt])[::turn]
    for p in [(6.5, 5.5), (6.5, 5.3), (3.25, 8.75)]:
        assert walk(p, v, *span(p, v))[0] == pytest.approx(naive_integral(p, v, *span(p, v)), abs=1e-6)
    # On a line, but for rounding, a ray is on either side of it, column by column.
    rates = RATES if turn == 1 else RATES.T
    for line in (2, 5, 12):
        found = walk(np.array([1.0, line])[::turn], v, 0, N / 3)[0]
        sides = rates[1:-1, line - 1 : line + 1] / 3
        assert sides.min(1).sum() - 1e-6 <= found <= sides.max(1).sum() + 1e-6


@pytest.mark.parametrize("quarter", range(4))
def test_from_corner_to_corner_no_cell_is_skipped(quarter: int) -> None:
    angle = (2 * quarter + 1) * np.pi / 4
    v = np.array([np.cos(angle), np.sin(angle)]) * (1 / 0.1)
    # Corners of a grid of 0.1 m, off by what their decimal fractions are rounded.
    for p in (np.round(np.random.default_rng(quarter).uniform(0.1, 1.1, (300, 2)) / 0.1) * 0.1) * (1 / 0.1) + 1:
        t_out = span(p, v)[1]
        if t_out <= 1e-6:
            continue
        left = np.array([-v[1], v[0]]) * 1e-8
        beside = [naive_integral(p + side * left, v, 0, t_out) for side in (-1, 1)]
        assert min(abs(walk(p, v, 0, t_out)[0] - b) for b in beside) < 1e-5


def test_jumps_and_moments_are_derivatives() -> None:
    rng = np.random.default_rng(4)
    smooth = 0
    for _ in range(150):
        angle, pace = rng.uniform(-np.pi, np.pi), rng.uniform(0.5, 20)
        p, v = rng.uniform(1.2, N + 0.8, 2), pace * np.array([np.cos(angle), np.sin(angle)])
        t_out = rng.uniform(0.3, 0.99) * span(p, v)[1]
        _, *jumps_moments = walk(p, v, 0, t_out)
        found = np.array(jumps_moments) / [*v, *v]
        step = 1e-6
        here = naive_integral(p, v, 0, t_out)
        for k, gradient in enumerate(found):
            shift = np.eye(4)[k] * step
            ahead, behind = (naive_integral(p + s * shift[:2], v + s * shift[2:], 0, t_out) for s in (1, -1))
            forward, backward = (ahead - here) / step, (here - behind) / step
            # At a corner, or where an end crosses a line, there is no derivative.
            if abs(forward - backward) < 1e-3 * max(1, abs(forward)):
                smooth += 1
                assert gradient == pytest.approx((forward + backward) / 2, rel=1e-3, abs=1e-4)
    assert smooth > 560


@given(walks(whole=False))
def test_jumps_are_all_changes_between_the_ends(ray: tuple) -> None:
    p, v, t_in, t_out = ray
    start = Ray(p + v * t_in, v, t_out - t_in, 0)
    assume(not naive.is_ambiguous(start, RIMMED) and np.abs(start.origin - np.round(start.origin)).min() > 1e-9)
    _, jump_x, jump_y, moment_x, moment_y = walk(*ray)
    changes = {0: 0.0, 1: 0.0}
    moments = {0: 0.0, 1: 0.0}
    for before, after in pairwise(naive.pieces(start, RIMMED)):
        axis = 0 if before.cell[0] != after.cell[0] else 1
        change = RATES[after.cell] - RATES[before.cell]
        changes[axis] += change
        moments[axis] += change * (after.start + t_in)
    assert (jump_x, jump_y) == pytest.approx((changes[0], changes[1]), abs=1e-8)
    assert (moment_x, moment_y) == pytest.approx((moments[0], moments[1]), abs=1e-7)
