"""The optimizer ends where gtsam's own does, and says clearly where it cannot begin."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import X

from factorloc.errors import ConfigError, OptimizationError
from factorloc.factors import PosePrior, ScanCosts
from factorloc.factors.native import pose_array
from factorloc.geometry import se2
from factorloc.localization import OptimizerSettings, ScanFactors, optimize
from factorloc.result import StopReason

EXACT = OptimizerSettings(relative_tolerance=1e-13, absolute_tolerance=1e-13)


class PoseFixes:
    """A scan term of known minima: each scan is as good as a Gaussian belief of its pose."""

    information = 1.0
    blurs = (0.5, 0.0)

    def __init__(self, means: np.ndarray, information: np.ndarray) -> None:
        self.means, self.weight = means, information

    @property
    def scans(self) -> int:
        return len(self.means)

    def batch(self, poses, level=-1, scan_of_pose=None) -> ScanCosts:
        index = np.arange(self.scans) if scan_of_pose is None else np.asarray(scan_of_pose)
        mean = self.means[index]
        d = np.asarray(poses) - mean
        d[:, 2] = np.angle(np.exp(1j * d[:, 2]))
        R = np.zeros((len(d), 3, 3))
        R[:, :2, :2] = se2.rotation(np.asarray(poses)[:, 2])
        R[:, 2, 2] = 1
        W = self.weight / (1.0 + 10 * self.blurs[level])
        # Quadratic in the world's coordinates; derivatives by body steps.
        return ScanCosts(
            0.5 * np.einsum("ni,ij,nj->n", d, W, d), np.einsum("nji,jk,nk->ni", R, W, d), R.swapaxes(1, 2) @ W @ R
        )

    def cost(self, poses, level=-1, scan_of_pose=None) -> np.ndarray:
        return self.batch(poses, level, scan_of_pose).cost

    def least_cost(self, level=-1) -> np.ndarray:
        return np.zeros(self.scans)


def pose_graph(
    dimension: int, n: int, loops: int, prior: bool = True
) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """A noisy winding chain with loops, from dead reckoning."""
    rng = np.random.default_rng(dimension)
    Pose, Prior, Between = (
        (gtsam.Pose2, gtsam.PriorFactorPose2, gtsam.BetweenFactorPose2)
        if dimension == 2
        else (gtsam.Pose3, gtsam.PriorFactorPose3, gtsam.BetweenFactorPose3)
    )
    sigmas = np.array([0.05, 0.05, 0.02]) if dimension == 2 else np.array([0.02] * 3 + [0.05] * 3)
    noise = gtsam.noiseModel.Diagonal.Sigmas(sigmas)
    size = len(sigmas)
    steps = rng.normal(0, 0.15, (n - 1, size))
    steps[:, 0 if dimension == 2 else 3] += 0.5
    truth = [Pose()]
    for step in steps:
        truth.append(truth[-1].compose(Pose.Expmap(step)))
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    if prior:
        graph.push_back(Prior(X(0), truth[0], noise))
    pairs = [(k, k + 1) for k in range(n - 1)] + [tuple(sorted(rng.choice(n, 2, False))) for _ in range(loops)]
    reckoned = truth[0]
    values.insert(X(0), reckoned)
    for a, b in pairs:
        measured = truth[a].between(truth[b]).compose(Pose.Expmap(sigmas * rng.standard_normal(size)))
        graph.push_back(Between(X(a), X(b), measured, noise))
        if b == a + 1 and not values.exists(X(b)):
            reckoned = reckoned.compose(measured)
            values.insert(X(b), reckoned)
    return graph, values


@pytest.mark.parametrize(("dimension", "n"), [(2, 60), (2, 300), (3, 40), (3, 150)])
def test_a_pose_graph_ends_where_gtsam_ends(dimension, n) -> None:
    graph, values = pose_graph(dimension, n, n // 10)
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-14)
    parameters.setAbsoluteErrorTol(1e-14)
    theirs = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
    ours = optimize(graph, values, settings=EXACT)
    assert graph.error(values) > 1.5 * graph.error(theirs), "there was something to do"
    assert ours.cost == pytest.approx(graph.error(theirs), rel=1e-6)
    assert ours.cost == pytest.approx(graph.error(ours.values), rel=1e-12)
    assert ours.values.equals(theirs, 1e-4)
    assert ours.stop.converged
    assert ours.scan_costs is None


def test_the_cost_falls_with_every_step_and_every_step_is_told() -> None:
    graph, values = pose_graph(2, 80, 8)
    told = []
    found = optimize(graph, values, progress=told.append)
    assert tuple(told) == found.history
    costs = [graph.error(values)] + [step.cost for step in found.history]
    assert (np.diff(costs) <= 0).all()
    assert costs[-1] == found.cost
    assert all(step.trials >= 1 and step.level == 0.0 and step.damping >= 1e-4 for step in found.history)
    assert values.equals(pose_graph(2, 80, 8)[1], 0), "the start is left as it was"


def test_the_linear_graph_is_that_of_the_estimate() -> None:
    graph, values = pose_graph(2, 20, 3)
    found = optimize(graph, values, settings=EXACT)
    ours, theirs = gtsam.Marginals(found.linear, found.values), gtsam.Marginals(graph, found.values)
    for key in (X(0), X(7), X(19)):
        assert ours.marginalCovariance(key) == pytest.approx(theirs.marginalCovariance(key))


def fixed_drive(n: int = 30):
    """Motions and fixes that disagree a little, in one place by much."""
    rng = np.random.default_rng(8)
    motions = np.tile([0.5, 0.0, 0.15], (n - 1, 1))
    poses = [np.zeros(3)]
    for motion in motions:
        poses.append(se2.compose(poses[-1], motion))
    means = np.array(poses) + rng.normal(0, 0.1, (n, 3))
    return motions, means, np.diag([30.0, 50.0, 80.0])


def motion_graph(motions: np.ndarray) -> gtsam.NonlinearFactorGraph:
    graph = gtsam.NonlinearFactorGraph()
    noise = gtsam.noiseModel.Diagonal.Sigmas([0.05, 0.03, 0.02])
    for k, motion in enumerate(motions):
        graph.push_back(gtsam.BetweenFactorPose2(X(k), X(k + 1), gtsam.Pose2(*motion), noise))
    return graph


def values_of(poses: np.ndarray) -> gtsam.Values:
    values = gtsam.Values()
    for k, pose in enumerate(poses):
        values.insert(X(k), gtsam.Pose2(*pose))
    return values


def test_scans_weigh_in_as_much_as_equal_native_factors() -> None:
    motions, means, W = fixed_drive()
    n = len(means)
    graph = motion_graph(motions)
    ours = optimize(graph, values_of(means), ScanFactors(PoseFixes(means, W), [X(k) for k in range(n)]), settings=EXACT)
    native = gtsam.NonlinearFactorGraph(graph)
    for k, mean in enumerate(means):
        # The fixes are quadratic in the world; a prior is so in its own frame.
        turn = np.eye(3)
        turn[:2, :2] = se2.rotation(mean[2])
        native.push_back(PosePrior(mean, np.linalg.inv(turn.T @ W @ turn)).factor(X(k)))
    theirs = gtsam.LevenbergMarquardtOptimizer(native, values_of(means)).optimize()
    # exp bends a prior a little where the heading is off: equal to that.
    assert np.abs(pose_array(ours.values) - pose_array(theirs)).max() < 5e-3
    assert ours.cost == pytest.approx(native.error(theirs), rel=0.02)
    assert ours.cost == pytest.approx(graph.error(ours.values) + ours.scan_costs.cost.sum(), rel=1e-12)
    gradient = ours.linear.gradientAtZero()
    assert max(np.abs(gradient.at(X(k))).max() for k in range(n)) < 1e-4, "a minimum of graph and scans together"


def test_levels_are_gone_through_in_order() -> None:
    motions, means, W = fixed_drive()
    scans = ScanFactors(PoseFixes(means, W), [X(k) for k in range(len(means))])
    found = optimize(motion_graph(motions), values_of(means + 0.2), scans, levels=[0, 1], settings=EXACT)
    blurs = [step.level for step in found.history]
    assert set(blurs) == {0.5, 0.0}
    assert blurs == sorted(blurs, reverse=True)
    direct = optimize(motion_graph(motions), values_of(means + 0.2), scans, settings=EXACT)
    assert {step.level for step in direct.history} == {0.0}
    assert found.cost == pytest.approx(direct.cost, rel=1e-9)


def test_some_poses_may_have_no_scan() -> None:
    motions, means, W = fixed_drive()
    kept = [0, 3, 4, 20]
    scans = ScanFactors(PoseFixes(means[kept], W), [X(k) for k in kept])
    found = optimize(motion_graph(motions), values_of(means), scans, settings=EXACT)
    assert found.scan_costs.cost.shape == (4,)
    poses = pose_array(found.values)
    assert pose_array(found.values, scans.keys) == pytest.approx(poses[kept])
    assert np.abs(poses[kept] - means[kept]).max() < np.abs(means - poses).max()


def test_limits_are_kept() -> None:
    graph, values = pose_graph(2, 80, 8)
    short = optimize(
        graph, values, settings=OptimizerSettings(max_iterations=1, relative_tolerance=0, absolute_tolerance=0)
    )
    assert (len(short.history), short.stop) == (1, StopReason.MAX_ITERATIONS)
    coarse = optimize(graph, values, settings=OptimizerSettings(absolute_tolerance=1e12))
    assert (len(coarse.history), coarse.stop) == (1, StopReason.CONVERGED)
    for wrong in ({"max_iterations": 0}, {"damping_factor": 1.0}, {"lever_arm": 0}):
        with pytest.raises(ConfigError, match=next(iter(wrong))):
            OptimizerSettings(**wrong)


class Indefinite(PoseFixes):
    """Costs whose second derivatives are hopelessly negative."""

    def batch(self, poses, level=-1, scan_of_pose=None) -> ScanCosts:
        costs = super().batch(poses, level, scan_of_pose)
        return ScanCosts(costs.cost, costs.gradient, -1e30 * np.abs(costs.hessian))


class Uphill(PoseFixes):
    """Gradients that point the wrong way."""

    def batch(self, poses, level=-1, scan_of_pose=None) -> ScanCosts:
        costs = super().batch(poses, level, scan_of_pose)
        return ScanCosts(costs.cost, -costs.gradient, costs.hessian)


def test_where_no_damping_helps_it_says_so() -> None:
    motions, means, W = fixed_drive()
    keys = [X(k) for k in range(len(means))]
    with pytest.raises(OptimizationError, match="cannot be solved") as caught:
        optimize(motion_graph(motions), values_of(means), ScanFactors(Indefinite(means, W), keys))
    assert "\n" not in str(caught.value)
    found = optimize(gtsam.NonlinearFactorGraph(), values_of(means + 0.1), ScanFactors(Uphill(means, W), keys))
    assert not found.history
    assert found.values.equals(values_of(means + 0.1), 1e-12)


def refused(graph, values, scans=None) -> str:
    with pytest.raises(OptimizationError) as caught:
        optimize(graph, values, scans)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_start_that_is_none_is_refused() -> None:
    graph, values = pose_graph(2, 5, 0)
    assert refused(gtsam.NonlinearFactorGraph(), gtsam.Values()) == "graph: no poses to optimize"
    for wrong in (np.nan, np.inf, 1e200):
        values.update(X(3), gtsam.Pose2(wrong, 0, 0))
        assert "the cost at the start is" in refused(graph, values)


def test_poses_and_factors_must_fit() -> None:
    graph, values = pose_graph(2, 5, 0)
    assert refused(gtsam.NonlinearFactorGraph(), values) == "graph: 5 of its poses are in no factor, the first is x0"
    more = gtsam.Values(values)
    more.insert(X(9), gtsam.Pose2())
    assert refused(graph, more) == "graph: 1 of its poses are in no factor, the first is x9"
    graph.push_back(gtsam.BetweenFactorPose2(X(4), X(7), gtsam.Pose2(), gtsam.noiseModel.Unit.Create(3)))
    assert refused(graph, values) == "graph: 1 of its poses are in factors but have no start, the first is x7"
    scans = ScanFactors(PoseFixes(np.zeros((1, 3)), np.eye(3)), [X(8)])
    graph, values = pose_graph(2, 5, 0)
    assert "have no start, the first is x8" in refused(graph, values, scans)
    values.insert(X(8), gtsam.Pose3())
    assert "all of Pose2 or all of Pose3" in refused(graph, values)
    points = gtsam.Values()
    points.insert(0, gtsam.Point2(0, 0))
    assert "all of Pose2 or all of Pose3" in refused(graph, points)


def test_a_graph_that_floats_keeps_its_place() -> None:
    graph, values = pose_graph(2, 20, 3, prior=False)
    found = optimize(graph, values, settings=EXACT)
    assert found.cost == pytest.approx(optimize(*pose_graph(2, 20, 3), settings=EXACT).cost, rel=1e-6)
    assert np.linalg.norm(pose_array(found.values).mean(0) - pose_array(values).mean(0)) < 1.0
