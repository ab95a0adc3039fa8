"""Scale and drift as they are believed while driving: derivatives, and Gaussians that are multiplied."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from factorloc.geometry import se2
from factorloc.localization.calibration_belief import CalibrationBelief, calibration_jacobians
from factorloc.localization.odometry_calibration import OdometryCalibration

small = st.floats(-0.02, 0.02)


def test_derivatives_of_motions_are_the_numerical_ones() -> None:
    rng = np.random.default_rng(0)
    motions = rng.normal(0, [2.0, 0.5, 0.3], (20, 3))
    h = 1e-6
    for column, off in enumerate((OdometryCalibration(1 + h, 0.0), OdometryCalibration(1.0, h))):
        numerical = se2.log(se2.between(motions, off.applied(motions))) / h
        assert calibration_jacobians(motions)[:, :, column] == pytest.approx(numerical, abs=1e-5)


@given(small, small, st.floats(-1e-4, 1e-4), st.floats(-1e-4, 1e-4))
def test_two_calibrations_after_each_other_are_one(a: float, b: float, c: float, d: float) -> None:
    motions = np.random.default_rng(1).normal(0, [2.0, 0.5, 0.3], (5, 3))
    one, other = OdometryCalibration(1 + a, c), OdometryCalibration(1 + b, d)
    assert one.then(other).applied(motions) == pytest.approx(other.applied(one.applied(motions)), abs=1e-12)


def test_stretches_that_say_little_are_fused_as_gaussians_are() -> None:
    rng = np.random.default_rng(2)
    # Far less sure than the floor, which then counts for nothing.
    root = rng.normal(0, 1, (2, 2)) * [5.0, 200.0]
    information = root.T @ root + np.diag([1.0, 1e4])
    belief, own = CalibrationBelief.from_sigmas(0.3, 0.01), np.array([0.05, -0.002])
    together = np.linalg.solve(belief.information + information, information @ own)
    after = belief.learned(together, information, 1.0)
    assert after.information == pytest.approx(belief.information + information, rel=0.02)
    assert [after.mean.scale - 1, after.mean.drift] == pytest.approx(together, rel=0.05)


def test_no_stretch_is_surer_than_the_floor_and_half_of_it_counts_half() -> None:
    belief = CalibrationBelief.from_sigmas(0.02, 3e-4)
    sure = np.diag([1e8, 1e12])
    after, half = (belief.learned(np.array([0.01, 0.0]), sure, share) for share in (1.0, 0.5))
    gained, less = after.information - belief.information, half.information - belief.information
    assert 1 / np.sqrt(gained[0, 0]) == pytest.approx(0.005, rel=0.01)
    assert less == pytest.approx(gained / 2)
    assert 0 < half.mean.scale - 1 < after.mean.scale - 1 < 0.01


def test_nothing_seen_teaches_nothing() -> None:
    belief = CalibrationBelief.from_sigmas(0.02, 3e-4)
    after = belief.learned(np.zeros(2), np.zeros((2, 2)), 1.0)
    assert after.mean == OdometryCalibration()
    assert after.information == pytest.approx(belief.information)
