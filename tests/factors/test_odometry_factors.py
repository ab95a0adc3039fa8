"""The odometry model: covariances by derivatives and by sampling, and robust factors of what was measured."""

import gtsam
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import angles, floats

from factorloc.errors import ConfigError, GeometryError
from factorloc.factors import OdometryNoise, odometry_factors
from factorloc.geometry import se2, wrap

NOISE = OdometryNoise(
    turn_per_turn=0.1,
    turn_per_metre=0.04,
    length_per_metre=0.06,
    length_per_turn=0.02,
    least_turn=0.01,
    least_length=0.02,
)

motions = st.tuples(floats(-2, 2), floats(-2, 2), angles()).map(np.array)
noises = st.builds(
    OdometryNoise,
    turn_per_turn=floats(0, 1),
    turn_per_metre=floats(0, 1),
    length_per_metre=floats(0, 1),
    length_per_turn=floats(0, 1),
    least_turn=floats(1e-3, 0.1),
    least_length=floats(1e-3, 0.1),
)


def decomposed(motion: np.ndarray, noise: OdometryNoise) -> np.ndarray:
    """Turn, signed length and turn of a motion; driven backwards where that takes less turning."""
    length = np.hypot(*motion[:2])
    if length <= noise.least_length:
        return np.array([0.0, length, wrap(motion[2])])
    first = np.arctan2(motion[1], motion[0])
    if abs(first) > np.pi / 2:
        first, length = wrap(first + np.pi), -length
    return np.array([first, length, wrap(motion[2] - first)])


def composed(parts: np.ndarray) -> np.ndarray:
    """The motion of turn, length and turn (..., 3)."""
    first, length, last = np.moveaxis(parts, -1, 0)
    return np.stack([length * np.cos(first), length * np.sin(first), first + last], -1)


def sigmas(parts: np.ndarray, noise: OdometryNoise) -> np.ndarray:
    first, length, last = np.abs(parts)
    turn = noise.turn_per_metre * length + noise.least_turn
    return np.array(
        [
            noise.turn_per_turn * first + turn,
            noise.length_per_metre * length + noise.length_per_turn * (first + last) + noise.least_length,
            noise.turn_per_turn * last + turn,
        ]
    )


def sideways(noise: OdometryNoise) -> np.ndarray:
    """What the model adds for slipping aside."""
    return np.diag([1.0, 1.0, 0.0]) * (0.5 * noise.least_length) ** 2


@given(motions, noises)
def test_covariances_are_symmetric_and_positive_definite(motion, noise) -> None:
    P = noise.covariances(motion[None])[0]
    assert pytest.approx(P.T, rel=1e-12) == P
    assert np.linalg.eigvalsh(P).min() > 1e-9 * min(noise.least_turn, noise.least_length) ** 2


@given(motions)
def test_covariances_follow_from_the_derivatives_of_the_three_parts(motion) -> None:
    length = np.hypot(*motion[:2])
    direction = np.arctan2(motion[1], motion[0])
    if abs(length - NOISE.least_length) < 1e-6 or abs(abs(direction) - np.pi / 2) < 1e-9:
        return  # just between two cases
    parts = decomposed(motion, NOISE)
    if length <= NOISE.least_length:
        # No direction: ahead, then turned; where it went is kept, not how it turned to get there.
        by_first = np.array([-motion[1], motion[0]])
        J = np.zeros((3, 3))
        J[:2, 0], J[:2, 1] = se2.rotate(-motion[2], by_first), se2.rotate(-motion[2], [1.0, 0.0])
        J[2] = [1, 0, 1]
    else:
        step = 1e-6
        offsets = np.concatenate([np.eye(3), -np.eye(3)]) * step
        after = se2.log(se2.between(composed(parts), composed(parts + offsets)))
        J = ((after[:3] - after[3:]) / (2 * step)).T
    expected = J @ np.diag(sigmas(parts, NOISE) ** 2) @ J.T + sideways(NOISE)
    assert NOISE.covariances(motion[None])[0] == pytest.approx(expected, rel=1e-5, abs=1e-9)


