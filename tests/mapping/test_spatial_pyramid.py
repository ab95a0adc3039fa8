"""Blur pyramids in space: the map itself at blur 0, and counts that are spread, not lost, in larger cells."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ray_cases import SEEDS, counted
from scipy.ndimage import gaussian_filter
from spatial_cases import spatial_grids

from factorloc.errors import MapError
from factorloc.mapping import BrickStatistics, Grid, RayStatistics
from factorloc.mapping.spatial_pyramid import SPATIAL_BLURS, SpatialLevel, SpatialPyramid, pooled

GRID = Grid((-2.0, 1.0, 0.5), 0.2, (80, 80, 80))
MIDDLE = (slice(38, 42), 41, 40)


def plank() -> RayStatistics:
    """A short plank in the middle of a hall that was crossed evenly."""
    hits = np.zeros(GRID.shape)
    hits[MIDDLE] = [3, 9, 1, 5]
    return counted(GRID, hits, 2.0)


def dense(level: SpatialLevel) -> np.ndarray:
    """Rates of all cells of a level."""
    return level.rates.at(np.moveaxis(np.indices(level.rates.layout.grid.shape), 0, -1))


@st.composite
def maps(draw: st.DrawFn) -> RayStatistics:
    grid = draw(spatial_grids(20))
    rng = np.random.default_rng(draw(SEEDS))
    path = np.where(rng.uniform(size=grid.shape) < 0.3, rng.choice([0.25, 1.0, 9.0], grid.shape), 0.0)
    hits = np.where(path > 0, rng.choice([0, 0, 1, 7], grid.shape), 0)
    path.flat[0], hits.flat[0] = 0.5, 1
    return counted(grid, hits, path)


@settings(max_examples=30)
@given(maps())
def test_without_blur_only_the_mean_is_mixed_in(counts) -> None:
    h, R = counts.grid.resolution, counts.path_lengths
    mean = counts.hits.sum() / R.sum()
    for given_as in (counts, BrickStatistics.from_dense(counts)):
        (level,) = SpatialPyramid.from_statistics(given_as, (0.0,)).levels
        assert dense(level) == pytest.approx((counts.hits + h * mean) / (R + h), rel=1e-6)
        assert level.rates.outside == pytest.approx(mean)
        assert level.rates.layout.grid == counts.grid


@given(maps(), st.integers(1, 5))
def test_pooled_counts_are_sums_over_larger_cells(counts, factor) -> None:
    grid, H, R = pooled(BrickStatistics.from_dense(counts), factor)
    assert grid.shape == tuple(-(-n // factor) for n in counts.grid.shape)
    assert (grid.origin, grid.resolution) == (counts.grid.origin, counts.grid.resolution * factor)
    assert (H.sum(), R.sum()) == (counts.hits.sum(), pytest.approx(counts.path_lengths.sum()))
    for sums, parts in ((H, counts.hits), (R, counts.path_lengths)):
        expected = np.zeros(grid.shape)
        np.add.at(expected, tuple(np.indices(counts.grid.shape) // factor), parts)
        assert sums == pytest.approx(expected)


@pytest.mark.parametrize(("blur", "factor"), [(0.1, 1), (0.25, 1), (0.39, 1), (0.4, 2), (0.5, 2), (0.8, 4), (1.0, 4)])
def test_blur_spreads_hits_and_loses_none(blur, factor) -> None:
    counts = plank()
    (level,) = SpatialPyramid.from_statistics(counts, (blur,)).levels
    grid = level.rates.layout.grid
    size = grid.resolution
    assert size == pytest.approx(factor * GRID.resolution)
    # Where the path is even it stays as it is, so that the rates tell the blurred hits.
    hits = dense(level) * (2.0 * factor**3 + size) - level.rates.outside * size
    far = 20 // factor  # cells, beyond the reach of the border
    inner = hits[far:-far, far:-far, far:-far]
    assert inner.sum() == pytest.approx(18, rel=1e-3)
    before = np.array([3, 9, 1, 5]) / 18
    for axis, cells in enumerate((np.arange(38, 42), np.array([41]), np.array([40]))):
        weights = before if axis == 0 else np.ones(1)
        # Pooled first: the centre is that of the larger cells.
        x = cells // factor
        centre = x @ weights
        at = np.arange(grid.shape[axis])[far:-far]
        profile = inner.sum(tuple(a for a in range(3) if a != axis)) / 18
        assert profile @ at == pytest.approx(centre, abs=5e-3)
        spread = profile @ (at - centre) ** 2 - (x - centre) ** 2 @ weights
        # With the width of its cells the level is as wide as asked for, but for tails cut at three deviations.
        wide = spread * size**2 + (size**2 - GRID.resolution**2) / 12
        assert np.sqrt(wide) == pytest.approx(blur, rel=0.1 if blur < GRID.resolution else 0.03)


def test_a_level_of_the_maps_own_cells_is_blurred_as_a_whole() -> None:
    rng = np.random.default_rng(1)
    grid = Grid((0.3, -1.0, 2.0), 0.2, (50, 37, 40))
    path = np.zeros(grid.shape)
    path[3:30, 10:20, :25] = rng.uniform(0, 3, (27, 10, 25))
    counts = counted(grid, np.where(path > 1, rng.integers(0, 6, grid.shape), 0), path)
    mean = counts.hits.sum() / counts.path_lengths.sum()
    (level,) = SpatialPyramid.from_statistics(counts, (0.3,)).levels
    H, R = (
        gaussian_filter(np.float64(a), 0.3 / 0.2, mode="constant", truncate=3.0)
        for a in (counts.hits, counts.path_lengths)
    )
    assert dense(level) == pytest.approx((H + mean * 0.2) / (R + 0.2), rel=1e-5)


@given(maps())
def test_levels_are_positive_and_bounded(counts) -> None:
    pyramid = SpatialPyramid.from_statistics(counts)
    assert (pyramid.grid, pyramid.blurs) == (counts.grid, SPATIAL_BLURS)
    for level in pyramid.levels:
        rates = level.rates.pool
        assert (rates > 0).all()
        assert np.array_equal(level.log_rates.pool, np.log(rates))
        assert level.log_rates.layout is level.rates.layout
        # No end is likelier than the highest rate, and no integral below zero.
        assert level.least_nll == pytest.approx(-np.log(rates.max()) - 0.5)
        assert level.rates.layout.grid.origin == counts.grid.origin
        extent = np.multiply(level.rates.layout.grid.shape, level.rates.layout.grid.resolution)
        assert (extent > np.multiply(counts.grid.shape, counts.grid.resolution) * (1 - 1e-9)).all()
    assert pyramid.nbytes >= sum(2 * level.rates.pool.nbytes for level in pyramid.levels)


@pytest.mark.parametrize("blurs", [(), (0.5, 0.5), (0.1, 0.5), (0.5, -0.1), (np.nan,), (np.inf, 0.0), (-1.0,)])
def test_blurs_decrease(blurs) -> None:
    with pytest.raises(MapError, match="expected decreasing lengths"):
        SpatialPyramid.from_statistics(plank(), blurs)


def test_maps_with_nothing_to_localize_in_are_refused() -> None:
    with pytest.raises(MapError, match="holds no hit"):
        SpatialPyramid.from_statistics(RayStatistics.empty(GRID))
    with pytest.raises(MapError, match="or no path"):
        SpatialPyramid.from_statistics(dataclasses.replace(plank(), path_fixed=np.zeros(GRID.shape, np.int64)))
    with pytest.raises(MapError, match="planar; use BlurPyramid"):
        SpatialPyramid.from_statistics(RayStatistics.empty(Grid((0, 0), 1.0, (4, 4))))
