"""The walk of layers, dense and in bricks: integrals equal to naive ones, derivatives to sums and differences."""

import itertools
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
from factorloc.mapping._spatial_forward_kernels import integrate_spatial, walk_layers
from factorloc.mapping.cell_table import CellTable

SHAPE = (37, 20, 18)
OUTSIDE = 0.75
RATES = np.random.default_rng(0).uniform(0, 3, SHAPE).astype(np.float32)
RATES[16:32, :16, :16] = OUTSIDE  # a brick that is not there
RIMMED = Grid((-1, -1, -1), 1.0, tuple(n + 2 for n in SHAPE))
RIMMED_RATES = np.pad(RATES.astype(np.float64), 1, constant_values=OUTSIDE)
TABLE = CellTable.from_dense(Grid((0, 0, 0), 1.0, SHAPE), RATES, OUTSIDE)
DENSE = (None, RIMMED_RATES.ravel(), (RIMMED.shape[1] * RIMMED.shape[2], RIMMED.shape[2], 1))
BRICKS = (TABLE.layout.directory, TABLE.pool.ravel(), TABLE.layout.strides)

layouts = pytest.mark.parametrize(("layout", "rim"), [(DENSE, 1), (BRICKS, 16)], ids=["dense", "bricks"])


def walk(layout: tuple, rim: int, p, v, t_in: float, t_out: float) -> tuple[float, ...]:
    """Integral, jumps and moments of a walk."""
    total, _, *sums = walk_layers(*layout, *map(float, (*np.add(p, rim), *v, t_in, t_out)))
    return total, *sums


def naive_integral(p, v, t_in: float, t_out: float) -> float:
    p, v = np.asarray(p, float), np.asarray(v, float)
    lengths = naive.lengths_by_cell(Ray(p + v * t_in, v, t_out - t_in, 0), RIMMED)
    return sum(RIMMED_RATES[cell] * length for cell, length in lengths.items() if cell is not None)


def is_clear(p, v, t_in: float, t_out: float) -> bool:
    """Whether no rounding decides which cells are met, nor in which order."""
    ray = Ray(p + v * t_in, v, t_out - t_in, 0)
    ends = np.array([p + v * t_in, p + v * t_out])
    return not naive.is_ambiguous(ray, RIMMED) and np.abs(ends - np.round(ends)).min() > 1e-8


def span(p, v, low: float = -0.5, beyond: float = 0.5) -> tuple[float, float]:
    """Ray parameters between which a ray is in the grid, or the inner half of its rim."""
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (low - np.asarray(p)) / v, (np.array(SHAPE) + beyond - np.asarray(p)) / v
    still = np.equal(v, 0)
    return float(np.where(still, -np.inf, np.minimum(a, b)).max()), float(
        np.where(still, np.inf, np.maximum(a, b)).min()
    )


