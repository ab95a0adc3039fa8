"""The small steps inside registration equal their references by matrices."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from strategies import floats, poses_2d, tangents_2d

from factorloc.geometry import se2
from factorloc.localization._registration_kernels import add_prior, move, solve_damped

matrices = arrays(np.float64, (3, 3), elements=floats(-10, 10))


@given(poses_2d(), tangents_2d(1.0), floats(0, 2))
def test_a_move_is_the_exponential_map(pose, step, scale) -> None:
    out = np.empty(3)
    move(pose, step, scale, out)
    expected = se2.compose(pose, se2.exp(scale * step))
    assert np.abs(out[:2] - expected[:2]).max() < 1e-8
    assert abs(np.angle(np.exp(1j * (out[2] - expected[2])))) < 1e-12
    assert -np.pi <= out[2] <= np.pi


@given(matrices, arrays(np.float64, 3, elements=floats(-100, 100)), floats(0, 100))
def test_a_damped_step_solves_its_system(root, gradient, damping) -> None:
    H = root @ root.T + 0.1 * np.eye(3)
    step = np.empty(3)
    assert solve_damped(H, gradient, damping, step)
    damped = H + damping * np.diag(np.diag(H)) + 1e-9 * np.eye(3)
    assert np.abs(damped @ step + gradient).max() <= 1e-9 * (1 + np.abs(gradient).max() + np.abs(damped).max())


@given(st.integers(0, 2), floats(0.1, 10))
def test_a_system_that_is_not_positive_is_refused(axis, size) -> None:
    H = np.eye(3)
    H[axis, axis] = -size
    assert not solve_damped(H, np.ones(3), 0.0, np.empty(3))
    indefinite = np.eye(3)
    i, j = axis, (axis + 1) % 3
    indefinite[i, j] = indefinite[j, i] = 1.0 + size
    assert not solve_damped(indefinite, np.ones(3), 0.0, np.empty(3))
    assert solve_damped(indefinite, np.ones(3), 1.0 + 2 * size, np.empty(3)), "enough damping mends it"


@given(poses_2d(), poses_2d(), matrices)
def test_a_prior_adds_its_cost_and_derivatives(pose, mean, root) -> None:
    W = root @ root.T
    gradient, hessian = np.array([1.0, 2.0, 3.0]), np.diag([4.0, 5.0, 6.0])
    cost = add_prior(pose, mean, W, gradient, hessian)
    d = pose - mean
    d[2] = np.angle(np.exp(1j * d[2]))
    if abs(d[2]) > np.pi - 1e-6:
        return  # as far to the left as to the right
    assert cost >= -1e-9
    assert np.isclose(cost, 0.5 * d @ W @ d, rtol=1e-9, atol=1e-9)
    # The world moves by R of a step in the body frame.
    R = np.eye(3)
    R[:2, :2] = se2.rotation(pose[2])
    scale = 1e-12 * (1 + np.abs(W).max() * (1 + np.abs(d).max()))
    assert np.abs(gradient - [1, 2, 3] - R.T @ W @ d).max() <= scale
    assert np.abs(hessian - np.diag([4, 5, 6]) - R.T @ W @ R).max() <= scale
    assert (hessian == hessian.T).all()
