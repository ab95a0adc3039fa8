from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

from factorloc.errors import EvaluationError
from factorloc.evaluation import align, transform_trajectory
from factorloc.geometry import se2, se3
from factorloc.trajectory import Trajectory

GROUPS = {2: (se2, 3), 3: (se3, 6)}


@pytest.mark.parametrize("dimension", [2, 3])
@given(seed=st.integers(0, 10**6), offset=st.sampled_from([1.0, 1e3, 1e6]))
def test_a_rigid_motion_is_recovered(drive, dimension, seed, offset):
    group, freedom = GROUPS[dimension]
    _, truth = drive(dimension, poses=30, seed=seed)
    T = group.exp(np.random.default_rng(seed).normal(0, 1, freedom) * ([1] * freedom))
    T = group.compose(T, group.exp(np.r_[[0] * (freedom - 3), [offset, -offset, 0]]))
    moved = transform_trajectory(group.inverse(T), truth, "odom")
    np.testing.assert_allclose(
        group.log(group.between(T, align(moved, truth))), np.zeros(freedom), atol=1e-9 * offset + 1e-9
    )


@pytest.mark.parametrize("dimension", [2, 3])
def test_no_other_motion_fits_better(drive, dimension):
    group, freedom = GROUPS[dimension]
    estimate, truth = drive(dimension, noise=0.5)

    def squared(xi):
        moved = group.compose(group.compose(T, group.exp(xi)), estimate.poses)
        return float(((Trajectory(truth.stamps, moved).positions - truth.positions) ** 2).sum())

    T = align(estimate, truth)
    best = minimize(squared, np.zeros(freedom), tol=1e-12)
    assert squared(np.zeros(freedom)) <= best.fun * (1 + 1e-9)
    np.testing.assert_allclose(best.x, 0, atol=1e-4)


def test_spatial_alignment_is_never_a_reflection():
    points = np.random.default_rng(3).normal(size=(20, 3))
    poses, mirrored = se3.identity((20,)), se3.identity((20,))
    poses[:, :3, 3], mirrored[:, :3, 3] = points, points * [1, 1, -1]
    T = align(Trajectory(np.arange(20), mirrored), Trajectory(np.arange(20), poses))
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1)


def test_covariances_and_stamps_stay(drive):
    estimate, _ = drive(2)
    estimate = replace(estimate, covariances=np.broadcast_to(np.eye(3), (len(estimate), 3, 3)))
    moved = transform_trajectory(np.array([1.0, 2.0, 3.0]), estimate, "utm")
    assert moved.world == "utm"
    np.testing.assert_array_equal(moved.covariances, estimate.covariances)
    np.testing.assert_array_equal(moved.stamps, estimate.stamps)


@pytest.mark.parametrize("offset", [0.0, 5e6])
def test_one_spot_is_not_enough(offset):
    still = Trajectory(np.arange(3), np.full((3, 3), [offset, offset / 3, 0.0]))
    with pytest.raises(EvaluationError, match="one spot"):
        align(still, still)


def test_unrelated_paths_are_not_enough():
    square = Trajectory(np.arange(4), [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
    there_and_back = Trajectory(np.arange(4), [[1, 0, 0], [-1, 0, 0], [1, 0, 0], [-1, 0, 0]])
    with pytest.raises(EvaluationError, match="unrelated"):
        align(square, there_and_back)


def test_a_line_is_enough_in_the_plane_but_not_in_space():
    line = Trajectory(np.arange(5), np.column_stack([np.arange(5), 2 * np.arange(5), np.zeros(5)]))
    np.testing.assert_allclose(align(line, line), 0, atol=1e-12)
    with pytest.raises(EvaluationError, match="one line"):
        align(line.to_3d(), line.to_3d())
