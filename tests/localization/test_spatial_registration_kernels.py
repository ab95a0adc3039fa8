"""The small steps inside spatial registration equal their references by matrices."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from strategies import floats, poses_3d, tangents_3d

from factorloc.geometry import se3
from factorloc.localization._spatial_registration_kernels import (
    add_spatial_prior,
    copy_square,
    move_spatial,
    solve_damped_spatial,
)

matrices = arrays(np.float64, (6, 6), elements=floats(-10, 10))


@given(poses_3d(), tangents_3d(3.0), floats(0, 2))
def test_a_move_is_the_exponential_map(pose, step, scale) -> None:
    out = np.full((4, 4), np.nan)
    move_spatial(pose, step, scale, np.empty((3, 3)), out)
    expected = se3.compose(pose, se3.exp(scale * step))
    assert np.abs(out[:3, :3] - expected[:3, :3]).max() < 1e-11
    assert np.abs(out[:3, 3] - expected[:3, 3]).max() < 1e-8
    assert out[3].tolist() == [0, 0, 0, 1]


def test_many_moves_stay_rigid() -> None:
    rng = np.random.default_rng(1)
    pose, out = np.eye(4), np.empty((4, 4))
    for _ in range(500):
        move_spatial(pose, rng.normal(0, 0.2, 6), 1.0, np.empty((3, 3)), out)
        copy_square(out, pose)
    assert np.abs(pose[:3, :3] @ pose[:3, :3].T - np.eye(3)).max() < 1e-12


@given(matrices, arrays(np.float64, 6, elements=floats(-100, 100)), floats(0, 100))
def test_a_damped_step_solves_its_system(root, gradient, damping) -> None:
    H = root @ root.T + 0.1 * np.eye(6)
    step = np.empty(6)
    assert solve_damped_spatial(H, gradient, damping, np.empty((6, 6)), step)
    damped = H + damping * np.diag(np.diag(H)) + 1e-9 * np.eye(6)
    assert step == pytest.approx(np.linalg.solve(damped, -gradient), rel=1e-6, abs=1e-6)
    size = 1 + np.abs(gradient).max() + np.abs(damped).max() * np.abs(step).max()
    assert np.abs(damped @ step + gradient).max() <= 1e-11 * size


@given(st.integers(0, 5), floats(0.1, 10))
def test_a_system_that_is_not_positive_is_refused(axis, size) -> None:
    root, step = np.empty((6, 6)), np.empty(6)
    H = np.eye(6)
    H[axis, axis] = -size
    assert not solve_damped_spatial(H, np.ones(6), 0.0, root, step)
    H[axis, axis] = np.nan
    assert not solve_damped_spatial(H, np.ones(6), 0.0, root, step)
    indefinite = np.eye(6)
    i, j = axis, (axis + 1) % 6
    indefinite[i, j] = indefinite[j, i] = 1.0 + size
    assert not solve_damped_spatial(indefinite, np.ones(6), 0.0, root, step)
    assert solve_damped_spatial(indefinite, np.ones(6), 1.0 + 2 * size, root, step), "enough damping mends it"


def residual(pose: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """Rotation vector and translation, both in the frame of the mean."""
    moved = se3.between(mean, pose)
    return np.concatenate([se3.log(moved)[:3], moved[:3, 3]])


def with_prior(pose, mean, W) -> tuple[float, np.ndarray, np.ndarray]:
    gradient, hessian = np.zeros(6), np.zeros((6, 6))
    cost = add_spatial_prior(pose, mean, W, gradient, hessian, np.empty(6), np.empty((6, 6)))
    return cost, gradient, hessian


@given(poses_3d(), tangents_3d(3.1), matrices)
def test_a_prior_adds_its_cost(mean, offset, root) -> None:
    W = root @ root.T
    pose = se3.compose(mean, se3.exp(offset))
    r = residual(pose, mean)
    cost, gradient, hessian = with_prior(pose, mean, W)
    assert cost == pytest.approx(0.5 * r @ W @ r, rel=1e-6, abs=1e-6)
    assert np.abs(hessian - hessian.T).max() <= 1e-9 * (1 + np.abs(hessian).max())
    assert np.linalg.eigvalsh(hessian).min() >= -1e-9 * (1 + np.abs(hessian).max())
    # What is there already stays.
    g, H = np.arange(6.0), np.diag(np.arange(6.0))
    add_spatial_prior(pose, mean, W, g, H, np.empty(6), np.empty((6, 6)))
    assert g == pytest.approx(np.arange(6.0) + gradient, rel=1e-9, abs=1e-9)
    assert pytest.approx(np.diag(np.arange(6.0)) + hessian, rel=1e-9, abs=1e-9) == H


@given(poses_3d(), tangents_3d(0.3), matrices)
def test_derivatives_of_a_prior_are_those_of_its_cost(mean, offset, root) -> None:
    W = root @ root.T
    pose = se3.compose(mean, se3.exp(offset))
    _, gradient, hessian = with_prior(pose, mean, W)
    r, step = residual(pose, mean), 1e-5
    ahead, behind = (
        np.array([residual(se3.compose(pose, se3.exp(s * step * e)), mean) for e in np.eye(6)]) for s in (1, -1)
    )
    J = ((ahead - behind) / (2 * step)).T
    # Jacobians of the rotation are exact to first order in the angle; the next term is a twelfth of its square.
    angle = np.linalg.norm(r[:3])
    scale = np.abs(W).max() * 6
    slack = angle**2 / 12 + 1e-6
    assert np.abs(gradient - J.T @ W @ r).max() <= slack * scale * (1 + np.abs(r).sum())
    assert np.abs(hessian - J.T @ W @ J).max() <= 4 * slack * scale


@given(poses_3d(), matrices)
def test_at_its_mean_a_prior_pulls_nowhere(mean, root) -> None:
    W = root @ root.T
    cost, gradient, hessian = with_prior(mean, mean, W)
    assert cost == pytest.approx(0, abs=1e-9)
    assert gradient == pytest.approx(np.zeros(6), abs=1e-6)
    assert hessian == pytest.approx(W, rel=1e-6, abs=1e-6)


def test_half_a_turn_from_its_mean_is_as_far_as_can_be() -> None:
    for turn in (np.diag([1.0, -1, -1, 1]), np.diag([-1.0, -1, 1, 1])):
        cost, gradient, _ = with_prior(turn, np.eye(4), np.eye(6))
        assert np.isfinite(gradient).all()
        assert cost == pytest.approx(np.pi**2 / 2, rel=1e-6)
