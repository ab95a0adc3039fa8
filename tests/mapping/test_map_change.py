"""Change and correlation of maps: factors equal to integrals, sound for extreme counts, and right about shifts."""

import decimal
import math

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
from factorloc.mapping import BrickStatistics, GammaPrior, Grid, RayStatistics
from factorloc.mapping.evidence import RateEvidence, ReflectionEvidence
from factorloc.mapping.fading_counts import FadingCounts
from factorloc.mapping.map_change import MapChange
from factorloc.mapping.map_shift import MapShift, log_match

RATE = RateEvidence(GammaPrior(0.5, 0.8))
REFLECTION = ReflectionEvidence(0.5, 1.2)
MODELS = st.sampled_from([RATE, REFLECTION])
COUNTS = st.integers(0, 12)


def of_counts(grid: Grid, hits, misses, path) -> RayStatistics:
    return RayStatistics(
        grid,
        np.broadcast_to(hits, grid.shape).astype(np.uint32),
        np.broadcast_to(misses, grid.shape).astype(np.uint32),
        np.round(np.broadcast_to(path, grid.shape) * 2**20).astype(np.int64),
    )


def one_factor(evidence, first: tuple[float, float], second: tuple[float, float]) -> float:
    pair = [(np.array([float(h)]), np.array([float(x)])) for h, x in (first, second)]
    return float(evidence.log_bayes_factor(*pair)[0])


@settings(max_examples=20)
@given(COUNTS, COUNTS, floats(0.1, 9), floats(0.1, 9))
def test_factors_of_rates_are_integrals(H_1: int, H_2: int, R_1: float, R_2: float) -> None:
    prior = gamma_distribution(RATE.prior.shape, scale=1 / RATE.prior.path)

    def marginal(H: float, R: float) -> float:
        # In rate = t^2 the prior has no pole.
        most = math.sqrt((H + 60) / (R + 0.8)) + 1
        peak = math.sqrt(H / R) if 0 < math.sqrt(H / R) < most else most / 2
        density = lambda t: 2 * t * t ** (2 * H) * math.exp(-R * t * t) * prior.pdf(t * t) if t > 0 else 0.0  # noqa: E731
        return quad(density, 0, most, points=[peak], limit=200, epsabs=0)[0]

    expected = math.log(marginal(H_1, R_1)) + math.log(marginal(H_2, R_2)) - math.log(marginal(H_1 + H_2, R_1 + R_2))
    assert one_factor(RATE, (H_1, R_1), (H_2, R_2)) == pytest.approx(expected, rel=1e-6, abs=1e-6)


@settings(max_examples=20)
@given(COUNTS, COUNTS, COUNTS, COUNTS)
def test_factors_of_reflections_are_integrals(H_1: int, H_2: int, M_1: int, M_2: int) -> None:
    prior = beta_distribution(REFLECTION.alpha, REFLECTION.beta)

    def marginal(H: int, M: int) -> float:
        density = lambda t: 2 * t * (t * t) ** H * (1 - t * t) ** M * prior.pdf(t * t)  # noqa: E731
        return quad(density, 1e-12, 1 - 1e-12, limit=200, epsabs=0)[0]

    expected = math.log(marginal(H_1, M_1)) + math.log(marginal(H_2, M_2)) - math.log(marginal(H_1 + H_2, M_1 + M_2))
    assert one_factor(REFLECTION, (H_1, M_1), (H_2, M_2)) == pytest.approx(expected, rel=1e-6, abs=1e-6)


@given(MODELS, COUNTS, COUNTS, floats(0, 20), floats(0, 20))
def test_factors_are_sums_of_marginals(evidence, H_1: int, H_2: int, x_1: float, x_2: float) -> None:
    found = one_factor(evidence, (H_1, x_1), (H_2, x_2))
    marginals = [evidence.log_marginal(np.array(H), np.array(x)) for H, x in ((H_1, x_1), (H_2, x_2))]
    both = evidence.log_marginal(np.array(H_1 + H_2), np.array(x_1 + x_2))
    assert found == pytest.approx(float(sum(marginals) - both), abs=1e-10)
    assert found == pytest.approx(one_factor(evidence, (H_2, x_2), (H_1, x_1)), abs=1e-10)
    assert one_factor(evidence, (H_1, x_1), (0, 0.0)) == pytest.approx(0.0, abs=1e-10)


