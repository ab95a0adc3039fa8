"""Priors of reflection probabilities: equal to a brute-force optimum, true on simulated visits, refused otherwise."""

import naive
import numpy as np
import pytest
from hypothesis import given
from strategies import floats

from factorloc.errors import MapError
from factorloc.mapping import BrickStatistics, Grid, RayStatistics
from factorloc.mapping import beta_prior as module
from factorloc.mapping.beta_prior import BetaPrior, CellwiseBetaPrior, estimate_beta_prior


def visits(hits: np.ndarray, misses: np.ndarray, shape: tuple[int, ...] | None = None) -> RayStatistics:
    grid = Grid((0,) * len(shape or (0, 0)), 0.1, shape or (len(hits), 1))
    H, M = (np.reshape(counts, grid.shape).astype(np.uint32) for counts in (hits, misses))
    return RayStatistics(grid, H, M, (H.astype(np.int64) + M) * 2**17)


def simulated(alpha: float, beta: float, cells: int, seed: int = 0) -> RayStatistics:
    rng = np.random.default_rng(seed)
    number = rng.geometric(0.15, cells)
    hits = rng.binomial(number, rng.beta(alpha, beta, cells))
    return visits(hits, number - hits)


def parts(statistics: RayStatistics) -> tuple[np.ndarray, np.ndarray]:
    return statistics.hits.ravel().astype(float), statistics.misses.ravel().astype(float)


@pytest.mark.parametrize("seed", range(4))
def test_marginal_prior_is_the_brute_force_optimum(seed: int) -> None:
    few = simulated(0.7, 1.4, 15, seed)
    found, (H, M) = estimate_beta_prior(few), parts(few)
    assert (found.hits, found.misses) == pytest.approx(naive.beta_prior(H, M), rel=1e-3)
    best = naive.beta_log_marginal(found.hits, found.misses, H, M)
    for factor in (0.9, 1.1):
        assert naive.beta_log_marginal(factor * found.hits, found.misses, H, M) < best
        assert naive.beta_log_marginal(found.hits, factor * found.misses, H, M) < best


@pytest.mark.parametrize(("alpha", "beta"), [(0.05, 0.6), (1.0, 1.0), (2.0, 9.0)])
def test_marginal_prior_is_the_one_the_probabilities_were_drawn_from(alpha: float, beta: float) -> None:
    found = estimate_beta_prior(simulated(alpha, beta, 60_000))
    assert (found.hits, found.misses) == pytest.approx((alpha, beta), rel=0.06)
    assert found.mean == pytest.approx(alpha / (alpha + beta), rel=0.03)


def test_published_prior_has_the_moments_and_is_the_formula_of_the_thesis() -> None:
    statistics = simulated(0.5, 2.0, 500)
    H, M = parts(statistics)
    E, var = (H / (H + M)).mean(), (H / (H + M)).var()
    found = estimate_beta_prior(statistics, "published")
    assert found.mean == pytest.approx(E)
    assert found.variance == pytest.approx(var)
    assert found.hits == pytest.approx(-E * (E**2 - E + var) / var)
    assert found.misses == pytest.approx((E - var + E * var - 2 * E**2 + E**3) / var)


@given(floats(1e-3, 1e4), floats(1e-3, 1e4))
def test_a_prior_knows_its_moments(hits: float, misses: float) -> None:
    prior = BetaPrior(hits, misses)
    total = prior.mean * (1 - prior.mean) / prior.variance - 1
    assert (prior.mean * total, (1 - prior.mean) * total) == pytest.approx((hits, misses), rel=1e-6)


def test_leaving_one_out_is_the_published_rule_on_all_other_cells() -> None:
    seen = simulated(0.5, 2.0, 30)
    hits, misses = (np.append(counts, [0.0, 0.0]) for counts in parts(seen))
    found = estimate_beta_prior(visits(hits, misses), "leave-one-out")
    cell_hits, cell_misses = (np.ravel(numbers) for numbers in found.of_cells)
    for k in range(30):
        others = estimate_beta_prior(visits(np.delete(hits, k), np.delete(misses, k)), "published")
        assert (cell_hits[k], cell_misses[k]) == pytest.approx((others.hits, others.misses), rel=1e-9)
    whole = estimate_beta_prior(seen, "published")
    assert (found.hits, found.misses) == (whole.hits, whole.misses)
    assert cell_hits[30:].tolist() == [whole.hits] * 2
    assert cell_misses[30:].tolist() == [whole.misses] * 2