@pytest.mark.parametrize(
    "motion",
    [
        [0.5, 0.0, 0.0],
        [0.4, 0.1, 0.3],
        [0.3, -0.2, -0.9],
        [-0.5, 0.05, 0.1],  # backwards
        [-0.3, -0.2, -0.4],
        [0.0, 0.0, 0.0],  # standing still
        [0.0, 0.0, 1.2],  # turning on the spot
        [1.5, 0.5, 0.2],
    ],
)
def test_covariances_are_those_of_sampled_motions(motion) -> None:
    rng = np.random.default_rng(1)
    parts = decomposed(np.array(motion), NOISE)
    sampled = composed(parts + sigmas(parts, NOISE) * rng.standard_normal((200_000, 3)))
    tangent = se2.log(se2.between(np.array(motion), sampled))
    expected = np.cov(tangent.T) + sideways(NOISE)
    P = NOISE.covariances([motion])[0]
    scale = np.sqrt(np.diag(expected))
    assert (np.abs(P - expected) <= 0.05 * np.outer(scale, scale)).all()


def test_driving_backwards_is_as_sure_as_driving_ahead() -> None:
    ahead, back = NOISE.covariances([[0.5, 0.0, 0.0], [-0.5, 0.0, 0.0]])
    assert back == pytest.approx(ahead * np.array([[1, 1, -1], [1, 1, -1], [-1, -1, 1]]), abs=1e-15)
    assert ahead[1, 2] != 0


def test_covariances_do_not_jump_where_a_motion_begins_to_have_a_length() -> None:
    L = NOISE.least_length
    below, above = NOISE.covariances([[L * (1 - 1e-9), 0, 0.3], [L * (1 + 1e-9), 0, 0.3]])
    assert below == pytest.approx(above, rel=1e-6)


def test_a_longer_motion_is_less_sure() -> None:
    volume = [np.linalg.det(P) for P in NOISE.covariances([[0.1, 0, 0], [0.5, 0, 0], [0.5, 0, 0.5], [1.5, 0, 0.5]])]
    assert (np.diff(volume) > 0).all()


def values_at(poses) -> gtsam.Values:
    values = gtsam.Values()
    for key, pose in enumerate(poses):
        values.insert(key, gtsam.Pose2(*pose))
    return values


def test_factors_join_neighbours_and_skip_what_was_not_measured() -> None:
    motion = np.array([[0.5, 0, 0.1], [0, 0, 0], [0.4, 0.1, -0.2], [0.3, 0, 0]])
    factors = list(odometry_factors([4, 5, 7, 8, 9], motion, NOISE, [True, False, True, True]))
    assert [list(f.keys()) for f in factors] == [[4, 5], [7, 8], [8, 9]]
    assert [f.measured().x() for f in factors] == pytest.approx([0.5, 0.4, 0.3])
    assert len(list(odometry_factors(range(5), motion, NOISE))) == 4
    assert list(odometry_factors([0], np.zeros((0, 3)), NOISE)) == []


@pytest.mark.parametrize("scale", [0.5, 8.0])
def test_the_error_of_a_factor_is_hubers_of_the_whitened_motion(scale) -> None:
    motion = np.array([[0.4, 0.1, -0.2]])
    slip = scale * np.array([0.02, -0.01, 0.03])
    start = np.array([3.0, -2.0, 2.5])
    end = se2.compose(se2.compose(start, motion[0]), se2.exp(slip))
    (factor,) = odometry_factors([0, 1], motion, NOISE)
    d = np.sqrt(slip @ np.linalg.inv(NOISE.covariances(motion)[0]) @ slip)
    assert (d > NOISE.huber) == (scale > 1)
    expected = 0.5 * d**2 if d <= NOISE.huber else NOISE.huber * (d - 0.5 * NOISE.huber)
    assert factor.error(values_at([start, end])) == pytest.approx(expected, rel=1e-9)
    assert factor.error(values_at([start, se2.compose(start, motion[0])])) == pytest.approx(0, abs=1e-15)


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(GeometryError, match="2 between 2 poses; expected 1"):
        list(odometry_factors([0, 1], np.zeros((2, 3)), NOISE))
    for known in ([True], [True, True, True], [[True, True]]):
        with pytest.raises(GeometryError, match="known"):
            list(odometry_factors([0, 1, 2], np.zeros((2, 3)), NOISE, known))
    with pytest.raises(GeometryError, match="NaN"):
        list(odometry_factors([0, 1], [[np.nan, 0, 0]], NOISE))
    with pytest.raises(ConfigError, match="least_turn"):
        OdometryNoise(least_turn=0)
    with pytest.raises(ConfigError, match="turn_per_turn"):
        OdometryNoise(turn_per_turn=-0.1)
