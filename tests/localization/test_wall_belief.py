"""Beliefs among facades: motions, and errors of the map that all scans share."""

import numpy as np
import pytest
from facade_street import SHIFT, VERTEX, crossing, points_on
from hypothesis import given
from hypothesis import strategies as st
from test_facade_localization import facing, line_of

from factorloc.factors import PosePrior
from factorloc.geometry import se2
from factorloc.localization.bounded_least_squares import estimate_in_bounds
from factorloc.localization.correspondences import find_correspondences
from factorloc.localization.least_squares_settings import LeastSquaresSettings
from factorloc.localization.line_gate import line_residuals, lines_expected
from factorloc.localization.wall_belief import WallBelief
from factorloc.localization.wall_lines import WallLines
from factorloc.localization.wall_problem import WallProblem
from factorloc.result import Bounds


def some_belief(rng, buildings=(1, 4), facades=(2, 3, 7)):
    size = 3 + 2 * len(buildings) + 2 * len(facades)
    A = rng.normal(size=(size, size))
    return WallBelief(
        rng.uniform(-2, 2, 3), np.array(buildings), np.array(facades), rng.normal(0, 0.1, size - 3),
        0.01 * (A @ A.T + size * np.eye(size)),
    )  # fmt: skip


@given(st.integers(0, 2**31))
def test_moved_covariance_is_that_of_the_linearized_motion(seed):
    rng = np.random.default_rng(seed)
    belief, motion = some_belief(rng), rng.normal(0, 1, 3)
    sigmas = np.array([0.05, 0.02, 0.01])
    after = belief.moved(motion, sigmas)

    def composed(state, noise):
        return np.concatenate([se2.compose(state[:3], motion + noise), state[3:]])

    state = np.concatenate([belief.pose, belief.errors])
    step = 1e-6

    def column(k):
        d = np.zeros(len(state) + 3)
        d[k] = step
        high, low = composed(state + d[3:], d[:3]), composed(state - d[3:], -d[:3])
        change = high - low
        change[2] = np.arctan2(np.sin(change[2]), np.cos(change[2]))
        return change / (2 * step)

    J = np.stack([column(k) for k in range(len(state) + 3)], 1)
    expected = J[:, 3:] @ belief.covariance @ J[:, 3:].T + J[:, :3] @ np.diag(sigmas**2) @ J[:, :3].T
    np.testing.assert_allclose(after.covariance, expected, atol=1e-6)
    np.testing.assert_allclose(after.pose, se2.compose(belief.pose, motion))


def test_what_is_forgotten_changes_nothing_else():
    belief = some_belief(np.random.default_rng(0))
    less = belief.limited_to(np.array([4, 9]), np.array([2, 7]))
    np.testing.assert_array_equal(less.buildings, [4])
    np.testing.assert_array_equal(less.facades, [2, 7])
    # x, y, theta, shift of 4, offsets of 2 and 7, turns of them.
    rows = np.array([0, 1, 2, 5, 6, 7, 9, 10, 12])
    np.testing.assert_array_equal(less.covariance, belief.covariance[np.ix_(rows, rows)])
    np.testing.assert_array_equal(less.errors, belief.errors[rows[3:] - 3])


def test_a_prior_comes_back_in_the_frame_of_the_body():
    prior = PosePrior(np.array([1.0, 2.0, 0.8]), np.array([[0.4, 0.1, 0.0], [0.1, 0.2, 0.02], [0.0, 0.02, 0.05]]))
    np.testing.assert_allclose(WallBelief.from_prior(prior).pose_covariance, prior.covariance, atol=1e-15)


@given(st.integers(0, 2**31))
def test_gradient_of_the_wall_problem_is_that_of_its_cost(seed):
    rng = np.random.default_rng(seed)
    facades, true = crossing(rng)
    walls, pose = WallLines(facades), np.array([0.3, -0.2, 0.4])
    rows = facing(walls, pose)[:4]
    points, of = points_on(true, rows, pose, rng)
    prior = some_belief(rng, np.unique(facades.buildings[rows])[:2], rows[:2])
    problem = WallProblem(
        points.points,
        of,
        walls,
        pose,
        prior,
        point_sigma=0.1,
        robust=1e6,
        weight=0.2,
        map_sigmas=(0.25, 0.5),
        surface=0.05,
    )
    at, errors = pose + rng.normal(0, 0.01, 3), rng.normal(0, 0.02, problem.unknowns)
    g = problem.linearize(at, errors)[1]
    for k in range(3 + problem.unknowns):
        d = np.zeros(3 + problem.unknowns)
        d[k] = 1e-6
        slope = problem.cost(at + d[:3], errors + d[3:]) - problem.cost(at - d[:3], errors - d[3:])
        assert slope / 2e-6 == pytest.approx(g[k], rel=1e-4, abs=1e-2)


def test_many_scans_of_the_same_walls_are_not_many_walls():
    """Standing still, a hundred scans tell no more of the pose than the shifts of the buildings let through."""
    rng = np.random.default_rng(3)
    facades, true = crossing(rng)
    walls, pose = WallLines(facades), np.array([0.3, -0.2, 0.1])
    start = Bounds.around(pose, 4.0, np.radians(4.0))
    settings = LeastSquaresSettings()
    belief, spreads = WallBelief.within_bounds(start, pose), []
    for _ in range(30):
        points = points_on(true, facing(walls, pose), pose, rng)[0]
        found = find_correspondences(points, walls, start)
        estimate = estimate_in_bounds(points, found, walls, belief.pose, start, prior=belief, settings=settings)
        belief = estimate.belief
        spreads.append(np.sqrt(np.diag(belief.covariance)[:2]))
    count = len({int(facades.buildings[one.facade]) for one in found.found})
    assert (spreads[-1] > 0.5 * settings.shift_sigma * SHIFT / np.sqrt(count)).all()
    assert (spreads[-1] > 0.6 * spreads[0]).all()
    error = belief.pose - pose
    assert (np.abs(error[:2]) < 4 * spreads[-1]).all()
    assert VERTEX < 1.0


def test_lines_are_expected_where_a_belief_has_them():
    rng = np.random.default_rng(5)
    facades, true = crossing(rng)
    walls, pose = WallLines(facades), np.array([0.3, -0.2, 0.1])
    found = [line_of(walls, true, row, pose) for row in facing(walls, pose)[:5]]
    settings = LeastSquaresSettings()
    sure = WallBelief.of_pose(pose, np.diag([0.05, 0.05, 0.005]) ** 2)
    away, variance = line_residuals(found, walls, sure, settings)
    assert (away**2 < 16.0 * variance).all()
    # The shift of a building that is not known yet is part of the variance.
    assert (variance > (0.9 * settings.shift_sigma * SHIFT) ** 2).all()
    assert lines_expected(found, walls, sure, settings).all()
    wrong = WallBelief.of_pose(pose + np.array([30.0, 0.0, 0.0]), np.diag([0.05, 0.05, 0.005]) ** 2)
    across = np.array([abs(walls.normals[one.facade][0]) > 0.9 for one in found])
    assert not lines_expected(found, walls, wrong, settings)[across].any()