@given(MODELS, SEEDS)
def test_whole_counts_and_real_ones_have_one_marginal(evidence, seed: int) -> None:
    rng = np.random.default_rng(seed)
    hits, trials = rng.integers(0, 40, (2, 500)).astype(float)
    together = evidence.log_marginal(hits, trials)
    few = [evidence.log_marginal(hits[k : k + 20], trials[k : k + 20]) for k in range(0, 500, 20)]
    assert np.abs(together - np.concatenate(few)).max() < 1e-10
    assert np.abs(together - evidence.log_marginal(hits + 1e-9, trials + 1e-9)).max() < 1e-6


def log_gamma(x) -> decimal.Decimal:
    """Stirling's series to 40 digits, for large numbers after stepping up."""
    x, steps = decimal.Decimal(x), decimal.Decimal(1)
    while x < 60:
        steps *= x
        x += 1
    series = sum(
        decimal.Decimal(a) / decimal.Decimal(b) / x**n
        for a, b, n in (
            (1, 12, 1),
            (-1, 360, 3),
            (1, 1260, 5),
            (-1, 1680, 7),
            (1, 1188, 9),
            (-691, 360360, 11),
            (1, 156, 13),
        )
    )
    pi = decimal.Decimal("3.14159265358979323846264338327950288419716939937510")
    return (x - decimal.Decimal("0.5")) * x.ln() - x + (2 * pi).ln() / 2 + series - steps.ln()


@pytest.mark.parametrize("ratio", [1.0, 1.0001, 1.01, 3.0])
@pytest.mark.parametrize("visits", [10**3, 10**6, 10**9])
def test_a_thousand_million_visits(visits: int, ratio: float) -> None:
    H_1, H_2 = visits // 5, round(visits // 5 * ratio)
    M_1, M_2 = visits, visits
    R_1, R_2 = float(visits), visits / 4
    with decimal.localcontext() as context:
        context.prec = 50
        D = decimal.Decimal
        a, b = D(REFLECTION.alpha), D(REFLECTION.beta)

        def of_beta(H: int, M: int) -> decimal.Decimal:
            return log_gamma(H + a) + log_gamma(M + b) - log_gamma(H + M + a + b)

        expected = of_beta(H_1, M_1) + of_beta(H_2, M_2) - of_beta(H_1 + H_2, M_1 + M_2) - of_beta(0, 0)
        # Large numbers cancel; what is left is as exact as their logarithms allow.
        assert one_factor(REFLECTION, (H_1, M_1), (H_2, M_2)) == pytest.approx(float(expected), rel=1e-9, abs=3e-5)
        a, b = D(RATE.prior.shape), D(RATE.prior.path)

        def of_gamma(H: int, R: float) -> decimal.Decimal:
            return log_gamma(H + a) - log_gamma(a) + a * b.ln() - (H + a) * (D(R) + b).ln()

        expected = of_gamma(H_1, R_1) + of_gamma(H_2, R_2) - of_gamma(H_1 + H_2, R_1 + R_2)
        assert one_factor(RATE, (H_1, R_1), (H_2, R_2)) == pytest.approx(float(expected), rel=1e-9, abs=3e-5)


def world(seed: int, shape: tuple[int, ...]) -> np.ndarray:
    """Reflection probabilities: mostly free space, some walls."""
    rng = np.random.default_rng(seed)
    return np.where(rng.random(shape) < 0.25, rng.uniform(0.3, 0.9, shape), 0.01)


def visit(grid: Grid, share: np.ndarray, seed: int, rays: int = 30, seen: float = 0.8) -> RayStatistics:
    """Statistics of rays that meet each cell, with 0.4 m of path each."""
    rng = np.random.default_rng(seed)
    visits = rng.poisson(rays, grid.shape) * (rng.random(grid.shape) < seen)
    hits = rng.binomial(visits, share)
    path = 0.4 * visits
    return of_counts(grid, hits, visits - hits, path)


@given(MODELS, SEEDS)
def test_changed_cells_stand_out(evidence, seed: int) -> None:
    grid = Grid((0, 0), 0.5, (20, 20))
    before = world(seed, grid.shape)
    after = before.copy()
    after[3, 4:8], before[3, 4:8] = 0.9, 0.01
    after[9, 2:5], before[9, 2:5] = 0.01, 0.9
    changed = before != after
    first, second = visit(grid, before, seed, 60, 1.0), visit(grid, after, seed + 1, 60, 1.0)
    change = MapChange.between(first, second, evidence)
    assert (change.probability()[changed] > 0.99).all()
    assert (change.probability()[~changed] > 0.5).mean() < 0.02
    assert change.log_bayes_factors[~changed].mean() < 0
    # Odds are the prior's times the factor.
    p = change.probability(0.2)
    safe = np.abs(change.log_bayes_factors) < 15
    odds = 0.25 * np.exp(change.log_bayes_factors[safe])
    assert p[safe] / (1 - p[safe]) == pytest.approx(odds, rel=1e-6)
    assert change.log_match == pytest.approx(log_match(first, second, evidence, (0, 0)), rel=1e-9)


