"""Beliefs over sessions: equal to the batch posterior where nothing is forgotten, fading by the power prior."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ray_cases import SEEDS
from scipy.integrate import quad
from scipy.stats import beta as beta_distribution
from scipy.stats import gamma as gamma_distribution
from strategies import floats

from factorloc.errors import MapError
from factorloc.mapping import BrickStatistics, DecayRatePosterior, GammaPrior, Grid, RayStatistics
from factorloc.mapping.belief import BetaBelief, GammaBelief
from factorloc.mapping.fading_counts import FadingCounts

PRIOR = GammaPrior(0.3, 0.7)
PLANAR, SPATIAL = Grid((0, 0), 0.5, (7, 5)), Grid((0, 0, 0), 0.5, (20, 18, 3))


def session(grid: Grid, seed: int, most: int = 5) -> RayStatistics:
    rng = np.random.default_rng(seed)
    seen = rng.random(grid.shape) < 0.5
    hits, misses = rng.integers(0, most, (2, *grid.shape)) * seen
    path = rng.integers(1, 2**24, grid.shape) * seen
    return RayStatistics(grid, hits.astype(np.uint32), misses.astype(np.uint32), path)


def sessions(grid: Grid, seed: int, count: int = 4) -> list[RayStatistics]:
    """Sessions on grids of one raster that overlap."""
    rng = np.random.default_rng(seed)
    moved = [np.array(grid.origin) + rng.integers(-9, 9, grid.dimension) * grid.resolution for _ in range(count)]
    return [session(Grid(tuple(low), grid.resolution, grid.shape), seed + k) for k, low in enumerate(moved)]


@given(st.sampled_from([PLANAR, SPATIAL]), SEEDS)
def test_without_forgetting_it_is_the_batch_posterior(grid: Grid, seed: int) -> None:
    parts = sessions(grid, seed)
    batch = DecayRatePosterior(RayStatistics.merge(parts), PRIOR)
    belief, reflection = GammaBelief.from_statistics(parts[0], PRIOR), BetaBelief.from_statistics(parts[0], 0.2, 0.6)
    for part in parts[1:]:
        belief, reflection = belief.update(part), reflection.update(part)
    # The union of grids has an origin of rounded multiples; compare cell by cell.
    assert belief.grid.shares_raster(batch.grid) and belief.grid.shape == batch.grid.shape
    assert np.array_equal(belief.shapes, batch.shapes)
    assert np.array_equal(belief.paths, batch.paths)
    assert np.array_equal(belief.mean, batch.mean)
    assert np.array_equal(reflection.alphas, batch.statistics.hits + 0.2)
    assert np.array_equal(reflection.betas, batch.statistics.misses + 0.6)
    # Beliefs of halves, merged, are that of the whole.
    halves = [GammaBelief.from_statistics(RayStatistics.merge(half), PRIOR) for half in (parts[:2], parts[2:])]
    assert np.array_equal((halves[0] + halves[1]).shapes, batch.shapes)
    assert np.array_equal((halves[1] + halves[0]).paths, batch.paths)
    two = [BetaBelief.from_statistics(RayStatistics.merge(half), 0.2, 0.6) for half in (parts[:2], parts[2:])]
    assert np.array_equal((two[0] + two[1]).betas, reflection.betas)


@given(SEEDS, floats(0.05, 1.0))
def test_old_sessions_fade(seed: int, forgetting: float) -> None:
    parts = [session(PLANAR, seed + k) for k in range(4)]
    belief, reflection = GammaBelief.from_statistics(parts[0], PRIOR), BetaBelief.from_statistics(parts[0], 0.2, 0.6)
    a, b = parts[0].hits + PRIOR.shape, parts[0].path_lengths + PRIOR.path
    for part in parts[1:]:
        belief, reflection = belief.update(part, forgetting), reflection.update(part, forgetting)
        a = PRIOR.shape + forgetting * (a - PRIOR.shape) + part.hits
        b = PRIOR.path + forgetting * (b - PRIOR.path) + part.path_lengths
    assert belief.shapes == pytest.approx(a)
    assert belief.paths == pytest.approx(b)
    weights = forgetting ** np.arange(4)[::-1]
    assert reflection.betas == pytest.approx(0.6 + sum(w * p.misses for w, p in zip(weights, parts, strict=True)))
    # A power prior: the density of before to the power, times the prior's for what is left.
    rate = 0.7
    before = GammaBelief.from_statistics(parts[0], PRIOR)
    after = before.update(RayStatistics.empty(PLANAR), forgetting)

    def log_density(belief: GammaBelief) -> np.ndarray:
        at = gamma_distribution.logpdf(rate, belief.shapes, scale=1 / belief.paths)
        other = gamma_distribution.logpdf(0.3, belief.shapes, scale=1 / belief.paths)
        return at - other

    prior = log_density(GammaBelief(FadingCounts.of(RayStatistics.empty(PLANAR)), PRIOR))
    assert log_density(after) == pytest.approx(forgetting * log_density(before) + (1 - forgetting) * prior, abs=1e-9)


@given(SEEDS, st.sampled_from([1.0, 0.7]))
def test_sparse_beliefs_are_the_dense_ones(seed: int, forgetting: float) -> None:
    parts = sessions(SPATIAL, seed, 3)
    dense, sparse = FadingCounts.of(parts[0]), FadingCounts.of(BrickStatistics.from_dense(parts[0]))
    for part in parts[1:]:
        dense = dense.update(part, forgetting)
        sparse = sparse.update(BrickStatistics.from_dense(part), forgetting)
    assert sparse.keys is not None and (np.diff(sparse.keys) > 0).all()
    assert sparse.grid == dense.grid
    cells = tuple(BrickStatistics.empty(sparse.grid).layout.cells(sparse.keys).T)
    for name in ("hits", "misses", "path_lengths"):
        assert np.array_equal(getattr(sparse, name), getattr(dense, name)[cells])
        assert getattr(sparse, name).sum() == pytest.approx(getattr(dense, name).sum())


def test_moments() -> None:
    counts = FadingCounts.of(session(PLANAR, 1))
    belief, reflection = GammaBelief(counts, PRIOR), BetaBelief(counts, 0.2, 0.6)
    of_rate = gamma_distribution(belief.shapes, scale=1 / belief.paths)
    assert belief.mean == pytest.approx(of_rate.mean()) and belief.variance == pytest.approx(of_rate.var())
    of_share = beta_distribution(reflection.alphas, reflection.betas)
    assert reflection.mean == pytest.approx(of_share.mean())
    assert reflection.variance == pytest.approx(of_share.var())
    assert belief.grid == reflection.grid == PLANAR


@settings(max_examples=20)
@given(floats(0.6, 30), floats(0.6, 30), floats(0.5, 20), floats(0.5, 20))
def test_overlap_is_the_integral(a_1: float, a_2: float, b_1: float, b_2: float) -> None:
    grid = Grid((0, 0), 1.0, (1, 1))
    one, two = (FadingCounts(grid, *(np.full((1, 1), v - 0.5) for v in (a, b, b))) for a, b in ((a_1, b_1), (a_2, b_2)))
    prior = GammaPrior(0.5, 0.5)
    found = float(np.exp(GammaBelief(one, prior).log_overlap(GammaBelief(two, prior)))[0, 0])
    p, q = gamma_distribution(a_1, scale=1 / b_1), gamma_distribution(a_2, scale=1 / b_2)
    # In x = t^2 no density is infinite at the border.
    ends = np.sqrt([p.mean(), q.mean()])
    far = 3 * max(p.ppf(1 - 1e-12), q.ppf(1 - 1e-12)) ** 0.5
    expected = quad(lambda t: 2 * t * np.sqrt(p.pdf(t * t) * q.pdf(t * t)), 0, far, points=ends, limit=400)[0]
    assert found == pytest.approx(expected, rel=1e-5, abs=1e-9)
    found = float(np.exp(BetaBelief(one, 0.5, 0.5).log_overlap(BetaBelief(two, 0.5, 0.5)))[0, 0])
    p, q = beta_distribution(a_1, b_1), beta_distribution(a_2, b_2)
    angles = np.sort(np.arcsin(np.sqrt([p.mean(), q.mean()])))

    def weight(t: float) -> float:
        x = np.sin(t) ** 2
        return 2 * np.sin(t) * np.cos(t) * np.sqrt(p.pdf(x) * q.pdf(x))

    expected = quad(weight, 1e-9, np.pi / 2 - 1e-9, points=angles, limit=400)[0]
    assert found == pytest.approx(expected, rel=1e-4, abs=1e-9)


def test_overlap_is_symmetric_and_one_with_itself() -> None:
    one, two = (FadingCounts.of(session(PLANAR, k, 2**31)) for k in (1, 2))
    for make in (lambda c: GammaBelief(c, PRIOR), lambda c: BetaBelief(c, 0.1, 0.4)):
        there, back = make(one).log_overlap(make(two)), make(two).log_overlap(make(one))
        assert np.array_equal(there, back) and (there <= 0).all()
        assert make(one).log_overlap(make(one)) == pytest.approx(0.0, abs=1e-4)


def test_what_does_not_fit_is_refused() -> None:
    counts = FadingCounts.of(session(PLANAR, 1))
    for forgetting in (0.0, 1.1, float("nan")):
        with pytest.raises(MapError, match="forgetting"):
            counts.update(session(PLANAR, 2), forgetting)
    with pytest.raises(MapError, match="hits: shape"):
        FadingCounts(PLANAR, np.zeros(3), counts.misses, counts.path_lengths)
    with pytest.raises(MapError, match="raster"):
        counts.update(session(Grid((0.1, 0), 0.5, (7, 5)), 2))
    dense = session(SPATIAL, 1)
    with pytest.raises(MapError, match="one map is sparse"):
        FadingCounts.of(dense).update(BrickStatistics.from_dense(dense))
    with pytest.raises(MapError, match="different priors"):
        GammaBelief(counts, PRIOR) + GammaBelief(counts, GammaPrior(1, 1))
    with pytest.raises(MapError, match="different priors"):
        BetaBelief(counts, 1, 2) + BetaBelief(counts, 1, 1)
    with pytest.raises(MapError, match="prior"):
        BetaBelief(counts, 0, 2)
