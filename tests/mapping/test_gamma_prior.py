"""Priors of decay rates: equal to a brute-force optimum, true on simulated exposures, refused where there are none."""

import naive
import numpy as np
import pytest
from ray_cases import counted

from factorloc.errors import MapError
from factorloc.mapping import GammaPrior, Grid, RayStatistics, estimate_prior
from factorloc.mapping import prior as module


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
    with pytest.raises(MapError, match="one decay rate"):
        estimate_prior(exposures(np.full(100, 3), np.full(100, 2.0)), "published")


def test_of_a_large_map_every_kth_cell_is_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    large = simulated(0.5, 0.5, 30_000)
    every = estimate_prior(large)
    monkeypatch.setattr(module, "_MOST_CELLS", 10_000)
    third = estimate_prior(large)
    assert third != every
    assert third.shape == pytest.approx(every.shape, rel=0.06)
    assert third.path == pytest.approx(every.path, rel=0.1)
    assert third == estimate_prior(exposures(large.hits[::3], large.path_lengths[::3]))


def test_a_lone_hit_is_not_sampled_away(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_MOST_CELLS", 10)
    found = estimate_prior(exposures(np.eye(1, 101, 50)[0], np.ones(101)))
    assert found.mean == pytest.approx(1 / 101, rel=0.01)


def test_without_hits_there_is_nothing_to_learn() -> None:
    for hits, path in [(0, 1.0), (0, 0.0), (1, 0.0)]:
        with pytest.raises(MapError, match="no cell was hit"):
            estimate_prior(exposures(np.full(5, hits), np.full(5, path)))
    with pytest.raises(MapError, match="unknown rule 'guessed'; choose 'marginal' or 'published'"):
        estimate_prior(simulated(1, 1, 50), "guessed")  # type: ignore[arg-type]


@pytest.mark.parametrize(("shape", "path"), [(0, 1), (1, 0), (-1, 1), (np.nan, 1), (1, np.inf)])
def test_a_prior_has_two_positive_numbers(shape: float, path: float) -> None:
    with pytest.raises(MapError, match="expected two positive numbers"):
        GammaPrior(shape, path)
