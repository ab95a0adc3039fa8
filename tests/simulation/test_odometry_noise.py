import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from factorloc.errors import GeometryError, SimulationError
from factorloc.geometry import se2, wrap
from factorloc.simulation import OdometryNoise, integrate_odometry

SAMPLES = 20_000

poses = arrays(np.float64, st.tuples(st.integers(1, 20), st.just(3)), elements=st.floats(-50, 50))


@given(poses)
def test_perfect_wheels_lead_to_the_truth(truth):
    increments = OdometryNoise.none().sample(truth, np.random.default_rng(0))
    assert increments.shape == (len(truth) - 1, 3)
    reckoned = integrate_odometry(truth[0], increments)
    assert reckoned[:, :2] == pytest.approx(truth[:, :2], abs=1e-9)
    assert wrap(reckoned[:, 2] - truth[:, 2]) == pytest.approx(np.zeros(len(truth)), abs=1e-9)


def sampled(noise: OdometryNoise, motion) -> np.ndarray:
    """Turn, line and turn of many measurements of one motion."""
    truth = np.zeros((2 * SAMPLES, 3))
    truth[1::2] = motion
    dx, dy, dtheta = noise.sample(truth, np.random.default_rng(2))[::2].T
    first = np.arctan2(dy, dx)
    return np.stack([first, np.hypot(dx, dy), wrap(dtheta - first)], -1)


def test_errors_are_unbiased_and_as_large_as_the_model_says():
    noise = OdometryNoise(alpha1=1e-3, alpha2=2e-4, alpha3=4e-4, alpha4=3e-4)
    first, line, second = 0.5, 1.2, -0.8
    end = [line * np.cos(first), line * np.sin(first), first + second]
    errors = sampled(noise, end) - [first, line, second]
    deviations = np.sqrt(
        [
            noise.alpha1 * first**2 + noise.alpha2 * line**2,
            noise.alpha3 * line**2 + noise.alpha4 * (first**2 + second**2),
            noise.alpha1 * second**2 + noise.alpha2 * line**2,
        ]
    )
    assert (abs(errors.mean(axis=0)) < 4 * deviations / np.sqrt(SAMPLES)).all()
    assert errors.std(axis=0) == pytest.approx(deviations, rel=0.03)
    assert abs(np.corrcoef(errors.T) - np.eye(3)).max() < 4 / np.sqrt(SAMPLES)


def test_backing_up_is_no_turn():
    noise = OdometryNoise(alpha1=1e-2, alpha2=0, alpha3=0, alpha4=1e-2)
    measured = noise.sample([[0, 0, 0], [-1, 0, 0]], np.random.default_rng(3))
    assert measured == pytest.approx(np.array([[-1, 0, 0]]), abs=1e-9)


def test_a_vehicle_at_rest_measures_nothing_and_a_turn_on_the_spot_only_turns():
    noise = OdometryNoise(alpha1=1e-3, alpha2=1, alpha3=1, alpha4=0)
    rng = np.random.default_rng(4)
    assert noise.sample(np.ones((5, 3)), rng) == pytest.approx(np.zeros((4, 3)))
    turns = noise.sample(np.tile([[0, 0, 0], [0, 0, 1.0]], (500, 1)), rng)[::2]
    assert abs(turns[:, :2]).max() == pytest.approx(0)
    assert turns[:, 2].std() == pytest.approx(np.sqrt(1e-3), rel=0.15)


def test_integration_composes_poses():
    increments = np.random.default_rng(5).normal(size=(10, 3))
    expected = [se2.as_poses([1, 2, 3])]
    for step in increments:
        expected.append(se2.compose(expected[-1], step))
    assert integrate_odometry([1, 2, 3], increments) == pytest.approx(np.array(expected))


def test_what_is_not_consistent_is_refused():
    with pytest.raises(SimulationError, match="alpha3"):
        OdometryNoise(alpha3=-1)
    with pytest.raises(GeometryError, match="increments"):
        integrate_odometry([0, 0, 0], [[1, 2]])
