"""Particles keep normalized weights in the logarithmic domain."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from factorloc.errors import GeometryError
from factorloc.geometry import se3
from factorloc.localization.particles import Particles, log_sum_exp

LOGS = st.lists(st.floats(-2000, 2000), min_size=1, max_size=30)


@given(LOGS)
def test_weights_add_up_to_one_however_small_they_are(logs: list[float]) -> None:
    particles = Particles(np.zeros((len(logs), 3)), np.array(logs))
    assert particles.weights.sum() == pytest.approx(1)
    assert log_sum_exp(particles.log_weights) == pytest.approx(0, abs=1e-9)
    assert np.diff(particles.log_weights) == pytest.approx(np.diff(logs), abs=1e-9)
    assert 1 - 1e-9 <= particles.effective_size <= len(logs) + 1e-9
    assert particles.effective_size == pytest.approx(1 / (particles.weights**2).sum())


@given(LOGS, st.floats(-1e5, 1e5))
def test_the_mean_of_equal_factors_is_that_factor(logs: list[float], factor: float) -> None:
    particles = Particles(np.zeros((len(logs), 3)), np.array(logs))
    factors = np.full(len(logs), factor)
    assert particles.log_mean(factors) == pytest.approx(factor, rel=1e-9, abs=1e-9)
    assert particles.reweighted(factors).log_weights == pytest.approx(particles.log_weights, abs=1e-6)


def test_the_sum_of_exponentials_has_its_limits() -> None:
    assert log_sum_exp([]) == -np.inf
    assert log_sum_exp([-np.inf, -np.inf]) == -np.inf
    assert log_sum_exp([np.inf, 0.0]) == np.inf
    assert log_sum_exp([0.0, 0.0, -np.inf]) == pytest.approx(np.log(2))
    assert log_sum_exp([-1e6, -1e6]) == pytest.approx(-1e6 + np.log(2))


def test_particles_of_weight_zero_stay_without_copies() -> None:
    particles = Particles(np.arange(6.0).reshape(2, 3), np.array([0.0, -np.inf]))
    assert particles.weights.tolist() == [1, 0]
    assert particles.effective_size == pytest.approx(1)
    chosen = particles.select([0, 0, 0])
    assert chosen.weights == pytest.approx(np.full(3, 1 / 3))
    assert (chosen.poses == particles.poses[0]).all()


def test_each_particle_moves_in_its_own_frame() -> None:
    planar = Particles.uniform([[0, 0, 0], [1, 1, np.pi / 2]])
    assert planar.moved([2.0, 0, 0.5]).poses == pytest.approx(np.array([[2, 0, 0.5], [1, 3, np.pi / 2 + 0.5]]))
    spatial = Particles.uniform(se3.from_se2(planar.poses))
    moved = spatial.moved(se3.from_se2([2.0, 0, 0.5]))
    assert (planar.dimension, spatial.dimension) == (2, 3)
    assert moved.positions == pytest.approx(np.array([[2, 0, 0], [1, 3, 0.0]]))


@pytest.mark.parametrize(
    ("poses", "logs", "line"),
    [
        (np.zeros((0, 3)), np.zeros(0), "at least one"),
        (np.zeros(3), np.zeros(1), "at least one"),
        (np.zeros((2, 3)), np.zeros(3), "expected one for each of the 2"),
        (np.full((1, 3), np.nan), np.zeros(1), "NaN"),
        (np.zeros((2, 3)), np.array([0, np.nan]), "log_weights"),
        (np.zeros((2, 3)), np.array([0, np.inf]), "log_weights"),
        (np.zeros((2, 3)), np.full(2, -np.inf), "all weights zero"),
        (np.zeros((2, 4, 4)), np.zeros(2), "rigid"),
    ],
)
def test_what_is_no_belief_is_refused(poses: np.ndarray, logs: np.ndarray, line: str) -> None:
    with pytest.raises(GeometryError, match=line):
        Particles(poses, logs)
