"""Laws of SE(2), sampled near the identity and near half a turn, and equality with gtsam.Pose2."""

import gtsam
import numpy as np
import pytest
from hypothesis import given
from strategies import floats, poses_2d, tangents_2d, vectors

from factorloc.errors import GeometryError
from factorloc.geometry import se2, wrap

ATOL = 1e-11


def assert_same(first: np.ndarray, second: np.ndarray, atol: float = ATOL) -> None:
    """Compare poses; headings on the two sides of half a turn are neighbours."""
    difference = np.subtract(first, second)
    difference[..., 2] = wrap(difference[..., 2])
    np.testing.assert_allclose(difference, 0, atol=atol)


def to_gtsam(pose: np.ndarray) -> gtsam.Pose2:
    return gtsam.Pose2(*pose)


def of_gtsam(pose: gtsam.Pose2) -> np.ndarray:
    return np.array([pose.x(), pose.y(), pose.theta()])


@given(poses_2d(), poses_2d(), poses_2d())
def test_composition_is_associative(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> None:
    assert_same(se2.compose(se2.compose(a, b), c), se2.compose(a, se2.compose(b, c)))


@given(poses_2d())
def test_identity_and_inverse(a: np.ndarray) -> None:
    e = se2.identity()
    assert_same(se2.compose(a, e), a)
    assert_same(se2.compose(e, a), a)
    assert_same(se2.compose(a, se2.inverse(a)), e)
    assert_same(se2.compose(se2.inverse(a), a), e)
    assert_same(se2.inverse(se2.inverse(a)), a)


@given(poses_2d(), poses_2d())
def test_between_is_the_step_from_one_pose_to_the_other(a: np.ndarray, b: np.ndarray) -> None:
    assert_same(se2.compose(a, se2.between(a, b)), b)


@given(tangents_2d())
def test_logarithm_undoes_exponential(xi: np.ndarray) -> None:
    np.testing.assert_allclose(se2.log(se2.exp(xi)), xi, atol=ATOL, rtol=1e-11)


@given(poses_2d())
def test_exponential_undoes_logarithm(a: np.ndarray) -> None:
    assert_same(se2.exp(se2.log(a)), a)


@given(tangents_2d(), floats(0.1, 0.9))
def test_exponential_of_one_direction_is_a_path(xi: np.ndarray, part: float) -> None:
    assert_same(se2.compose(se2.exp(part * xi), se2.exp((1 - part) * xi)), se2.exp(xi))


@given(poses_2d(), tangents_2d())
def test_adjoint_carries_body_motions_to_the_world(a: np.ndarray, xi: np.ndarray) -> None:
    assert_same(se2.compose(a, se2.exp(xi)), se2.compose(se2.exp(se2.adjoint(a) @ xi), a), atol=1e-9)


@given(poses_2d(), poses_2d())
def test_adjoint_is_a_homomorphism(a: np.ndarray, b: np.ndarray) -> None:
    product = se2.adjoint(a) @ se2.adjoint(b)
    np.testing.assert_allclose(se2.adjoint(se2.compose(a, b)), product, atol=ATOL)


@given(poses_2d(), poses_2d(), vectors(2))
def test_matrices_act_like_poses(a: np.ndarray, b: np.ndarray, point: np.ndarray) -> None:
    np.testing.assert_allclose(se2.matrix(se2.compose(a, b)), se2.matrix(a) @ se2.matrix(b), atol=ATOL)
    np.testing.assert_allclose((se2.matrix(a) @ [*point, 1])[:2], se2.transform(a, point), atol=ATOL)
    np.testing.assert_allclose(se2.rotation(a[2]) @ point, se2.rotate(a[2], point), atol=ATOL)
    assert_same(se2.from_matrix(se2.matrix(a)), a)


@given(poses_2d(), poses_2d(), floats(0, 1))
def test_interpolation_starts_and_ends_where_asked_and_goes_straight(a: np.ndarray, b: np.ndarray, part: float) -> None:
    assert_same(se2.interpolate(a, b, 0.0), a)
    assert_same(se2.interpolate(a, b, 1.0), b)
    step = se2.log(se2.between(a, b))
    assert_same(se2.between(a, se2.interpolate(a, b, part)), se2.exp(part * step))


@given(poses_2d(), poses_2d(), tangents_2d())
def test_gtsam_agrees(a: np.ndarray, b: np.ndarray, xi: np.ndarray) -> None:
    A, B = to_gtsam(a), to_gtsam(b)
    assert_same(of_gtsam(A.compose(B)), se2.compose(a, b))
    assert_same(of_gtsam(A.between(B)), se2.between(a, b))
    assert_same(of_gtsam(A.inverse()), se2.inverse(a))
    # gtsam loses digits of (1 - cos) for small turns.
    assert_same(of_gtsam(gtsam.Pose2.Expmap(xi)), se2.exp(xi), atol=1e-6)
    np.testing.assert_allclose(A.AdjointMap(), se2.adjoint(a), atol=ATOL)
    np.testing.assert_allclose(A.matrix(), se2.matrix(a), atol=ATOL)


@given(tangents_2d())
def test_gtsam_logarithm_agrees(xi: np.ndarray) -> None:
    pose = se2.exp(xi)
    # gtsam loses digits of the translation at small turns.
    np.testing.assert_allclose(gtsam.Pose2.Logmap(to_gtsam(pose)), se2.log(pose), atol=1e-6, rtol=1e-6)


def test_headings_stay_in_the_half_open_turn() -> None:
    half = np.array([0.0, 0.0, np.pi])
    assert se2.inverse(half)[2] == np.pi
    assert se2.as_poses([0, 0, -np.pi])[2] == np.pi
    assert se2.exp([0, 0, -np.pi])[2] == np.pi
    turned = se2.matrix(half)
    turned[1, 0] = -0.0
    assert se2.from_matrix(turned)[2] == np.pi


def test_a_quarter_turn_on_a_circle() -> None:
    # Driving at pi/2 m/s while turning at pi/2 rad/s is a quarter of the unit circle.
    np.testing.assert_allclose(se2.exp([np.pi / 2, 0, np.pi / 2]), [1, 1, np.pi / 2], atol=1e-15)
    np.testing.assert_allclose(se2.transform([1, 2, np.pi / 2], [3, 0]), [1, 5], atol=1e-15)


@pytest.mark.parametrize("shape", [(), (1,), (0,), (5,), (2, 3)])
def test_every_function_keeps_batch_shapes(shape: tuple[int, ...]) -> None:
    rng = np.random.default_rng(0)
    a, b, xi = (rng.uniform(-1, 1, (*shape, 3)) for _ in range(3))
    assert se2.identity(shape).shape == (*shape, 3)
    for poses in (se2.compose(a, b), se2.between(a, b), se2.inverse(a), se2.exp(xi), se2.log(a), se2.as_poses(a)):
        assert poses.shape == (*shape, 3)
    assert se2.adjoint(a).shape == se2.matrix(a).shape == (*shape, 3, 3)
    assert se2.from_matrix(se2.matrix(a)).shape == (*shape, 3)
    assert se2.interpolate(a, b, np.full(shape, 0.5)).shape == (*shape, 3)
    assert se2.transform(a, xi[..., :2]).shape == (*shape, 2)


def test_batches_broadcast_and_equal_single_calls() -> None:
    rng = np.random.default_rng(1)
    a, b = rng.uniform(-3, 3, (4, 1, 3)), rng.uniform(-3, 3, (5, 3))
    table = se2.compose(a, b)
    assert table.shape == (4, 5, 3)
    for i in range(4):
        for j in range(5):
            np.testing.assert_array_equal(table[i, j], se2.compose(a[i, 0], b[j]))
    assert se2.transform(a[:, 0, None], rng.normal(size=(7, 2))).shape == (4, 7, 2)
    assert se2.interpolate(a[0, 0], a[1, 0], np.linspace(0, 1, 9)).shape == (9, 3)


@pytest.mark.parametrize(
    ("poses", "defect"),
    [([1.0, 2.0], "shape"), (3.0, "shape"), ([0, 0, np.nan], "NaN"), ([[0, np.inf, 0]], "infinity")],
)
def test_bad_poses_are_named(poses: object, defect: str) -> None:
    with pytest.raises(GeometryError, match=f"^start: .*{defect}"):
        se2.as_poses(poses, "start")


def test_the_way_is_the_sum_of_the_motions_lengths() -> None:
    assert se2.way([[3.0, 4.0, 1.0], [0.0, 0.0, 2.0], [0.0, -2.0, 0.0]]).tolist() == [0.0, 5.0, 5.0, 7.0]
    assert se2.way(np.zeros((0, 3))).tolist() == [0.0]
