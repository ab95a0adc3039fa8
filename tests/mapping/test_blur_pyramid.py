"""Blur pyramids: counts are spread, not lost, and no ray is likelier than the bound of its level."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from ray_cases import counted, statistics

from factorloc.errors import MapError
from factorloc.mapping import DEFAULT_BLURS, BlurPyramid, Grid, RayStatistics

GRID = Grid((0, 0), 0.1, (124, 110))


def wall() -> RayStatistics:
    """A short wall in the middle of a hall that was crossed evenly."""
    hits = np.zeros(GRID.shape)
    hits[60:64, 55] = [3, 9, 1, 5]
    return counted(GRID, hits, 2.0)


def inner(flat: np.ndarray) -> np.ndarray:
    return flat.reshape(GRID.shape[0] + 2, GRID.shape[1] + 2)[1:-1, 1:-1]


def test_without_blur_only_the_mean_is_mixed_in() -> None:
    counts = wall()
    mean = 18 / counts.path_lengths.sum()
    (level,) = BlurPyramid.from_statistics(counts, (0.0,), pseudo_path=0.3).levels
    assert inner(level.rates) == pytest.approx((counts.hits + 0.3 * mean) / (counts.path_lengths + 0.3))
    assert level.outside == pytest.approx(mean)
    (by_default,) = BlurPyramid.from_statistics(counts, (0.0,)).levels
    assert inner(by_default.rates) == pytest.approx((counts.hits + 0.1 * mean) / (counts.path_lengths + 0.1))


@pytest.mark.parametrize("blur", [0.1, 0.25, 0.8])
def test_blur_spreads_hits_and_loses_none(blur: float) -> None:
    counts = wall()
    (level,) = BlurPyramid.from_statistics(counts, (blur,), pseudo_path=0.3).levels
    # Where the path is even it stays as it is, so that the rates tell the blurred hits.
    hits = inner(level.rates) * (2.0 + 0.3) - 0.3 * level.outside
    far = 25  # cells, beyond the reach of the border and of the wall
    middle = hits[far:-far, far:-far]
    assert middle.sum() == pytest.approx(18, rel=1e-6)
    assert middle.max() < counts.hits.max()
    x = np.arange(GRID.shape[0])[far:-far]
    centre = (middle.sum(1) @ x) / 18
    assert centre == pytest.approx((60 * 3 + 61 * 9 + 62 + 63 * 5) / 18)
    before = (np.array([3, 9, 1, 5]) @ (np.arange(60, 64) - centre) ** 2) / 18
    spread = (middle.sum(1) @ (x - centre) ** 2) / 18 - before
    # The Gaussian ends at three standard deviations, which takes away 2.7 % of its variance.
    assert np.sqrt(spread) * GRID.resolution == pytest.approx(blur, rel=0.03)


@given(statistics().filter(lambda counts: counts.hits.any()))
def test_levels_are_positive_bounded_and_rimmed(counts: RayStatistics) -> None:
    pyramid = BlurPyramid.from_statistics(counts)
    assert pyramid.grid == counts.grid
    assert pyramid.blurs == DEFAULT_BLURS
    for level in pyramid.levels:
        assert level.rates.shape == level.log_rates.shape == (np.prod(np.add(counts.grid.shape, 2)),)
        assert (level.rates > 0).all()
        assert np.array_equal(level.log_rates, np.log(level.rates))
        # No end is likelier than the highest rate, and no integral below zero.
        assert level.least_nll <= -level.log_rates.max() - 0.5 + 1e-12
        assert level.least_nll == pytest.approx(-np.log(max(level.rates.max(), level.outside)) - 0.5)
        square = level.rates.reshape(np.add(counts.grid.shape, 2))
        for edge in (square[0], square[-1], square[:, 0], square[:, -1]):
            assert (edge == level.outside).all()


@pytest.mark.parametrize(
    "blurs", [(), (0.5, 0.5), (0.1, 0.5), (0.5, -0.1), (np.nan,), (0.5, np.nan, 0.0), (np.inf, 0.0), (-1.0,)]
)
def test_blurs_decrease(blurs: tuple[float, ...]) -> None:
    with pytest.raises(MapError, match="expected decreasing lengths"):
        BlurPyramid.from_statistics(wall(), blurs)


@pytest.mark.parametrize("pseudo_path", [0.0, -1.0, np.nan, np.inf])
def test_the_pseudo_path_is_positive(pseudo_path: float) -> None:
    with pytest.raises(MapError, match=r"pseudo_path: .* expected a positive length"):
        BlurPyramid.from_statistics(wall(), pseudo_path=pseudo_path)


def test_an_empty_map_is_refused() -> None:
    with pytest.raises(MapError, match="holds no hit"):
        BlurPyramid.from_statistics(RayStatistics.empty(GRID))
    no_path = dataclasses.replace(wall(), path_fixed=np.zeros(GRID.shape, np.int64))
    with pytest.raises(MapError, match="or no path"):
        BlurPyramid.from_statistics(no_path)
