"""Both ways of putting a scan into a graph say the same: cost, gradient and Hessian of the term."""

import gtsam
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from loose_rays import BLURS, MODELS
from strategies import floats

from factorloc.errors import OptimizationError
from factorloc.factors import hessian_factors, square_root_factor
from factorloc.factors.adaptors import square_root_form
from factorloc.geometry import se2
from factorloc.scan import RayStatus, Scan

models = pytest.mark.parametrize("model", MODELS)


@st.composite
def quadratics(draw: st.DrawFn):
    """Cost, gradient and positive semi-definite Hessian of sums of squares, as Gauss-Newton makes them."""
    d, rows = draw(st.sampled_from([3, 6])), draw(st.integers(1, 9))
    J = draw(arrays(np.float64, (rows, d), elements=floats(-30, 30)))
    r = draw(arrays(np.float64, rows, elements=floats(-30, 30)))
    least = draw(floats(-50, 50))
    return least + 0.5 * r @ r + draw(floats(0, 5)) + 1e-3, J.T @ r, J.T @ J, least


@given(quadratics())
def test_the_square_root_form_carries_cost_gradient_and_hessian(quadratic) -> None:
    cost, gradient, hessian, least = quadratic
    residual, jacobian = square_root_form(cost, gradient, hessian, least)
    d = len(gradient)
    assert (residual.shape, jacobian.shape) == ((d + 1,), (d + 1, d))
    assert (jacobian[d] == 0).all()
    assert residual @ residual / 2 == pytest.approx(cost - least, rel=1e-9, abs=1e-9)
    # Directions without curvature get a little of it.
    little = 1e-9 * max(np.linalg.eigvalsh(hessian).max(), 1)
    assert jacobian.T @ jacobian == pytest.approx(hessian, rel=0, abs=1.1 * little)
    assert jacobian.T @ residual == pytest.approx(gradient, rel=1e-9, abs=1e-9 * (1 + np.abs(gradient).max()))
    assert np.linalg.svd(jacobian, compute_uv=False).min() >= 0.9 * np.sqrt(little)


def test_a_bound_above_the_quadratic_model_is_refused() -> None:
    with pytest.raises(OptimizationError, match=r"least cost 4.900 is no bound of cost 5.000; lower it"):
        square_root_form(5.0, np.array([1.0, 0, 0]), np.eye(3), 4.9)
    residual, _ = square_root_form(5.0, np.array([1.0, 0, 0]), np.eye(3), 4.5)
    assert residual[-1] == 0


@pytest.fixture(scope="module")
def poses(drawn) -> np.ndarray:
    rng = np.random.default_rng(9)
    return drawn[1][40:] + rng.normal(0, [0.1, 0.1, 0.05], (10, 3))


@pytest.fixture(scope="module")
def values(poses) -> gtsam.Values:
    values = gtsam.Values()
    for key, pose in enumerate(poses):
        values.insert(key, gtsam.Pose2(*pose))
    return values


@models
@pytest.mark.parametrize("level", range(len(BLURS)))
def test_both_factors_have_the_cost_gradient_and_hessian_of_the_term(make_term, drawn, poses, values, model, level):
    term = make_term(model, drawn[0][40:], 0.2)
    costs = term.batch(poses, level)
    gaussian = list(hessian_factors(range(10), costs))
    for k, factor in enumerate(gaussian):
        assert list(factor.keys()) == [k]
        assert factor.information() == pytest.approx(costs.hessian[k])
        assert factor.error(factor_values(k, np.zeros(3))) == pytest.approx(costs.cost[k])
        step = np.array([0.01, -0.02, 0.005])
        model_cost = costs.cost[k] + costs.gradient[k] @ step + 0.5 * step @ costs.hessian[k] @ step
        assert factor.error(factor_values(k, step)) == pytest.approx(model_cost)

        custom = square_root_factor(k, term, k, level)
        linear = custom.linearize(values)
        A, b = linear.jacobian()
        scale = np.abs(costs.hessian[k]).max()
        assert (np.abs(A.T @ A - costs.hessian[k]) <= 1e-8 * scale).all()
        assert A.T @ b == pytest.approx(-costs.gradient[k], abs=1e-8 * scale)
        assert 0.5 * b @ b == pytest.approx(custom.error(values), rel=1e-9)
        margin = custom.error(values) - (costs.cost[k] - term.least_cost(level)[k])
        assert margin == pytest.approx(1 + 0.5 * abs(term.least_cost(level)[k]), rel=1e-6), "the same at every pose"


def factor_values(key: int, vector: np.ndarray) -> gtsam.VectorValues:
    values = gtsam.VectorValues()
    values.insert(key, vector)
    return values


@models
def test_the_error_of_a_custom_factor_rises_and_falls_as_the_cost(make_term, drawn, poses, model) -> None:
    term = make_term(model, drawn[0][40:], 0.2)
    factor = square_root_factor(5, term, 3)
    errors = []
    for pose in poses:
        values = gtsam.Values()
        values.insert(5, gtsam.Pose2(*pose))
        errors.append(factor.error(values))
    costs = term.cost(poses, -1, np.full(10, 3))
    assert np.array(errors) - errors[0] == pytest.approx(costs - costs[0], abs=1e-8)


@models
def test_wherever_a_scan_is_the_custom_factor_stands(make_term, drawn, statistics, model) -> None:
    """Far off, outside the map, or without a single return: the quadratic model stays under its bound."""
    blind = Scan.from_polar(np.linspace(-1, 1, 5), np.full(5, np.inf), (0.1, 5.0))
    assert (blind.status == RayStatus.NO_RETURN).all()
    term = make_term(model, [drawn[0][0], blind], 0.2)
    rng = np.random.default_rng(3)
    for pose in rng.uniform([-4, -4, -3], [9, 8, 3], (200, 3)):
        for scan in (0, 1):
            for level in range(len(BLURS)):
                values = gtsam.Values()
                values.insert(0, gtsam.Pose2(*pose))
                factor = square_root_factor(0, term, scan, level)
                A, b = factor.linearize(values).jacobian()
                assert np.isfinite(A).all()
                assert 0.5 * b @ b == pytest.approx(factor.error(values), rel=1e-6)


def test_gauss_newton_on_custom_factors_equals_newton_on_hessian_factors(make_term, drawn, poses, values) -> None:
    term = make_term("decay-rate", drawn[0][40:], 0.2)
    graph, linear = gtsam.NonlinearFactorGraph(), gtsam.GaussianFactorGraph()
    prior = gtsam.noiseModel.Isotropic.Sigma(3, 0.1)
    for key, factor in enumerate(hessian_factors(range(10), term.batch(poses))):
        graph.push_back(square_root_factor(key, term, key))
        graph.push_back(gtsam.PriorFactorPose2(key, gtsam.Pose2(*poses[key]), prior))
        linear.push_back(factor)
        linear.push_back(graph.at(2 * key + 1).linearize(values))
    custom, gaussian = graph.linearize(values).optimize(), linear.optimize()
    for key in range(10):
        assert custom.at(key) == pytest.approx(gaussian.at(key), abs=1e-9)
        moved = se2.compose(poses[key], se2.exp(0.01 * gaussian.at(key)))
        assert term.cost(moved[None], -1, [key])[0] < term.cost(poses[key][None], -1, [key])[0] + 1e-6
