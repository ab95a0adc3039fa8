"""Occupancy by the tail of a Beta distribution: exact where it can be integrated, sound where counts are extreme."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ray_cases import SEEDS
from scipy.special import ndtr
from scipy.stats import beta as beta_distribution
from strategies import floats

from factorloc.errors import MapError
from factorloc.mapping import BrickStatistics, Grid, RayStatistics
from factorloc.mapping.occupancy import OccupancyMap


def of_counts(hits, misses, shape=None) -> RayStatistics:
    hits, misses = np.atleast_1d(hits), np.atleast_1d(misses)
    shape = (len(hits), 1) if shape is None else shape
    grid = Grid((0,) * len(shape), 0.5, shape)
    path = ((hits + misses) > 0).astype(np.int64) * 2**18
    return RayStatistics(
        grid, hits.astype(np.uint32).reshape(shape), misses.astype(np.uint32).reshape(shape), path.reshape(shape)
    )


def tail(a: int, b: int, threshold: Fraction) -> Fraction:
    """P(mu > threshold) for whole a and b: fewer than a of a + b - 1 draws lie below the threshold."""
    n = a + b - 1
    return sum(math.comb(n, k) * threshold**k * (1 - threshold) ** (n - k) for k in range(a))


@given(st.lists(st.tuples(st.integers(0, 60), st.integers(0, 60)), min_size=1, max_size=8), st.integers(0, 20))
def test_equal_to_exact_fractions(counts: list[tuple[int, int]], twentieths: int) -> None:
    hits, misses = np.array(counts).T
    model = OccupancyMap(of_counts(hits, misses), 1, 2, twentieths / 20)
    expected = [float(tail(h + 1, m + 2, Fraction(twentieths, 20))) for h, m in counts]
    assert model.probabilities[:, 0] == pytest.approx(expected, rel=1e-11, abs=1e-300)
    assert model.unseen == pytest.approx(float(tail(1, 2, Fraction(twentieths, 20))))


@given(floats(0.01, 5), floats(0.01, 5), floats(0.01, 0.99), SEEDS)
def test_equal_to_the_distribution(alpha: float, beta: float, threshold: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    hits, misses = rng.integers(0, 50, (2, 40))
    found = OccupancyMap(of_counts(hits, misses), alpha, beta, threshold).probabilities[:, 0]
    expected = beta_distribution(hits + alpha, misses + beta).sf(threshold)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-300)
    assert ((found >= 0) & (found <= 1)).all()


@pytest.mark.parametrize("visits", [10**6, 10**9])
def test_a_thousand_million_visits(visits: int) -> None:
    threshold, z = 0.2, np.array([-30.0, -6.0, -2.0, 0.0, 2.0, 6.0, 30.0])
    hits = np.round(visits * threshold + z * np.sqrt(visits * threshold * (1 - threshold))).astype(np.int64)
    found = OccupancyMap(of_counts(hits, visits - hits), 0.5, 0.5, threshold).probabilities[:, 0]
    # So many visits make it a normal distribution.
    mean = (hits + 0.5) / (visits + 1)
    score = (mean - threshold) / np.sqrt(mean * (1 - mean) / (visits + 2))
    assert found == pytest.approx(ndtr(score), abs=2e-3 * math.sqrt(1e6 / visits))
    assert (np.diff(found) >= 0).all() and found[-1] == 1.0 and 0 <= found[0] < 1e-100
    extremes = OccupancyMap(of_counts([visits, 0, visits], [0, visits, visits]), 0.5, 0.5, threshold)
    assert extremes.probabilities[:, 0].tolist() == [1.0, 0.0, 1.0]


def test_unseen_cells_and_masks() -> None:
    statistics = of_counts([0, 0, 5, 1, 0], [0, 9, 1, 0, 0])
    model = OccupancyMap(statistics, 2.0, 1.0, 0.3)
    assert model.probabilities[[0, 4], 0] == pytest.approx([model.unseen] * 2)
    assert model.unseen == pytest.approx(1 - 0.09)
    assert np.flatnonzero(model.occupied()).tolist() == [2, 3]
    assert np.flatnonzero(model.occupied(0.0)).tolist() == [1, 2, 3]
    assert np.flatnonzero(model.occupied(0.98)).tolist() == [2]


@settings(max_examples=15)
@given(SEEDS)
def test_sparse_maps_as_dense_ones(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape = (20, 17, 5)
    hits, misses = rng.integers(0, 4, (2, math.prod(shape))) * (rng.random(math.prod(shape)) < 0.1)
    dense = OccupancyMap(of_counts(hits, misses, shape), 0.3, 0.9)
    counts = BrickStatistics.from_dense(dense.statistics)
    sparse = OccupancyMap(counts, 0.3, 0.9)
    cells = tuple(counts.layout.cells(counts.keys).T)
    assert np.array_equal(sparse.probabilities, dense.probabilities[cells])
    assert np.array_equal(sparse.occupied(), dense.occupied()[cells])
    every = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1)
    for table in (sparse.table(), dense.table()):
        assert table.at(every) == pytest.approx(dense.probabilities, rel=1e-6)
        assert table.outside == pytest.approx(dense.unseen)


def test_what_does_not_fit_is_refused() -> None:
    statistics = of_counts([1], [1])
    assert OccupancyMap(statistics, 1, 1).grid == statistics.grid
    for arguments in ((0, 1), (1, 0), (math.inf, 1), (1, math.nan)):
        with pytest.raises(MapError, match="prior"):
            OccupancyMap(statistics, *arguments)
    for threshold in (-0.1, 1.1, math.nan):
        with pytest.raises(MapError, match="threshold"):
            OccupancyMap(statistics, 1, 1, threshold)