@given(MODELS, SEEDS)
def test_sparse_maps_as_dense_ones(evidence, seed: int) -> None:
    one, two = Grid((0, 0, 0), 0.5, (20, 9, 4)), Grid((-1, 2, 0.5), 0.5, (18, 17, 3))
    first, second = (visit(g, world(seed, g.shape), seed + k, 5, 0.3) for k, g in enumerate((one, two)))
    dense = MapChange.between(first, second, evidence)
    sparse = MapChange.between(*(BrickStatistics.from_dense(m) for m in (first, second)), evidence)
    assert sparse.keys is not None and sparse.grid == dense.grid
    cells = tuple(BrickStatistics.empty(sparse.grid).layout.cells(sparse.keys).T)
    assert np.array_equal(sparse.log_bayes_factors, dense.log_bayes_factors[cells])
    assert sparse.log_match == pytest.approx(dense.log_match, abs=1e-9)
    # Where only one map has been nothing is known.
    seen = [FadingCounts.of(m).aligned(o)[0].visited for m, o in ((first, second), (second, first))]
    assert (dense.log_bayes_factors[~(seen[0] & seen[1])] == 0).all()


@settings(max_examples=20)
@given(MODELS, SEEDS, st.tuples(st.integers(-4, 4), st.integers(-4, 4)))
def test_the_true_shift_is_found(evidence, seed: int, shift: tuple[int, int]) -> None:
    share = world(seed, (40, 40))
    first = visit(Grid((0, 0), 0.5, (24, 22)), share[8:32, 9:31], seed)
    # The second map sees the same world, but believes to be elsewhere.
    low = np.array([6, 7]) + shift
    origin = (np.array([6, 7]) - [8, 9]) * 0.5
    second = visit(Grid(tuple(origin), 0.5, (22, 25)), share[low[0] : low[0] + 22, low[1] : low[1] + 25], seed + 1)
    found = MapShift.search(first, second, evidence, (5, 4))
    assert found.cells == shift
    assert found.metres == (shift[0] * 0.5, shift[1] * 0.5)
    assert found.log_matches.shape == (11, 9) and found.log_matches.max() > 0
    assert found.probabilities.sum() == pytest.approx(1.0)
    assert found.probabilities[shift[0] + 5, shift[1] + 4] > 0.99
    for k in [(0, 0), (5, 4), (10, 8)]:
        moved = tuple(int(a) - b for a, b in zip(k, (5, 4), strict=True))
        moved_map = Grid(tuple(origin + np.array(moved) * 0.5), 0.5, (22, 25))
        change = MapChange.between(
            first, RayStatistics(moved_map, second.hits, second.misses, second.path_fixed), evidence
        )
        assert found.log_matches[k] == pytest.approx(change.log_match, rel=1e-7, abs=1e-6)


def test_maps_that_do_not_meet_say_nothing() -> None:
    grid = Grid((0, 0), 0.5, (4, 4))
    first, second = (visit(grid, world(k, grid.shape), k) for k in (1, 2))
    assert log_match(first, second, RATE, (4, 0)) == 0.0
    assert log_match(first, second, RATE, (0, -9)) == 0.0
    spatial = visit(Grid((0, 0, 0), 0.5, (4, 4, 4)), world(1, (4, 4, 4)), 1)
    assert MapShift.search(spatial, spatial, RATE, 1).cells == (0, 0, 0)


def test_what_does_not_fit_is_refused() -> None:
    grid = Grid((0, 0), 0.5, (4, 4))
    counts = visit(grid, world(1, grid.shape), 1)
    other = visit(Grid((0.2, 0), 0.5, (4, 4)), world(1, grid.shape), 1)
    for call in (lambda: MapChange.between(counts, other, RATE), lambda: MapShift.search(counts, other, RATE)):
        with pytest.raises(MapError, match="raster"):
            call()
    sparse = BrickStatistics.empty(Grid((0, 0, 0), 0.5, (4, 4, 4)))
    with pytest.raises(MapError, match="sparse"):
        MapShift.search(sparse, sparse, RATE)
    with pytest.raises(MapError, match="most"):
        MapShift.search(counts, counts, RATE, (1, 2, 3))
    for prior in (0.0, 1.0):
        with pytest.raises(MapError, match="prior"):
            MapChange.between(counts, counts, RATE).probability(prior)
    with pytest.raises(MapError, match="prior"):
        ReflectionEvidence(0, 1)
