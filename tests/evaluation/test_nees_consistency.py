import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from factorloc.errors import EvaluationError
from factorloc.evaluation import absolute_errors, covariance_factor, nees
from factorloc.geometry import se2, se3
from factorloc.trajectory import Trajectory


def sample(n, d, seed):
    """Errors drawn from covariances that differ from pose to pose and mix the coordinates."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, d, d)) * np.geomspace(1e-3, 1, d)[:, None] + 1e-4 * np.eye(d)
    return np.einsum("nij,nj->ni", root, rng.normal(size=(n, d))), root @ root.swapaxes(1, 2)


@pytest.mark.parametrize("d", [3, 6])
def test_errors_drawn_from_the_covariance_are_consistent(d):
    errors, covariances = sample(4000, d, seed=d)
    c = nees(errors, covariances, probability=0.999)
    low, high = c.bounds
    assert low < c.mean < high
    assert c.consistent
    assert high - low < 0.1
    assert nees(errors, covariances).share_inside == pytest.approx(0.95, abs=0.015)
    np.testing.assert_allclose(c.per_coordinate, 1, atol=0.15)


def test_bounds_are_chi_square():
    c = nees(np.ones((10, 3)), np.broadcast_to(np.eye(3), (10, 3, 3)), probability=0.9)
    np.testing.assert_allclose(c.bounds, chi2.ppf([0.05, 0.95], 30) / 30)
    assert c.mean == 1
    np.testing.assert_array_equal(c.values, 3)


@given(st.integers(0, 1000), st.floats(1e-3, 1e3))
def test_the_factor_makes_any_covariance_fit(seed, scale):
    errors, covariances = sample(20, 3, seed)
    s = covariance_factor(errors * scale, covariances)
    assert nees(errors * scale, s * covariances).mean == pytest.approx(1)
    assert s == pytest.approx(scale**2 * covariance_factor(errors, covariances))


@given(st.integers(0, 1000))
def test_units_and_axes_do_not_matter(seed):
    errors, covariances = sample(10, 3, seed)
    A = np.random.default_rng(seed).normal(size=(3, 3)) + 3 * np.eye(3)
    turned = nees(errors @ A.T, A @ covariances @ A.T)
    np.testing.assert_allclose(turned.values, nees(errors, covariances).values, rtol=1e-5)


def test_overconfidence_shows_in_its_coordinate():
    errors = np.random.default_rng(0).normal(size=(2000, 3)) * [1, 3, 1]
    c = nees(errors, np.broadcast_to(np.eye(3), (2000, 3, 3)))
    assert not c.consistent
    np.testing.assert_allclose(c.per_coordinate, [1, 9, 1], rtol=0.15)
    assert c.share_inside < 0.8


@pytest.mark.parametrize(("group", "d"), [(se2, 3), (se3, 6)])
def test_poses_disturbed_by_their_covariance_are_consistent(group, d):
    errors, covariances = (0.1 * np.array(part) for part in sample(2000, d, seed=1))
    covariances *= 0.1  # small enough for the logarithm to undo the exponential
    truth = group.exp(np.random.default_rng(2).normal(size=(2000, d)) * 0.5)
    estimate = group.compose(truth, group.inverse(group.exp(errors)))
    stamps = np.arange(2000)
    tangent = absolute_errors(Trajectory(stamps, estimate), Trajectory(stamps, truth)).tangent
    np.testing.assert_allclose(tangent, errors, atol=1e-9)
    assert nees(tangent, covariances, probability=0.999).consistent


@pytest.mark.parametrize(
    ("errors", "covariances", "message"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3, 3)), "errors: shape"),
        (np.zeros((2, 3)), np.zeros((2, 6, 6)), "covariances: shape"),
        (np.full((1, 3), np.nan), np.eye(3)[None], "NaN"),
        (np.zeros((2, 3)), np.stack([np.eye(3), np.diag([1, 0, 1])]), "1 of 2 .* row 1"),
        (np.zeros((1, 2)), np.array([[[1.0, 2.0], [2.0, 1.0]]]), "positive definite"),
        (np.zeros((1, 2)), np.array([[[1.0, 0.5], [0.2, 1.0]]]), "symmetric"),
    ],
)
def test_bad_input_is_named(errors, covariances, message):
    with pytest.raises(EvaluationError, match=message):
        nees(errors, covariances)


def test_probability_is_checked():
    with pytest.raises(EvaluationError, match="probability"):
        nees(np.zeros((1, 1)), np.ones((1, 1, 1)), probability=95)
