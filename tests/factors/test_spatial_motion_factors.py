"""Priors, odometry and gtsam's native factors in SE(3): errors equal our own."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import X
from hypothesis import given
from hypothesis import strategies as st
from strategies import floats, poses_2d, poses_3d, tangents_3d

from factorloc.errors import GeometryError
from factorloc.factors import OdometryNoise, PosePrior, odometry_factors
from factorloc.factors.native import between_factor, native_pose, pose_array, pose_values, prior_factor
from factorloc.factors.odometry import motion_covariances
from factorloc.geometry import se2, se3

NOISE = OdometryNoise()
ROOT = np.random.default_rng(1).uniform(-0.2, 0.2, (6, 6)) + np.diag([0.3, 0.4, 0.5, 1.0, 0.8, 0.6])
COVARIANCE = ROOT @ ROOT.T
PLANE = [3, 4, 2]  # where x, y and heading stand


def half_mahalanobis(offset: np.ndarray, covariance: np.ndarray) -> float:
    return float(0.5 * offset @ np.linalg.solve(covariance, offset))


# ---- priors ----


@given(poses_3d(), tangents_3d(3.0))
def test_the_error_of_a_prior_is_half_the_squared_mahalanobis_distance_in_the_body_frame(pose, offset) -> None:
    prior = PosePrior(pose, COVARIANCE)
    values = pose_values([3], se3.compose(pose, se3.exp(offset))[None])
    assert prior.factor(3).error(values) == pytest.approx(half_mahalanobis(offset, COVARIANCE), rel=1e-6, abs=1e-6)


@given(poses_3d())
def test_a_prior_of_sigmas_in_space_is_round(pose) -> None:
    prior = PosePrior.from_sigmas(pose, 0.5, 0.1)
    assert (prior.dimension, prior.pose.shape) == (3, (4, 4))
    assert prior.position == pytest.approx(pose[:3, 3])
    assert prior.covariance == pytest.approx(np.diag([0.01] * 3 + [0.25] * 3))
    assert prior.information == pytest.approx(np.diag([100] * 3 + [4] * 3))


@pytest.mark.parametrize(
    ("pose", "covariance", "line"),
    [
        (np.eye(4), np.eye(3), "6 x 6"),
        (np.zeros(3), np.eye(6), "3 x 3"),
        (np.eye(4), np.diag([1, 1, 1, 1, 1, 0]), "not positive definite"),
        (np.eye(4), np.triu(np.ones((6, 6))), "symmetric"),
        (np.eye(4), np.full((6, 6), np.nan), "finite"),
        (np.diag([1, 1, 2, 1]), np.eye(6), "no rigid motions"),
        (np.diag([1, 1, -1, 1]), np.eye(6), "no rigid motions"),
        (np.full((4, 4), np.nan), np.eye(6), "prior pose"),
        (np.eye(4)[None], np.eye(6), "prior pose"),
        (np.eye(3), np.eye(6), "prior pose"),
    ],
)
def test_what_is_no_prior_in_space_is_refused(pose, covariance, line) -> None:
    with pytest.raises(GeometryError, match=line):
        PosePrior(pose, covariance)


# ---- values ----


@given(st.lists(poses_3d(), min_size=1, max_size=5))
def test_poses_in_space_come_back_from_values(poses) -> None:
    keys = [X(k) for k in range(len(poses))][::-1]
    values = pose_values(keys, np.array(poses))
    assert isinstance(values.atPose3(keys[0]), gtsam.Pose3)
    back = pose_array(values)
    assert back.flags.c_contiguous
    assert back == pytest.approx(np.array(poses)[::-1], abs=1e-12), "in order of their keys"
    assert pose_array(values, keys[:1]) == pytest.approx(np.array(poses)[:1], abs=1e-12)


def test_planar_poses_come_back_from_values_as_well() -> None:
    poses = np.array([[1.0, 2.0, 0.5], [0.0, -1.0, -3.0]])
    values = pose_values([7, 9], poses)
    assert pose_array(values) == pytest.approx(poses)
    assert pose_array(values, [9]) == pytest.approx(poses[1:])
    assert pose_array(gtsam.Values()).shape[0] == 0


@given(poses_3d(), poses_3d(), tangents_3d(3.0))
def test_native_factors_measure_as_we_do(first, motion, slip) -> None:
    model = gtsam.noiseModel.Gaussian.Covariance(COVARIANCE)
    second = se3.compose(se3.compose(first, motion), se3.exp(slip))
    values = pose_values([0, 1], np.stack([first, second]))
    expected = pytest.approx(half_mahalanobis(slip, COVARIANCE), rel=1e-5, abs=1e-6)
    assert between_factor(0, 1, motion, model).error(values) == expected
    assert prior_factor(1, se3.compose(first, motion), model).error(values) == expected
    assert native_pose(first).matrix() == pytest.approx(first, abs=1e-12)


# ---- odometry ----


@given(tangents_3d(2.0), floats(0, 1))
def test_covariances_in_space_are_positive_definite_and_those_of_the_projection(tangent, scale) -> None:
    motion = se3.exp(scale * tangent)
    (P,) = NOISE.covariances(motion[None])
    assert pytest.approx(P.T, rel=1e-12) == P
    assert np.linalg.eigvalsh(P).min() > 1e-6
    assert P[np.ix_(PLANE, PLANE)] == pytest.approx(NOISE.covariances(se3.to_se2(motion)[None])[0], rel=1e-12)
    others = [0, 1, 5]
    assert (P[np.ix_(others, PLANE)] == 0).all()
    length = np.linalg.norm(motion[:3, 3])
    tilt, heave = 0.02 + 0.1 * 0.1 * length, 0.04 + 0.1 * 0.1 * length
    assert P[np.ix_(others, others)] == pytest.approx(np.diag([tilt, tilt, heave]) ** 2)


@given(poses_2d())
def test_a_planar_motion_is_as_unsure_in_space_as_in_the_plane(motion) -> None:
    offset = np.array([0.03, -0.02, 0.01])
    planar, spatial = NOISE.covariances(motion[None])[0], NOISE.covariances(se3.from_se2(motion)[None])[0]
    lifted = se3.log(se3.from_se2(se2.exp(offset)))
    assert lifted[[0, 1, 5]] == pytest.approx(np.zeros(3), abs=1e-12)
    assert half_mahalanobis(lifted, spatial) == pytest.approx(half_mahalanobis(offset, planar), rel=1e-6)


SLIP = np.array([0.01, -0.02, 0.03, 0.02, -0.01, 0.015])
MOTION = se3.exp(np.array([[0.02, -0.01, 0.3, 0.8, 0.1, 0.05]]))


@pytest.mark.parametrize("scale", [0.2, 8.0])
@pytest.mark.parametrize("own", [False, True])
def test_the_error_of_a_spatial_factor_is_hubers_of_the_whitened_motion(scale, own) -> None:
    given_covariances = 1e-3 * COVARIANCE[None] if own else None
    covariance = NOISE.covariances(MOTION)[0] if given_covariances is None else given_covariances[0]
    start = se3.exp(np.array([0.3, -2.0, 0.5, 3.0, -2.0, 2.5]))
    ahead = se3.compose(start, MOTION[0])
    (factor,) = odometry_factors([0, 1], MOTION, NOISE, covariances=given_covariances)
    d = np.sqrt(2 * half_mahalanobis(scale * SLIP, covariance))
    assert (d > NOISE.huber) == (scale > 1)
    expected = 0.5 * d**2 if d <= NOISE.huber else NOISE.huber * (d - 0.5 * NOISE.huber)
    slipped = se3.compose(ahead, se3.exp(scale * SLIP))
    assert factor.error(pose_values([0, 1], np.stack([start, slipped]))) == pytest.approx(expected, rel=1e-8)
    assert factor.error(pose_values([0, 1], np.stack([start, ahead]))) == pytest.approx(0, abs=1e-15)


def test_spatial_factors_join_neighbours_and_skip_what_was_not_measured() -> None:
    motions = se3.exp(np.column_stack([np.zeros((3, 3)), [0.5, 0.4, 0.3], np.zeros((3, 2))]))
    factors = list(odometry_factors([4, 5, 7, 8], motions, NOISE, [True, False, True]))
    assert [list(f.keys()) for f in factors] == [[4, 5], [7, 8]]
    assert [f.measured().x() for f in factors] == pytest.approx([0.5, 0.3])
    assert list(odometry_factors([0], np.zeros((0, 4, 4)), NOISE)) == []


def test_covariances_that_are_given_are_taken() -> None:
    given_covariances = np.stack([COVARIANCE, 2 * COVARIANCE])
    motions = np.concatenate([MOTION, MOTION])
    assert np.array_equal(motion_covariances(motions, NOISE, given_covariances), given_covariances)
    assert np.array_equal(motion_covariances(motions, NOISE), NOISE.covariances(motions))
    for wrong in (COVARIANCE, given_covariances[:1], given_covariances[:, :3, :3], np.full((2, 6, 6), np.inf)):
        with pytest.raises(GeometryError, match="expected a finite 6 x 6 matrix a motion"):
            motion_covariances(motions, NOISE, wrong)
    with pytest.raises(GeometryError, match="3 x 3"):
        motion_covariances(np.zeros((1, 3)), NOISE, COVARIANCE[None])


def test_what_is_no_motion_in_space_is_refused() -> None:
    with pytest.raises(GeometryError, match="1 between 3 poses; expected 2"):
        list(odometry_factors([0, 1, 2], MOTION, NOISE))
    with pytest.raises(GeometryError, match="no rigid motions"):
        list(odometry_factors([0, 1], 2 * MOTION, NOISE))
    with pytest.raises(GeometryError, match="known"):
        list(odometry_factors([0, 1], MOTION, NOISE, [True, True]))
