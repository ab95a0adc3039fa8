"""What gtsam would crash on, or silently take, is refused before it gets there. All of it within this process."""

import gtsam
import numpy as np
import pytest

from factorloc.errors import GeometryError
from factorloc.factors._custom import custom_factor

A, B = 1, 2


def factor_of(residual, keys=(A, B), dimensions=(3, 3), rows=2) -> gtsam.CustomFactor:
    return custom_factor(gtsam.noiseModel.Unit.Create(rows), keys, dimensions, rows, residual)


@pytest.fixture
def values() -> gtsam.Values:
    values = gtsam.Values()
    values.insert(A, gtsam.Pose2(1, 2, 0.3))
    values.insert(B, gtsam.Pose2(2, 2, 0.1))
    return values


def good(values, want_jacobians):
    delta = values.atPose2(B).x() - values.atPose2(A).x()
    a, b = values.atPose2(A).theta(), values.atPose2(B).theta()
    J_a = np.array([[-np.cos(a), np.sin(a), 0], [0, 0, 0]])
    J_b = np.array([[np.cos(b), -np.sin(b), 0], [0, 0, 0]])
    return np.array([delta - 0.5, 0.25]), [J_a, J_b]


def test_a_right_factor_is_passed_on(values) -> None:
    factor = factor_of(good)
    assert factor.error(values) == pytest.approx(0.5 * (0.5**2 + 0.25**2))
    A_matrix, b = factor.linearize(values).jacobian()
    assert A_matrix == pytest.approx(np.hstack(good(values, True)[1]))
    assert b == pytest.approx([-0.5, -0.25])


def test_its_jacobian_is_that_of_the_residual(values) -> None:
    factor = factor_of(good)
    A_matrix, _ = factor.linearize(values).jacobian()
    step = 1e-6
    for column, (key, axis) in enumerate((key, axis) for key in (A, B) for axis in np.eye(3)):
        ends = []
        for sign in (1, -1):
            moved = gtsam.Values(values)
            moved.update(key, values.atPose2(key).retract(sign * step * axis))
            ends.append(good(moved, False)[0])
        assert A_matrix[:, column] == pytest.approx((ends[0] - ends[1]) / (2 * step), abs=1e-8)


J = np.zeros((2, 3))
BAD = {
    "missing Jacobian": ([J], "1 Jacobians for 2 keys"),
    "no Jacobian": ([], "0 Jacobians for 2 keys"),
    "one Jacobian too many": ([J, J, J], "3 Jacobians for 2 keys"),
    "a row too many": ([J, np.zeros((3, 3))], r"Jacobian 1 is \(3, 3\); expected finite \(2, 3\)"),
    "a row too few": ([np.zeros((1, 3)), J], r"Jacobian 0 is \(1, 3\)"),
    "a column too many": ([J, np.zeros((2, 4))], r"Jacobian 1 is \(2, 4\)"),
    "a column too few": ([J, np.zeros((2, 2))], r"Jacobian 1 is \(2, 2\)"),
    "turned": ([J, J.T], r"Jacobian 1 is \(3, 2\)"),
    "not a matrix": ([J, np.zeros(6)], r"Jacobian 1 is \(6,\)"),
    "NaN": ([J, J + np.nan], "finite"),
    "infinity": ([J + np.inf, J], "finite"),
}


@pytest.mark.parametrize(("jacobians", "line"), BAD.values(), ids=BAD)
def test_a_wrong_jacobian_is_refused(values, jacobians, line) -> None:
    factor = factor_of(lambda values, want: (np.zeros(2), jacobians))
    assert factor.error(values) == 0, "without Jacobians there is nothing wrong"
    with pytest.raises(GeometryError, match=line):
        factor.linearize(values)


@pytest.mark.parametrize("error", [np.zeros(3), np.zeros(1), np.zeros((2, 1)), 0.0])
def test_a_wrong_residual_is_refused(values, error) -> None:
    factor = factor_of(lambda values, want: (error, [J, J]))
    for call in (factor.error, factor.linearize):
        with pytest.raises(GeometryError, match=r"residual of shape .*; expected \(2,\)"):
            call(values)


def test_errors_come_through_an_optimizer_of_gtsam(values) -> None:
    graph = gtsam.NonlinearFactorGraph()
    graph.push_back(factor_of(lambda values, want: (np.ones(2), [J, np.zeros((5, 3))])))
    with pytest.raises(GeometryError, match="Jacobian 1"):
        gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()


def test_a_residual_that_is_not_a_number_is_left_to_the_optimizer_to_refuse(values) -> None:
    factor = factor_of(lambda values, want: (np.array([np.nan, 0.0]), [J, J]))
    assert np.isnan(factor.error(values))


def test_keys_and_dimensions_must_be_as_many() -> None:
    with pytest.raises(GeometryError, match="2 keys but 1 dimensions"):
        factor_of(good, dimensions=(3,))


def test_noise_of_another_length_is_refused_by_gtsam(values) -> None:
    factor = custom_factor(gtsam.noiseModel.Unit.Create(3), [A, B], [3, 3], 2, good)
    with pytest.raises(ValueError, match="dimension"):
        factor.linearize(values)