@st.composite
def walks(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Rays of every octant and dominant axis, many nearly parallel to a plane or an axis, cut anywhere."""
    rng = np.random.default_rng(draw(SEEDS))
    p = rng.uniform(0, SHAPE)
    v = rng.standard_normal(3) * rng.choice([1.0, 1.0, 1e-2, 1e-5], 3)
    v *= rng.uniform(0.5, 20) / np.linalg.norm(v)
    enter, leave = span(p, v)
    # Border to border, from or to a border, within, or too short to leave a cell.
    cut = draw(st.sampled_from(["whole", "first", "last", "within", "short"]))
    a, b = np.sort(rng.uniform(0, 1, 2))
    if cut == "short":
        a, b = a, min(a + 10.0 ** rng.uniform(-9, -2), 1.0)
    a, b = 0.0 if cut in ("whole", "first") else a, 1.0 if cut in ("whole", "last") else b
    return p, v, enter + a * (leave - enter), enter + b * (leave - enter)


@layouts
@given(ray=walks())
def test_integral_is_the_naive_one(layout, rim, ray) -> None:
    assume(is_clear(*ray))
    p, v, t_in, t_out = ray
    total = walk(layout, rim, *ray)[0]
    assert total == pytest.approx(naive_integral(*ray), abs=1e-8)
    alone = integrate_spatial(*layout, *map(float, (*np.add(p, rim), *v, t_in, t_out)))
    assert alone == pytest.approx(total, abs=1e-11)


@layouts
@given(ray=walks())
def test_the_rate_at_the_end_is_handed_out(layout, rim, ray) -> None:
    assume(is_clear(*ray))
    p, v, t_in, t_out = ray
    end = walk_layers(*layout, *map(float, (*np.add(p, rim), *v, t_in, t_out)))[1]
    assert end == RIMMED_RATES[tuple(np.floor(p + v * t_out).astype(int) + 1)]


@layouts
@given(ray=walks(), part=floats(0, 1))
def test_integrals_of_parts_add_up(layout, rim, ray, part) -> None:
    p, v, t_in, t_out = ray
    middle = t_in + part * (t_out - t_in)
    whole = walk(layout, rim, *ray)
    first, second = walk(layout, rim, p, v, t_in, middle), walk(layout, rim, p, v, middle, t_out)
    assert whole[0] == pytest.approx(first[0] + second[0], abs=1e-8)
    backwards = walk(layout, rim, p + v * (t_in + t_out), -v, t_in, t_out)
    assert backwards[0] == pytest.approx(whole[0], abs=1e-8)


@given(walks())
def test_both_layouts_say_the_same(ray) -> None:
    assume(is_clear(*ray))
    dense, bricks = walk(DENSE, 1, *ray), walk(BRICKS, 16, *ray)
    assert bricks == pytest.approx(dense, rel=1e-9, abs=1e-8)


@layouts
@given(ray=walks())
def test_jumps_and_moments_are_sums_over_crossings(layout, rim, ray) -> None:
    assume(is_clear(*ray))
    p, v, t_in, t_out = ray
    jumps, moments = np.zeros(3), np.zeros(3)
    for before, after in pairwise(naive.pieces(Ray(p + v * t_in, v, t_out - t_in, 0), RIMMED)):
        (axis,) = np.flatnonzero(np.subtract(before.cell, after.cell))
        change = RIMMED_RATES[after.cell] - RIMMED_RATES[before.cell]
        jumps[axis] += change
        moments[axis] += change * (after.start + t_in)
    _, *found = walk(layout, rim, *ray)
    assert found[:3] == pytest.approx(jumps, abs=1e-8)
    assert found[3:] == pytest.approx(moments, abs=1e-7 * (1 + max(abs(t_in), abs(t_out))))


def derivatives(p, v, t_out: float, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Forward and backward differences of the integral by origin and direction."""
    here = naive_integral(p, v, 0, t_out)
    ahead, behind = (
        np.array([naive_integral(p + s * e[:3], v + s * e[3:], 0, t_out) for e in np.eye(6)]) for s in (step, -step)
    )
    return (ahead - here) / step, (here - behind) / step


@layouts
def test_jumps_and_moments_are_derivatives(layout, rim) -> None:
    rng = np.random.default_rng(4)
    smooth = 0
    for _ in range(40):
        p, v = rng.uniform(0.5, np.subtract(SHAPE, 0.5)), rng.standard_normal(3)
        v *= rng.uniform(0.5, 20) / np.linalg.norm(v)
        t_out = rng.uniform(0.3, 0.99) * span(p, v)[1]
        _, *found = walk(layout, rim, p, v, 0, t_out)
        gradient = np.array(found) / [*v, *v]
        forward, backward = derivatives(p, v, t_out, 1e-6)
        # At an edge, or where an end crosses a plane, there is no derivative.
        same = np.abs(forward - backward) < 1e-3 * np.maximum(1, np.abs(forward))
        smooth += same.sum()
        assert gradient[same] == pytest.approx(((forward + backward) / 2)[same], rel=1e-3, abs=1e-4)
    assert smooth > 225, "of 240"


AXES = [tuple(float(s * (k == axis)) for k in range(3)) for axis in range(3) for s in (1, -1, 4, -0.5)]


@layouts
@pytest.mark.parametrize("v", AXES)
@pytest.mark.parametrize(
    "p",
    [(3.0, 5.0, 7.0), (3.5, 5.0, 7.0), (3.0, 5.25, 7.0), (3.0, 5.0, 7.75), (0.0, 0.0, 0.0), (6.75, 6.5, 16.5)],
)
def test_along_an_axis_on_planes_and_edges(layout, rim, p, v) -> None:
    t_in, t_out = span(p, v)
    for start, stop in [(t_in, t_out), (0.0, t_out), (t_in, 0.25), (0.0, 0.0)]:
        if start > stop:
            continue
        total, *sums = walk(layout, rim, p, v, start, stop)
        # A point on a plane belongs to the cell above it, and so does a ray along it.
        assert total == pytest.approx(naive_integral(p, v, start, stop), abs=1e-11)
        axis = int(np.flatnonzero(v)[0])
        across = np.delete(np.reshape(sums, (2, 3)), axis, 1)
        assert across == pytest.approx(np.zeros((2, 2)), abs=1e-12)
        first, last = (np.floor(np.add(p, np.multiply(v, t))).astype(int) + 1 for t in (start, stop))
        change = RIMMED_RATES[tuple(last)] - RIMMED_RATES[tuple(first)]
        assert sums[axis] == pytest.approx(change, abs=1e-12)


TILTS = [1e-17, 1e-13, 1e-10, 0.9e-9, 1.1e-9, 1e-7]
LEANS = [(a * s, b * r) for a in TILTS for b in (0, a) for s in (1, -1) for r in (1, -1)]


@layouts
@pytest.mark.parametrize("axis", range(3))
def test_almost_along_an_axis(layout, rim, axis) -> None:
    for tilt, other in LEANS:
        v = np.roll([3.0, tilt, other], axis)
        for p in ([6.5, 5.5, 4.5], [6.5, 5.3, 9.8], [3.25, 8.75, 0.5]):
            result = walk(layout, rim, p, v, *span(p, v))
            assert result[0] == pytest.approx(naive_integral(p, v, *span(p, v)), abs=1e-6)
            assert np.isfinite(result).all()
        # On an edge of cells, but for rounding, a ray is in any of the four around it, layer by layer.
        p = np.roll([1.0, 5.0, 8.0], axis)
        around = np.moveaxis(RIMMED_RATES, axis, 0).transpose((0, 1, 2) if axis != 1 else (0, 2, 1))
        layers = around[2 : 2 + 12, 5:7, 8:10].reshape(12, 4)
        found = walk(layout, rim, p, v, 0, 4.0)
        assert layers.min(1).sum() / 3 - 1e-6 <= found[0] <= layers.max(1).sum() / 3 + 1e-6
        assert np.isfinite(found).all()


DIAGONALS = [d for d in itertools.product((-1, 0, 1), repeat=3) if np.abs(d).sum() >= 2]


@layouts
@pytest.mark.parametrize("diagonal", DIAGONALS)
def test_through_edges_and_corners_no_cell_is_skipped(layout, rim, diagonal) -> None:
    rng = np.random.default_rng(np.add(diagonal, 1) @ [9, 3, 1])
    v = np.array(diagonal) / np.linalg.norm(diagonal) / 0.1
    beside = [np.array(s) * 1e-8 * np.array([1.0, 2.0, 3.0]) for s in itertools.product((-1, 1), repeat=3)]
    # Corners of a grid of 0.1 m, off by what their decimal fractions are rounded.
    for p in np.round(rng.uniform(0.2, np.subtract(SHAPE, 0.2) * 0.1, (20, 3)) / 0.1) * 0.1 * (1 / 0.1):
        t_out = span(p, v, 0.01, -0.01)[1]
        if t_out < 1e-6:
            continue
        result = walk(layout, rim, p, v, 0, t_out)
        assert np.isfinite(result).all()
        # Never far from a ray that passes close by.
        assert min(abs(result[0] - naive_integral(p + side, v, 0, t_out)) for side in beside) < 1e-5


def test_long_rays_along_a_diagonal_do_not_drift() -> None:
    n = 128
    grid = Grid((0, 0, 0), 1.0, (n, n, n))
    rates = np.random.default_rng(1).uniform(0, 3, grid.shape)
    rng = np.random.default_rng(2)
    for k in range(24):
        # Second and third axis as steep as the first, but for a few units in the last place.
        v = np.array([1.0, 1.0, 1.0]) * (1 + rng.integers(-3, 4, 3) * 2.0**-52) / 0.3
        p = np.array([0.5, 0.5, 0.5]) + (rng.uniform(-0.4, 0.4, 3) if k % 2 else rng.integers(0, 3, 3) * 0.125)
        signs = np.array(list(itertools.product((1, -1), repeat=3)))[k % 8]
        p, v = np.where(signs > 0, p, n - p), v * signs
        t_out = float(np.min((np.where(signs > 0, n, 0) - p) / v)) * (1 - 1e-9)
        result = walk_layers(None, rates.ravel(), (n * n, n, 1), *map(float, (*p, *v, 0.0, t_out)))
        lengths = naive.lengths_by_cell(Ray(p, v, t_out, 0), grid)
        assert result[0] == pytest.approx(sum(rates[cell] * length for cell, length in lengths.items()), abs=1e-7)
