"""The custom factor of a scan brings gtsam's incremental smoothers to where the batch smoother is."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import X
from test_optimizer import EXACT, PoseFixes, fixed_drive

from factorloc.factors import DecayRateTerm, DistanceFieldTerm, OdometryNoise, odometry_factors, square_root_factor
from factorloc.factors.native import pose_array
from factorloc.localization import ScanFactors, optimize

N = 25


def parameters(dogleg: bool) -> gtsam.ISAM2Params:
    result = gtsam.ISAM2Params()
    result.setRelinearizeThreshold(1e-6)
    result.relinearizeSkip = 1
    steps = gtsam.ISAM2DoglegParams() if dogleg else gtsam.ISAM2GaussNewtonParams()
    steps.setWildfireThreshold(1e-9)
    if dogleg:
        steps.setInitialDelta(1.0)
        steps.setAdaptationMode("ONE_STEP_PER_ITERATION")
    result.setOptimizationParams(steps)
    return result


class Drive:
    """Factors of a drive, given out one pose at a time."""

    def __init__(self, term, motions, initial, prior=None) -> None:
        self.keys = [X(k) for k in range(len(initial))]
        self.term, self.initial = term, initial
        self.native = [[] for _ in self.keys]
        if prior is not None:
            self.native[0].append(prior.factor(X(0)))
        for k, factor in enumerate(odometry_factors(self.keys, motions, OdometryNoise())):
            self.native[k + 1].append(factor)

    def arrivals(self):
        for k, (key, native) in enumerate(zip(self.keys, self.native, strict=True)):
            graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
            for factor in (*native, square_root_factor(key, self.term, k)):
                graph.push_back(factor)
            values.insert(key, gtsam.Pose2(*self.initial[k]))
            yield key, graph, values

    def batch(self):
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        for key, native, pose in zip(self.keys, self.native, self.initial, strict=True):
            for factor in native:
                graph.push_back(factor)
            values.insert(key, gtsam.Pose2(*pose))
        self.graph = graph
        return optimize(graph, values, ScanFactors(self.term, self.keys), settings=EXACT)

    def cost(self, values: gtsam.Values) -> float:
        return self.graph.error(values) + self.term.cost(pose_array(values)).sum()


def isam(drive: Drive, dogleg: bool, more: int) -> gtsam.Values:
    smoother = gtsam.ISAM2(parameters(dogleg))
    for _, graph, values in drive.arrivals():
        smoother.update(graph, values)
    for _ in range(more):
        smoother.update()
    return gtsam.Values(smoother.calculateEstimate())


def fixed_lag(drive: Drive, dogleg: bool, lag: float, more: int = 0) -> gtsam.IncrementalFixedLagSmoother:
    smoother = gtsam.IncrementalFixedLagSmoother(lag, parameters(dogleg))
    for k, (key, graph, values) in enumerate(drive.arrivals()):
        smoother.update(graph, values, {key: float(k)})
    for _ in range(more):
        smoother.update(gtsam.NonlinearFactorGraph(), gtsam.Values(), {})
    return smoother


@pytest.fixture(scope="module")
def fixes() -> Drive:
    motions, means, W = fixed_drive()
    return Drive(PoseFixes(means, W), motions, means)


def test_where_costs_are_squares_all_meet_in_one_place(fixes) -> None:
    batch = fixes.batch()
    expected = pose_array(batch.values)
    for dogleg in (False, True):
        assert pose_array(isam(fixes, dogleg, 10)) == pytest.approx(expected, abs=1e-6)
        whole = fixed_lag(fixes, dogleg, 1e3, 10)
        assert pose_array(whole.calculateEstimate()) == pytest.approx(expected, abs=1e-6)
    last = X(len(expected) - 1)
    theirs = fixed_lag(fixes, False, 1e3, 10).marginalCovariance(last)
    assert theirs == pytest.approx(gtsam.Marginals(batch.linear, batch.values).marginalCovariance(last), rel=1e-4)


def test_a_short_lag_forgets_gently(fixes) -> None:
    expected = pose_array(fixes.batch().values)
    smoother = fixed_lag(fixes, False, 8.0)
    estimate = smoother.calculateEstimate()
    assert estimate.size() <= 10
    last = estimate.atPose2(X(len(expected) - 1))
    assert [last.x(), last.y(), last.theta()] == pytest.approx(expected[-1], abs=0.03)


@pytest.mark.parametrize("model", ["decay-rate", "distance-field"])
def test_scans_in_a_map_are_smoothed_as_in_a_batch(office, tracked, model) -> None:
    scans = office.drive.scans[:N]
    if model == "decay-rate":
        term = DecayRateTerm(office.pyramid, scans, 0.2)
    else:
        term = DistanceFieldTerm(office.statistics, scans, 0.2)
    drive = Drive(term, office.drive.odometry[: N - 1], tracked.trajectory.poses[:N], office.prior)
    batch = drive.batch()
    expected = pose_array(batch.values)
    whole = gtsam.Values(fixed_lag(drive, True, 1e3, 20).calculateEstimate())
    for values in (isam(drive, True, 20), whole):
        assert drive.cost(values) <= batch.cost + 0.2
        assert np.abs(pose_array(values) - expected).max() < 5e-3
    lagged = fixed_lag(drive, True, 6.0).calculateEstimate().atPose2(X(N - 1))
    assert np.hypot(lagged.x() - office.truth[N - 1, 0], lagged.y() - office.truth[N - 1, 1]) < 0.06
