"""Estimates of known mixtures of particles."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from strategies import poses_2d, poses_3d

from factorloc.geometry import circular_mean, group_of, se2, se3
from factorloc.localization.kld import PoseBins
from factorloc.localization.particle_estimates import ParticleEstimates, mean_pose
from factorloc.localization.particles import Particles

BINS = PoseBins(0.5, np.radians(10))


def cloud(pose, covariance, count: int, seed: int) -> np.ndarray:
    group = group_of(3 if np.ndim(pose) == 2 else 2)
    rng = np.random.default_rng(seed)
    return group.compose(pose, group.exp(rng.multivariate_normal(np.zeros(len(covariance)), covariance, count)))


@given(st.lists(poses_2d(), min_size=1, max_size=9))
def test_means_of_the_plane_are_arithmetic_and_circular(poses: list[np.ndarray]) -> None:
    array, n = np.array(poses), len(poses)
    found = mean_pose(array, np.full(n, 1 / n))
    assert found[:2] == pytest.approx(array[:, :2].mean(0), abs=1e-9)
    if np.hypot(np.cos(array[:, 2]).sum(), np.sin(array[:, 2]).sum()) > 1e-6:
        assert abs(se2.between([0, 0, circular_mean(array[:, 2])], [0, 0, found[2]])[2]) < 1e-6


@given(poses_3d(), st.integers(0, 1000))
def test_means_of_space_minimize_squared_angles(middle: np.ndarray, seed: int) -> None:
    rng = np.random.default_rng(seed)
    poses = se3.compose(middle, se3.exp(rng.uniform(-0.8, 0.8, (7, 6))))
    weights = rng.dirichlet(np.ones(7))
    found = mean_pose(poses, weights)
    assert found[:3, 3] == pytest.approx(weights @ poses[:, :3, 3])
    between = Rotation.from_matrix(found[:3, :3].T @ poses[:, :3, :3]).as_rotvec()
    assert weights @ between == pytest.approx(np.zeros(3), abs=1e-9)


def test_weights_shift_the_mean() -> None:
    poses = np.array([[0.0, 0, 3.0], [4.0, 2, -3.0]])
    assert mean_pose(poses, [0.25, 0.75])[:2] == pytest.approx([3, 1.5])
    assert mean_pose(poses, [0.5, 0.5])[2] == pytest.approx(np.pi)
    assert mean_pose(poses, [1.0, 0.0]) == pytest.approx(poses[0])
    spatial = se3.from_se2(poses)
    assert mean_pose(spatial, [1.0, 0.0]) == pytest.approx(spatial[0])
    assert mean_pose(spatial, [0.5, 0.5]) == pytest.approx(se3.from_se2([2, 1, np.pi]), abs=1e-9)


def test_headings_that_cancel_leave_that_of_the_heaviest() -> None:
    assert mean_pose([[0, 0, 0.0], [0, 0, np.pi]], [0.5, 0.5])[2] == 0
    turns = np.linspace(0, 2 * np.pi, 5)[:4]
    assert np.isfinite(mean_pose(se3.from_se2(np.column_stack([np.zeros((4, 2)), turns])), np.full(4, 0.25))).all()


@pytest.mark.parametrize("dimension", [2, 3])
def test_one_cloud_has_its_own_mean_and_covariance(dimension: int) -> None:
    size = 3 if dimension == 2 else 6
    root = np.random.default_rng(3).normal(0, 0.04, (size, size))
    pose = np.array([3.0, -1, 2.9]) if dimension == 2 else se3.exp([0.2, 0.1, 2.9, 3, -1, 0.5])
    found = ParticleEstimates.of(Particles.uniform(cloud(pose, root @ root.T, 20_000, 4)), BINS)
    group = group_of(dimension)
    for estimate in (found.mean, found.mode):
        assert group.log(group.between(pose, estimate.pose)) == pytest.approx(np.zeros(size), abs=0.01)
        assert estimate.covariance == pytest.approx(root @ root.T, abs=0.002)
    assert found.mean.mass == 1
    assert found.mode.mass > 0.99
    assert found.effective_size == pytest.approx(20_000)


def test_of_two_clouds_the_mode_is_the_denser_and_the_mean_is_between() -> None:
    narrow, wide = np.diag([0.1, 0.1, 0.03]) ** 2, np.diag([3.0, 3.0, 0.5]) ** 2
    poses = np.concatenate([cloud([0.0, 0, np.pi], narrow, 400, 1), cloud([20.0, 0, 0], wide, 600, 2)])
    found = ParticleEstimates.of(Particles.uniform(poses), BINS)
    assert found.mode.pose == pytest.approx([0, 0, np.pi], abs=0.03)
    assert found.mode.mass == pytest.approx(0.4, abs=0.02)
    assert found.mode.covariance == pytest.approx(narrow, abs=0.002)
    assert found.mean.pose[0] == pytest.approx(12, abs=0.5)
    assert found.mean.covariance.trace() > 90


def test_the_best_tenth_is_chosen_by_weight() -> None:
    poses = np.column_stack([np.arange(20.0), np.zeros((20, 2))])
    logs = np.full(20, -3.0)
    logs[[4, 6]] = np.log([3.0, 1.0])
    found = ParticleEstimates.of(Particles(poses, logs), BINS).best
    assert found.pose == pytest.approx([4.5, 0, 0])
    assert found.mass == pytest.approx(4 / (4 + 18 * np.exp(-3)))
    assert found.covariance[0, 0] == pytest.approx(0.75)


@pytest.mark.parametrize("pose", [np.array([1.0, 2, 3]), se3.from_se2([1.0, 2, 3])], ids=["plane", "space"])
def test_a_single_particle_is_its_own_estimate(pose: np.ndarray) -> None:
    found = ParticleEstimates.of(Particles.uniform(pose[None]), BINS)
    for estimate in (found.mean, found.best, found.mode):
        assert estimate.pose == pytest.approx(pose)
        assert estimate.covariance == pytest.approx(np.zeros((3, 3) if pose.ndim == 1 else (6, 6)), abs=1e-20)
        assert estimate.mass == pytest.approx(1)


def test_a_cluster_may_lie_across_the_turn_and_the_edges_of_bins() -> None:
    middle = cloud([0.0, 0, np.pi], np.diag([0.05, 0.05, 0.05]) ** 2, 300, 5)
    rival = cloud([10.25, 0.25, 0.09], np.diag([0.02, 0.02, 0.01]) ** 2, 200, 6)
    found = ParticleEstimates.of(Particles.uniform(np.concatenate([middle, rival])), BINS)
    assert found.mode.mass == pytest.approx(0.6)
    assert found.mode.pose[:2] == pytest.approx([0, 0], abs=0.02)
