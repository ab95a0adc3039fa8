"""Priors of decay rates: equal to a brute-force optimum, true on simulated exposures, refused where there are none."""

import naive
import numpy as np
import pytest
from ray_cases import counted

from factorloc.errors import MapError
from factorloc.mapping import (
    DecayRateMap,
    DecayRatePosterior,
    GammaPrior,
    Grid,
    RayStatistics,
    estimate_prior,
)
from factorloc.mapping import prior as module
from factorloc.mapping.prior import CellwiseGammaPrior


def exposures(hits: np.ndarray, path: np.ndarray) -> RayStatistics:
    return counted(Grid((0, 0), 0.1, (len(hits), 1)), np.reshape(hits, (-1, 1)), np.reshape(path, (-1, 1)))


def simulated(shape: float, path: float, cells: int, seed: int = 0) -> RayStatistics:
    rng = np.random.default_rng(seed)
    exposure = rng.lognormal(0, 1.5, cells)
    return exposures(rng.poisson(rng.gamma(shape, 1 / path, cells) * exposure), exposure)


@pytest.mark.parametrize("seed", range(4))
def test_marginal_prior_is_the_brute_force_optimum(seed: int) -> None:
    few = simulated(0.7, 0.4, 12, seed)
    found = estimate_prior(few)
    H, R = few.hits.ravel().astype(float), few.path_lengths.ravel()
    shape, path = naive.marginal_prior(H, R)
    assert found.shape == pytest.approx(shape, rel=1e-3)
    assert found.path == pytest.approx(path, rel=1e-3)
    best = naive.marginal_log_likelihood(found.shape, found.path, H, R)
    for factor in (0.9, 1.1):
        assert naive.marginal_log_likelihood(factor * found.shape, found.path, H, R) < best
        assert naive.marginal_log_likelihood(found.shape, factor * found.path, H, R) < best


@pytest.mark.parametrize(("shape", "path"), [(0.05, 0.2), (0.5, 0.5), (3.0, 20.0)])
def test_marginal_prior_is_the_one_the_rates_were_drawn_from(shape: float, path: float) -> None:
    found = estimate_prior(simulated(shape, path, 60_000))
    assert found.shape == pytest.approx(shape, rel=0.05)
    assert found.path == pytest.approx(path, rel=0.08)
    assert found.mean == pytest.approx(shape / path, rel=0.05)


def test_published_prior_has_the_moments_of_the_rates() -> None:
    statistics = simulated(0.5, 0.5, 500)
    rates = statistics.hits / statistics.path_lengths
    found = estimate_prior(statistics, "published")
    assert found.shape == pytest.approx(rates.mean() ** 2 / rates.var())
    assert found.path == pytest.approx(rates.mean() / rates.var())
    assert found.mean == pytest.approx(rates.mean())
    assert found.variance == pytest.approx(rates.var())


def test_leaving_one_out_is_the_published_rule_on_all_other_cells() -> None:
    seen = simulated(0.5, 0.5, 40)
    hits, path = np.append(seen.hits, [0, 0]), np.append(seen.path_lengths, [0.0, 0.0])
    found = estimate_prior(exposures(hits, path), "leave-one-out")
    shapes, paths = (np.ravel(numbers) for numbers in found.of_cells)
    for k in range(40):
        others = estimate_prior(exposures(np.delete(hits, k), np.delete(path, k)), "published")
        assert shapes[k] == pytest.approx(others.shape, rel=1e-9)
        assert paths[k] == pytest.approx(others.path, rel=1e-9)
    whole = estimate_prior(seen, "published")
    assert (found.shape, found.path) == (whole.shape, whole.path)
    assert shapes[40:].tolist() == [whole.shape] * 2
    assert paths[40:].tolist() == [whole.path] * 2


