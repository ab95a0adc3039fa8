"""Priors: what they refuse, and the factor they make."""

import gtsam
import numpy as np
import pytest
from hypothesis import given
from strategies import poses_2d, tangents_2d

from factorloc.errors import GeometryError
from factorloc.factors import PosePrior
from factorloc.geometry import se2

COVARIANCE = np.array([[0.5, 0.1, 0.02], [0.1, 0.3, -0.03], [0.02, -0.03, 0.04]])


@given(poses_2d(), tangents_2d(3.0))
def test_the_error_of_the_factor_is_half_the_squared_mahalanobis_distance_in_the_body_frame(pose, offset) -> None:
    prior = PosePrior(pose, COVARIANCE)
    values = gtsam.Values()
    values.insert(3, gtsam.Pose2(*se2.compose(pose, se2.exp(offset))))
    expected = 0.5 * offset @ np.linalg.inv(COVARIANCE) @ offset
    assert prior.factor(3).error(values) == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_a_prior_of_sigmas_is_round() -> None:
    prior = PosePrior.from_sigmas([1, 2, 4.0], 0.5, 0.1)
    assert prior.pose == pytest.approx([1, 2, 4.0 - 2 * np.pi])
    assert prior.covariance == pytest.approx(np.diag([0.25, 0.25, 0.01]))
    assert prior.information == pytest.approx(np.diag([4, 4, 100]))


@pytest.mark.parametrize(
    ("covariance", "line"),
    [
        (np.eye(2), "3 x 3"),
        (np.ones(3), "3 x 3"),
        (np.array([[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]), "symmetric"),
        (np.full((3, 3), np.nan), "finite"),
        (np.diag([np.inf, 1, 1]), "finite"),
        (np.diag([1, 1, 0]), "not positive definite"),
        (np.diag([1, -1, 1]), "not positive definite"),
    ],
)
def test_a_covariance_that_is_none_is_refused(covariance, line) -> None:
    with pytest.raises(GeometryError, match=line):
        PosePrior(np.zeros(3), covariance)


@pytest.mark.parametrize("pose", [[0, 0], [0, np.nan, 0], [[0, 0, 0], [1, 1, 1]], 0.0])
def test_a_pose_that_is_none_is_refused(pose) -> None:
    with pytest.raises(GeometryError, match="prior pose"):
        PosePrior(pose, COVARIANCE)
    with pytest.raises(GeometryError, match="prior pose"):
        PosePrior.from_sigmas(pose, 1, 1)


def test_certainty_is_refused() -> None:
    with pytest.raises(GeometryError, match="give every direction some variance"):
        PosePrior.from_sigmas(np.zeros(3), 0.0, 0.1)
