"""Resampling is unbiased, and draws no more noise than its policy says."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from factorloc.localization.resampling import RESAMPLING, residual, stratified, systematic

WEIGHTS = st.lists(st.floats(0, 1), min_size=1, max_size=12).filter(lambda w: sum(w) > 1e-3)


def copies(policy, weights: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    return np.bincount(policy(weights, count, rng), minlength=len(weights))


@given(WEIGHTS, st.integers(1, 40), st.integers(0, 10**6))
def test_copies_stay_near_what_is_expected(raw: list[float], count: int, seed: int) -> None:
    weights = np.array(raw) / sum(raw)
    expected = count * weights
    for name, policy in RESAMPLING.items():
        drawn = policy(weights, count, np.random.default_rng(seed))
        assert drawn.shape == (count,)
        assert (weights[drawn] > 0).all()
        excess = np.abs(np.bincount(drawn, minlength=len(weights)) - expected)
        most = {"systematic": 1, "stratified": 2, "residual": 1, "multinomial": np.inf}[name]
        assert (excess < most + 1e-6).all(), name


@settings(max_examples=6)
@given(WEIGHTS, st.integers(1, 12), st.integers(0, 10**6))
def test_copies_are_as_many_as_expected_on_average(raw: list[float], count: int, seed: int) -> None:
    weights, rounds = np.array(raw) / sum(raw), 400
    rng = np.random.default_rng(seed)
    for policy in RESAMPLING.values():
        drawn = np.array([copies(policy, weights, count, rng) for _ in range(rounds)])
        # None has more variance than independent draws.
        error = np.sqrt(count * weights * (1 - weights) / rounds)
        assert (np.abs(drawn.mean(0) - count * weights) <= 5.5 * error + 1e-9).all()


def test_systematic_draws_have_the_least_variance() -> None:
    rng = np.random.default_rng(2)
    weights = rng.dirichlet(np.full(30, 0.5))
    variance = {
        name: np.array([copies(policy, weights, 30, rng) for _ in range(400)]).var(0).sum()
        for name, policy in RESAMPLING.items()
    }
    assert variance["systematic"] < variance["stratified"] < variance["multinomial"]
    assert variance["residual"] < variance["multinomial"]


def test_equal_weights_are_copied_once_each() -> None:
    for policy in (systematic, stratified, residual):
        assert policy(np.full(64, 1 / 64), 64, np.random.default_rng(1)).tolist() == list(range(64))


@pytest.mark.parametrize("policy", RESAMPLING.values(), ids=RESAMPLING)
def test_the_number_may_change_and_may_be_none(policy) -> None:
    weights = np.array([0.2, 0.0, 0.8])
    rng = np.random.default_rng(3)
    assert copies(policy, weights, 10_000, rng) == pytest.approx([2000, 0, 8000], abs=200)
    assert len(policy(weights, 0, rng)) == 0
    assert policy(np.array([1.0]), 1, rng).tolist() == [0]


def test_weights_that_round_short_of_one_draw_no_index_beyond() -> None:
    class AlmostOne(np.random.Generator):
        def random(self, size=None):  # type: ignore[override]
            return np.full(size, np.nextafter(1, 0)) if size else np.nextafter(1, 0)

    rng = AlmostOne(np.random.PCG64(1))
    weights = np.append(np.full(10, 0.1), 0.0)
    for policy in RESAMPLING.values():
        assert policy(weights, 7, rng).max() == 9