def test_one_rate_that_outshines_all_others_leaves_them_their_moments() -> None:
    hits, path = np.array([1, 2, 3, 4, 4_000_000_000]), np.array([1.0, 1.0, 1.0, 1.0, 2.0**-20])
    shapes, paths = estimate_prior(exposures(hits, path), "leave-one-out").of_cells
    others = estimate_prior(exposures(hits[:4], path[:4]), "published")
    assert (np.ravel(shapes)[4], np.ravel(paths)[4]) == pytest.approx((others.shape, others.path), rel=1e-12)
    with pytest.raises(MapError, match="one decay rate"):
        estimate_prior(exposures(np.array([1, 1, 7]), np.ones(3)), "leave-one-out")


def test_a_prior_of_each_cell_makes_the_posterior_and_has_positive_numbers() -> None:
    counts = simulated(0.5, 0.5, 40)
    model = DecayRatePosterior.from_statistics(counts, "leave-one-out")
    shapes, paths = model.prior.of_cells
    assert np.ptp(shapes) > 0
    assert model.mean == pytest.approx((counts.hits + shapes) / (counts.path_lengths + paths))
    assert DecayRateMap.from_statistics(counts, "leave-one-out").prior.mean == model.prior.mean
    with pytest.raises(MapError, match="expected positive numbers"):
        CellwiseGammaPrior(1.0, 1.0, np.zeros(3), np.ones(3))


@pytest.mark.parametrize("times", [1, 10**4, 10**8])
def test_counts_of_any_size_have_a_prior(times: int) -> None:
    rng = np.random.default_rng(1)
    rates = rng.gamma(0.5, 2.0, 500)
    path = rng.uniform(0.5, 2, 500) * times
    found = estimate_prior(exposures(np.minimum(rng.poisson(rates * path), 2**32 - 1), path))
    assert found.mean == pytest.approx(1.0, rel=0.25)


@pytest.mark.parametrize("unseen", [1, 30])
def test_cells_that_no_ray_crossed_do_not_matter(unseen: int) -> None:
    seen = simulated(0.5, 0.5, 40)
    hits, path = (np.concatenate([np.ravel(a), np.zeros(unseen)]) for a in (seen.hits, seen.path_lengths))
    for rule in ("marginal", "published"):
        assert estimate_prior(exposures(hits, path), rule) == estimate_prior(seen, rule)


def test_one_rate_everywhere_gives_a_narrow_prior_around_it() -> None:
    found = estimate_prior(exposures(np.full(100, 3), np.full(100, 2.0)))
    assert found.mean == pytest.approx(1.5, rel=1e-3)
    assert found.variance < 1e-4
    for rule in ("published", "leave-one-out"):
        with pytest.raises(MapError, match="one decay rate"):
            estimate_prior(exposures(np.full(100, 3), np.full(100, 2.0)), rule)


def test_of_a_large_map_every_kth_cell_is_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    large = simulated(0.5, 0.5, 30_000)
    every = estimate_prior(large)
    monkeypatch.setattr(module, "MOST_CELLS", 10_000)
    third = estimate_prior(large)
    assert third != every
    assert third.shape == pytest.approx(every.shape, rel=0.06)
    assert third.path == pytest.approx(every.path, rel=0.1)
    assert third == estimate_prior(exposures(large.hits[::3], large.path_lengths[::3]))


def test_a_lone_hit_is_not_sampled_away(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MOST_CELLS", 10)
    found = estimate_prior(exposures(np.eye(1, 101, 50)[0], np.ones(101)))
    assert found.mean == pytest.approx(1 / 101, rel=0.01)


def test_without_hits_there_is_nothing_to_learn() -> None:
    for hits, path in [(0, 1.0), (0, 0.0), (1, 0.0)]:
        with pytest.raises(MapError, match="no cell was hit"):
            estimate_prior(exposures(np.full(5, hits), np.full(5, path)))
    with pytest.raises(MapError, match="unknown rule 'guessed'; choose 'marginal', 'published' or 'leave-one-out'"):
        estimate_prior(simulated(1, 1, 50), "guessed")  # type: ignore[arg-type]


@pytest.mark.parametrize(("shape", "path"), [(0, 1), (1, 0), (-1, 1), (np.nan, 1), (1, np.inf)])
def test_a_prior_has_two_positive_numbers(shape: float, path: float) -> None:
    with pytest.raises(MapError, match="expected two positive numbers"):
        GammaPrior(shape, path)
