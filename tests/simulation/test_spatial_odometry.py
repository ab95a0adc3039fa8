import numpy as np
import pytest

from factorloc.errors import GeometryError, SimulationError
from factorloc.geometry import se3
from factorloc.simulation import OdometryNoise, SpatialOdometryNoise

NOISE = SpatialOdometryNoise(OdometryNoise(0.01**2, 0.004**2, 0.02**2, 0.01**2), height_walk=0.02, tilt_walk=0.003)
MOTION = se3.exp([0.05, -0.08, 0.4, 2.0, 0.3, -0.15])


def pairs(count, motion=MOTION):
    start = se3.exp([0.1, 0.05, 1.0, 5.0, -3.0, 0.4])
    poses = np.tile(start, (2 * count, 1, 1))
    poses[1::2] = start @ motion
    return poses


def test_perfect_odometry_is_the_truth():
    poses = se3.exp(0.3 * np.random.default_rng(1).standard_normal((20, 6)))
    motions, covariances = SpatialOdometryNoise.none().sample(poses, np.random.default_rng(0))
    assert motions == pytest.approx(se3.between(poses[:-1], poses[1:]), abs=1e-12)
    assert np.linalg.eigvalsh(covariances).min() > 0


def test_covariances_are_those_of_the_errors():
    motions, covariances = NOISE.sample(pairs(40_000), np.random.default_rng(2))
    errors = se3.log(se3.between(MOTION, motions[::2]))
    stated = covariances[0]
    # Whitened, the errors have the unit matrix for their covariance; to first order in deviations of some 0.05.
    whitened = np.linalg.solve(np.linalg.cholesky(stated), errors.T)
    assert np.cov(whitened) == pytest.approx(np.eye(6), abs=0.03)
    assert (covariances[::2] == stated).all()


def test_no_motion_has_next_to_no_error():
    motions, covariances = NOISE.sample(np.tile(np.eye(4), (3, 1, 1)), np.random.default_rng(0))
    assert motions == pytest.approx(np.tile(np.eye(4), (2, 1, 1)))
    assert covariances == pytest.approx(np.tile(1e-12 * np.eye(6), (2, 1, 1)))


def test_a_longer_way_has_more_of_it():
    short, long = (NOISE.sample(pairs(1, se3.exp([0, 0, 0, x, 0, 0])), np.random.default_rng(0))[1][0] for x in (1, 4))
    assert long[5, 5] == pytest.approx(4 * short[5, 5])
    assert long[0, 0] == pytest.approx(4 * short[0, 0])


@pytest.mark.parametrize("name", ["height_walk", "tilt_walk"])
def test_bad_settings_are_refused(name):
    with pytest.raises(SimulationError, match=name):
        SpatialOdometryNoise(**{name: -1.0})


def test_planar_poses_are_refused():
    with pytest.raises(GeometryError, match="4 x 4"):
        NOISE.sample(np.zeros((5, 3)), np.random.default_rng(0))
