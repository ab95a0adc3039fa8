"""Graphs with feasible sets: never left, in the plane and in space, and optimal within."""

import gtsam
import numpy as np
import pytest
from scipy.optimize import minimize

from factorloc.errors import OptimizationError
from factorloc.geometry import se3
from factorloc.localization.optimizer import OptimizerSettings, optimize
from factorloc.result import Bounds

SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
# Steps curve on the group: under a strong pull the way along a border is found slowly.
TIGHT = OptimizerSettings(max_iterations=400, relative_tolerance=1e-12, absolute_tolerance=1e-12)


def pulled(target, sigma=0.5):
    """A single pose that a prior pulls out of its set."""
    graph = gtsam.NonlinearFactorGraph()
    if len(target) == 3:
        noise = gtsam.noiseModel.Isotropic.Sigma(3, sigma)
        graph.push_back(gtsam.PriorFactorPose2(1, gtsam.Pose2(*target), noise))
    else:
        noise = gtsam.noiseModel.Isotropic.Sigma(6, sigma)
        graph.push_back(gtsam.PriorFactorPose3(1, gtsam.Pose3(target), noise))
    return graph


def cost_at(graph, pose):
    values = gtsam.Values()
    values.insert(1, pose)
    return graph.error(values)


def test_a_pose_slides_along_its_border_to_the_nearest_point():
    values = gtsam.Values()
    values.insert(1, gtsam.Pose2(0.9, -0.9, 0.0))
    graph, bounds = pulled([3.0, 0.6, 0.0]), Bounds((-0.5, 0.5), (SQUARE,))
    found = optimize(graph, values, settings=TIGHT, bounds={1: bounds})
    pose = found.values.atPose2(1)
    assert bounds.contains([pose.x(), pose.y(), pose.theta()])
    # A turn makes the way to the target no shorter; the nearest point of the border is the best.
    assert found.cost <= 1.02 * cost_at(graph, gtsam.Pose2(1.0, 0.6, 0.0))
    assert abs(pose.x() - 1.0) < 1e-4


def test_a_corner_and_a_heading_bound_hold_together():
    values = gtsam.Values()
    values.insert(1, gtsam.Pose2(0.0, 0.0, 0.0))
    bounds = Bounds((-0.1, 0.1), (SQUARE,))
    pose = optimize(pulled([4.0, 5.0, 0.4]), values, settings=TIGHT, bounds={1: bounds}).values.atPose2(1)
    assert bounds.contains([pose.x(), pose.y(), pose.theta()])
    np.testing.assert_allclose([pose.x(), pose.y(), pose.theta()], [1.0, 1.0, 0.1], atol=1e-4)


def test_in_space_position_and_yaw_are_bounded_and_the_rest_is_free():
    values = gtsam.Values()
    values.insert(1, gtsam.Pose3(se3.from_se2(np.zeros(3))))
    target = se3.exp(np.array([0.05, -0.1, 0.4, 0.0, 0.0, 0.0]))
    target[:3, 3] = [3.0, 0.5, 2.0]
    bounds = Bounds((-0.1, 0.1), (SQUARE,))
    graph = pulled(target)
    found = optimize(graph, values, settings=TIGHT, bounds={1: bounds})
    T = found.values.atPose3(1).matrix()
    yaw = np.arctan2(T[1, 0], T[0, 0])
    assert bounds.contains([T[0, 3], T[1, 3], yaw])
    np.testing.assert_allclose([T[0, 3], yaw], [1.0, 0.1], atol=1e-3)
    np.testing.assert_allclose(T[1:3, 3], [0.5, 2.0], atol=0.1)
    # No pose with the same roll and pitch, moved or turned into the set, is better.
    for turn in (0.1, 0.05):
        other = se3.compose(se3.from_se2([0.0, 0.0, turn]), se3.exp(np.array([0.05, -0.1, 0.0, 0.0, 0.0, 0.0])))
        other[:3, 3] = [1.0, 0.5, 2.0]
        assert found.cost <= 1.02 * cost_at(graph, gtsam.Pose3(other))


def test_a_chain_with_active_bounds_is_optimal():
    """Odometry that drifts, with corridors around the truth; scipy minimizes the same over the same sets."""
    rng = np.random.default_rng(3)
    count = 12
    truth = np.column_stack([np.arange(count, dtype=float), np.zeros(count), np.zeros(count)])
    sigmas = np.array([0.1, 0.1, 0.03])
    motions = np.diff(truth, axis=0) + rng.normal(0, 1, (count - 1, 3)) * sigmas + [0.0, 0.06, 0.02]
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    noise = gtsam.noiseModel.Diagonal.Sigmas(sigmas)
    graph.push_back(gtsam.PriorFactorPose2(0, gtsam.Pose2(), gtsam.noiseModel.Isotropic.Sigma(3, 0.01)))
    for k, motion in enumerate(motions):
        graph.push_back(gtsam.BetweenFactorPose2(k, k + 1, gtsam.Pose2(*motion), noise))
    for k in range(count):
        values.insert(k, gtsam.Pose2(*truth[k]))
    bounds = {k: Bounds.around(truth[k], 0.2, 0.1) for k in range(1, count)}
    found = optimize(graph, values, settings=TIGHT, bounds=bounds)
    poses = np.array([[p.x(), p.y(), p.theta()] for p in (found.values.atPose2(k) for k in range(count))])
    assert all(bounds[k].contains(poses[k]) for k in bounds)

    def cost(flat):
        given = gtsam.Values()
        for k, pose in enumerate(flat.reshape(-1, 3)):
            given.insert(k, gtsam.Pose2(*pose))
        return graph.error(given)

    limits = [(None, None)] * 3
    for k in range(1, count):
        limits += [(t - r, t + r) for t, r in zip(truth[k], (0.2, 0.2, 0.1), strict=True)]
    reference = minimize(
        cost, truth.ravel(), method="L-BFGS-B", bounds=limits, options={"maxiter": 4000, "maxfun": 10**6}
    )
    free = optimize(graph, values, settings=TIGHT)
    assert found.cost > free.cost + 0.1  # bounds are active
    assert found.cost < reference.fun + 1e-2


def test_without_active_bounds_nothing_changes():
    values = gtsam.Values()
    values.insert(1, gtsam.Pose2(0.5, 0.0, 0.0))
    free = optimize(pulled([0.2, 0.1, 0.05]), values, settings=TIGHT)
    held = optimize(pulled([0.2, 0.1, 0.05]), values, settings=TIGHT, bounds={1: Bounds((-0.5, 0.5), (SQUARE,))})
    assert held.values.atPose2(1).equals(free.values.atPose2(1), 1e-12)


@pytest.mark.parametrize(
    ("bounds", "word"),
    [
        ({1: Bounds((-0.5, 0.5), ())}, "empty"),
        ({2: Bounds((-0.5, 0.5), (SQUARE,))}, "no pose"),
        ({1: Bounds((0.3, 0.5), (SQUARE,))}, "outside"),
    ],
)
def test_bounds_that_do_not_fit_get_one_line(bounds, word):
    values = gtsam.Values()
    values.insert(1, gtsam.Pose2(0.5, 0.0, 0.0))
    with pytest.raises(OptimizationError, match=word):
        optimize(pulled([0.2, 0.1, 0.05]), values, bounds=bounds)