def test_sparse_maps_have_the_prior_of_dense_ones() -> None:
    rng = np.random.default_rng(0)
    dense = visits(rng.integers(0, 4, 24_000), rng.integers(0, 4, 24_000), (20, 30, 40))
    sparse = BrickStatistics.from_dense(dense)
    for rule in ("marginal", "published", "leave-one-out"):
        one, two = estimate_beta_prior(dense, rule), estimate_beta_prior(sparse, rule)
        assert (one.hits, one.misses) == pytest.approx((two.hits, two.misses), rel=1e-9)
    at = tuple(sparse.layout.cells(sparse.keys).T)
    assert one.of_cells[0][at] == pytest.approx(two.of_cells[0])
    assert one.of_cells[1][at] == pytest.approx(two.of_cells[1])


def test_cells_that_no_ray_visited_do_not_matter() -> None:
    seen = simulated(0.5, 0.5, 40)
    hits, misses = (np.append(counts, np.zeros(30)) for counts in parts(seen))
    for rule in ("marginal", "published"):
        assert estimate_beta_prior(visits(hits, misses), rule) == estimate_beta_prior(seen, rule)


def test_cells_visited_once_do_not_tell_how_probabilities_spread() -> None:
    hits = np.array([1, 0, 0, 1, 0])
    for rule, message in [("marginal", "visited twice"), ("published", "all rays or none"), ("leave-one-out", "none")]:
        with pytest.raises(MapError, match=message):
            estimate_beta_prior(visits(hits, 1 - hits), rule)


@pytest.mark.parametrize("times", [1, 10**3, 10**9])
def test_counts_of_any_size_have_a_prior(times: int) -> None:
    hits, misses = (times * counts for counts in parts(simulated(0.8, 1.5, 400)))
    few = hits + misses < 4 * times
    found = estimate_beta_prior(visits(hits[few], misses[few]))
    assert 0 < found.hits < 10
    assert 0.2 < found.mean < 0.5


def test_one_probability_everywhere_gives_a_narrow_prior_around_it() -> None:
    found = estimate_beta_prior(visits(np.full(100, 30), np.full(100, 70)))
    assert found.mean == pytest.approx(0.3, rel=1e-2)
    assert found.variance < 1e-3
    with pytest.raises(MapError, match="one reflection probability"):
        estimate_beta_prior(visits(np.full(100, 3), np.full(100, 2)), "published")


def test_of_a_large_map_every_kth_cell_is_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    large = simulated(0.5, 2.0, 30_000)
    every = estimate_beta_prior(large)
    monkeypatch.setattr(module, "MOST_CELLS", 10_000)
    third = estimate_beta_prior(large)
    assert third != every
    assert (third.hits, third.misses) == pytest.approx((every.hits, every.misses), rel=0.06)
    H, M = parts(large)
    assert third == estimate_beta_prior(visits(H[::3], M[::3]))
    lone = visits(np.eye(1, 101, 50)[0], np.full(101, 5))
    monkeypatch.setattr(module, "MOST_CELLS", 10)
    assert estimate_beta_prior(lone).mean == pytest.approx(1 / 506, rel=0.05)


def test_without_hits_or_misses_there_is_nothing_to_learn() -> None:
    for hits, misses, kind in [(0, 3, "hit"), (0, 0, "hit"), (3, 0, "missed")]:
        with pytest.raises(MapError, match=f"no cell was {kind}"):
            estimate_beta_prior(visits(np.full(5, hits), np.full(5, misses)))
    with pytest.raises(MapError, match="unknown rule 'guessed'; choose 'marginal', 'published' or 'leave-one-out'"):
        estimate_beta_prior(simulated(1, 1, 50), "guessed")  # type: ignore[arg-type]


@pytest.mark.parametrize(("hits", "misses"), [(0, 1), (1, 0), (-1, 1), (np.nan, 1), (1, np.inf)])
def test_a_prior_has_two_positive_numbers(hits: float, misses: float) -> None:
    with pytest.raises(MapError, match="expected two positive numbers"):
        BetaPrior(hits, misses)
    with pytest.raises(MapError, match="expected positive numbers"):
        CellwiseBetaPrior(1.0, 1.0, np.array([hits, 1.0]), np.array([misses, 1.0]))
