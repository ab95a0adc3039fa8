"""Smoothing makes a drive one: it mends what is off, keeps what is right, and accounts for both."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import X

from factorloc.errors import GeometryError, OptimizationError
from factorloc.factors import DecayRateTerm, DistanceFieldTerm, OdometryNoise, PosePrior, odometry_factors
from factorloc.geometry import se2
from factorloc.localization import OptimizerSettings, ScanFactors, optimize, smooth
from factorloc.localization.smoother import marginal_covariances


def cost_of(office, poses: np.ndarray, level: int = -1) -> float:
    """Cost of the whole graph at poses, from its parts."""
    keys = [X(k) for k in range(len(poses))]
    values = gtsam.Values()
    for key, pose in zip(keys, poses, strict=True):
        values.insert(key, gtsam.Pose2(*pose))
    native = [office.prior.factor(keys[0]), *odometry_factors(keys, office.drive.odometry, OdometryNoise())]
    return sum(factor.error(values) for factor in native) + float(office.term.cost(poses, level).sum())


def smooth_from(office, initial: np.ndarray, **arguments):
    return smooth(office.term, office.drive.odometry, initial, prior=office.prior, **arguments)


def test_a_tracked_drive_stays_right_and_becomes_cheaper(office, tracked, smoothed) -> None:
    poses = smoothed.trajectory.poses
    assert np.sqrt((office.errors(poses) ** 2).mean()) < 0.02
    assert office.errors(poses).max() < 0.05
    assert office.turns(poses).max() < np.radians(1)
    assert smoothed.cost <= cost_of(office, tracked.trajectory.poses)


def test_the_result_says_what_was_done(office, smoothed) -> None:
    n = len(office.drive)
    assert smoothed.converged
    assert {kind: len(costs) for kind, costs in smoothed.residuals.items()} == {
        "prior": 1,
        "odometry": n - 1,
        "scan": n,
    }
    assert smoothed.cost == pytest.approx(sum(costs.sum() for costs in smoothed.residuals.values()), rel=1e-9)
    assert smoothed.cost == pytest.approx(cost_of(office, smoothed.trajectory.poses), rel=1e-9)
    assert smoothed.rejected == {"motions not measured": 0}
    assert smoothed.seconds > 0
    assert (smoothed.trajectory.stamps == office.drive.stamps).all()
    assert smoothed.iterations == len(smoothed.history) > 0
    assert np.linalg.eigvalsh(smoothed.trajectory.covariances).min() > 0
    blurs = [step.level for step in smoothed.history]
    assert {0.25, 0.1, 0.0} == set(blurs)
    assert blurs == sorted(blurs, reverse=True)
    assert smoothed.history[-1].cost == pytest.approx(smoothed.cost)
    for blur in (0.25, 0.1):
        costs = [step.cost for step in smoothed.history if step.level == blur]
        assert (np.diff(costs) <= 0).all()


def test_every_step_is_told(office, tracked) -> None:
    told = []
    result = smooth_from(office, tracked.trajectory.poses, progress=told.append, levels=[-2, -1], frame="building")
    assert tuple(told) == result.history
    assert {step.level for step in told} == {0.1, 0.0}
    assert result.trajectory.world == "building"
    assert result.trajectory.stamps.tolist() == list(range(len(office.drive)))


@pytest.mark.parametrize("spread", [0.0, 0.05, 0.2])
def test_the_cost_is_never_above_that_of_the_start(office, spread) -> None:
    rng = np.random.default_rng(12)
    initial = office.truth + rng.normal(0, 1, office.truth.shape) * [spread, spread, spread / 2]
    result = smooth_from(office, initial)
    assert result.cost <= cost_of(office, initial)
    assert np.median(office.errors(result.trajectory.poses)) < 0.03
    if spread:
        assert np.median(office.errors(result.trajectory.poses)) < 0.5 * np.median(office.errors(initial))


@pytest.mark.parametrize("place", [12, 30, 44])
def test_a_straggler_is_pulled_in(office, tracked, place) -> None:
    initial = tracked.trajectory.poses.copy()
    initial[place] = se2.compose(initial[place], [0.45, -0.4, 0.12])
    assert office.errors(initial)[place] > 0.58
    result = smooth_from(office, initial)
    assert office.errors(result.trajectory.poses).max() < 0.05
    assert result.residuals["odometry"].max() < 1.0


def test_it_takes_the_pyramid_to_pull_a_straggler_in(office, tracked) -> None:
    """The finest level alone leaves it in the nearest trough of its scan."""
    initial = tracked.trajectory.poses.copy()
    for place in (6, 16, 26, 36, 46):
        initial[place] = se2.compose(initial[place], [0.45, -0.4, 0.12])
    n = len(initial)
    keys = [X(k) for k in range(n)]
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for factor in odometry_factors(keys, office.drive.odometry, OdometryNoise()):
        graph.push_back(factor)
    for key, pose in zip(keys, initial, strict=True):
        values.insert(key, gtsam.Pose2(*pose))
    scans = ScanFactors(office.term, keys)

    def astray(levels):
        found = optimize(graph, values, scans, levels=levels)
        poses = np.array([[*found.values.atPose2(k).translation(), found.values.atPose2(k).theta()] for k in keys])
        return (office.errors(poses) > 0.15).sum()

    assert astray([-1]) > 0
    assert astray([2, 3, 4]) == 0


def test_a_motion_nobody_measured_makes_no_factor(office, gap) -> None:
    result = smooth(gap.term, gap.odometry, gap.truth, prior=office.prior, known=gap.known)
    assert len(result.residuals["odometry"]) == len(gap.truth) - 2
    assert result.rejected == {"motions not measured": 1}
    assert gap.errors(result.trajectory.poses).max() < 0.05
    # Taken for standing still it would be an outlier, which Huber bears but sees.
    fooled = smooth(gap.term, gap.odometry, gap.truth, prior=office.prior)
    assert fooled.residuals["odometry"].max() > 10 * result.residuals["odometry"].max()


def test_a_prior_is_not_needed_where_scans_hold_the_drive(office, tracked) -> None:
    result = smooth(office.term, office.drive.odometry, tracked.trajectory.poses)
    assert set(result.residuals) == {"odometry", "scan"}
    assert office.errors(result.trajectory.poses).max() < 0.05


def test_scans_that_see_nothing_are_held_by_their_neighbours(office, tracked) -> None:
    scans = list(office.drive.scans)
    for k in (20, 21):
        scans[k] = scans[k].select(np.zeros(len(scans[k]), bool))
    term = DecayRateTerm(office.pyramid, scans, 0.2)
    result = smooth(term, office.drive.odometry, tracked.trajectory.poses, prior=office.prior)
    assert office.errors(result.trajectory.poses).max() < 0.12
    spread = np.linalg.det(result.trajectory.covariances)
    assert spread[20] > 10 * np.median(spread)


def test_poses_that_nothing_determines_are_refused(office) -> None:
    blind = [office.drive.scans[0].select(np.zeros(109, bool))] * 3
    term = DecayRateTerm(office.pyramid, blind)
    with pytest.raises(OptimizationError, match="nothing determines some pose; give a prior"):
        smooth(term, office.drive.odometry[:2], office.truth[:3])
    result = smooth(term, office.drive.odometry[:2], office.truth[:3], prior=office.prior)
    chained = [office.prior.pose]
    for motion in office.drive.odometry[:2]:
        chained.append(se2.compose(chained[-1], motion))
    assert result.trajectory.poses == pytest.approx(np.array(chained), abs=1e-3)


def test_a_single_scan_is_a_drive(office) -> None:
    term = DecayRateTerm(office.pyramid, office.drive.scans[:1], 0.2)
    result = smooth(term, np.zeros((0, 3)), office.truth[:1] + 0.07, prior=office.prior)
    assert set(result.residuals) == {"prior", "scan"}
    assert result.trajectory.poses[0] == pytest.approx(office.truth[0], abs=0.04)


def test_covariances_are_the_blocks_of_the_inverse(office, tracked) -> None:
    n = 6
    term = DecayRateTerm(office.pyramid, office.drive.scans[:n], 0.2)
    keys = [X(k) for k in range(n)]
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for factor in odometry_factors(keys, office.drive.odometry[: n - 1], OdometryNoise()):
        graph.push_back(factor)
    for key, pose in zip(keys, tracked.trajectory.poses, strict=False):
        values.insert(key, gtsam.Pose2(*pose))
    found = optimize(graph, values, ScanFactors(term, keys))
    information = graph.linearize(found.values).hessian()[0]
    for k in range(n):
        information[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] += found.scan_costs.hessian[k]
    inverse = np.linalg.inv(information)
    for k, covariance in enumerate(marginal_covariances(found, keys)):
        assert covariance == pytest.approx(inverse[3 * k : 3 * k + 3, 3 * k : 3 * k + 3], rel=1e-6)


def test_a_likelihood_field_smooths_as_well(office, tracked) -> None:
    term = DistanceFieldTerm(office.statistics, office.drive.scans, 0.2)
    result = smooth(term, office.drive.odometry, tracked.trajectory.poses, prior=office.prior)
    assert np.sqrt((office.errors(result.trajectory.poses) ** 2).mean()) < 0.05


def test_settings_are_passed_on(office, tracked) -> None:
    slow = OptimizerSettings(max_iterations=1)
    result = smooth_from(office, tracked.trajectory.poses, settings=slow)
    assert result.iterations <= 4
    sure = OdometryNoise(least_turn=1e-3, least_length=1e-3, length_per_metre=0.001, turn_per_metre=0.001)
    stiff = smooth_from(office, tracked.trajectory.poses, noise=sure)
    assert stiff.residuals["odometry"].sum() > 3 * result.residuals["odometry"].sum()


@pytest.mark.parametrize(
    ("initial", "motions", "arguments", "line"),
    [
        (np.zeros((3, 3)), np.zeros((3, 3)), {}, "3 scans, poses .3, 3. and motions .3, 3. do not fit"),
        (np.zeros((2, 3)), np.zeros((2, 3)), {}, "do not fit"),
        (np.zeros(9), np.zeros((2, 3)), {}, "initial"),
        (np.zeros((3, 3)), np.zeros(6), {}, "odometry"),
        (np.full((3, 3), np.nan), np.zeros((2, 3)), {}, "initial"),
        (np.zeros((3, 3)), np.full((2, 3), np.inf), {}, "odometry"),
        (np.zeros((3, 3)), np.zeros((2, 3)), {"known": [True]}, "known"),
        (np.zeros((3, 3)), np.zeros((2, 3)), {"known": [True] * 3}, "known"),
    ],
)
def test_what_does_not_fit_is_refused(office, initial, motions, arguments, line) -> None:
    term = DecayRateTerm(office.pyramid, office.drive.scans[:3])
    with pytest.raises(GeometryError, match=line):
        smooth(term, motions, initial, prior=office.prior, **arguments)


def test_stamps_must_be_as_many_as_scans(office) -> None:
    term = DecayRateTerm(office.pyramid, office.drive.scans[:3], 0.2)
    with pytest.raises(GeometryError, match="stamps"):
        smooth(term, office.drive.odometry[:2], office.truth[:3], stamps=[0.0, 1.0])


def test_a_prior_far_from_the_scans_is_outvoted(office, tracked) -> None:
    wrong = PosePrior.from_sigmas(office.truth[0] + [0.5, 0.0, 0.1], 0.5, 0.2)
    result = smooth(office.term, office.drive.odometry, tracked.trajectory.poses, prior=wrong)
    assert office.errors(result.trajectory.poses)[0] < 0.05
