"""Laws of SE(3), sampled near the identity and near half a turn, and equality with gtsam.Pose3 and SE(2)."""

import gtsam
import numpy as np
import pytest
from hypothesis import given
from strategies import floats, poses_2d, poses_3d, tangents_2d, tangents_3d, vectors

from factorloc.errors import GeometryError
from factorloc.geometry import se2, se3

ATOL = 1e-11


def assert_same(first: np.ndarray, second: np.ndarray, atol: float = ATOL) -> None:
    np.testing.assert_allclose(first, second, atol=atol)


@given(poses_3d(), poses_3d(), poses_3d())
def test_composition_is_associative(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> None:
    assert_same(se3.compose(se3.compose(a, b), c), se3.compose(a, se3.compose(b, c)))


@given(poses_3d())
def test_identity_and_inverse(a: np.ndarray) -> None:
    e = se3.identity()
    assert_same(se3.compose(a, e), a)
    assert_same(se3.compose(e, a), a)
    assert_same(se3.compose(a, se3.inverse(a)), e)
    assert_same(se3.compose(se3.inverse(a), a), e)
    assert_same(se3.inverse(a), np.linalg.inv(a))


@given(poses_3d(), poses_3d())
def test_between_is_the_step_from_one_pose_to_the_other(a: np.ndarray, b: np.ndarray) -> None:
    assert_same(se3.compose(a, se3.between(a, b)), b)


@given(tangents_3d())
def test_logarithm_undoes_exponential(xi: np.ndarray) -> None:
    np.testing.assert_allclose(se3.log(se3.exp(xi)), xi, atol=1e-8, rtol=1e-8)


@given(tangents_3d(1e-3))
def test_logarithm_undoes_exponential_near_the_identity_to_rounding(xi: np.ndarray) -> None:
    np.testing.assert_allclose(se3.log(se3.exp(xi)), xi, atol=1e-13, rtol=1e-13)


@given(poses_3d())
def test_exponential_undoes_logarithm(a: np.ndarray) -> None:
    assert_same(se3.exp(se3.log(a)), a)


@given(tangents_3d(), floats(0.1, 0.9))
def test_exponential_of_one_direction_is_a_path(xi: np.ndarray, part: float) -> None:
    assert_same(se3.compose(se3.exp(part * xi), se3.exp((1 - part) * xi)), se3.exp(xi))


@given(poses_3d(), tangents_3d())
def test_adjoint_carries_body_motions_to_the_world(a: np.ndarray, xi: np.ndarray) -> None:
    assert_same(se3.compose(a, se3.exp(xi)), se3.compose(se3.exp(se3.adjoint(a) @ xi), a), atol=1e-9)


@given(poses_3d(), poses_3d())
def test_adjoint_is_a_homomorphism(a: np.ndarray, b: np.ndarray) -> None:
    assert_same(se3.adjoint(se3.compose(a, b)), se3.adjoint(a) @ se3.adjoint(b))


@given(poses_3d(), vectors(3))
def test_poses_act_on_points(a: np.ndarray, point: np.ndarray) -> None:
    assert_same(se3.transform(a, point), (a @ [*point, 1])[:3])


@given(poses_3d(), poses_3d(), floats(0, 1))
def test_interpolation_starts_and_ends_where_asked_and_goes_straight(a: np.ndarray, b: np.ndarray, part: float) -> None:
    assert_same(se3.interpolate(a, b, 0.0), a)
    assert_same(se3.interpolate(a, b, 1.0), b)
    step = se3.log(se3.between(a, b))
    assert_same(se3.between(a, se3.interpolate(a, b, part)), se3.exp(part * step))


@given(poses_3d())
def test_quaternions_keep_the_rotation(a: np.ndarray) -> None:
    q = se3.quaternion(a)
    assert abs(np.linalg.norm(q) - 1) < 1e-14
    assert q[3] >= 0
    assert_same(se3.from_quaternion(a[:3, 3], q), a)
    assert_same(se3.from_quaternion(a[:3, 3], -7 * q), a)


@given(poses_3d(), poses_3d(), tangents_3d(np.pi - 1e-3))
def test_gtsam_agrees(a: np.ndarray, b: np.ndarray, xi: np.ndarray) -> None:
    A, B = gtsam.Pose3(a), gtsam.Pose3(b)
    assert_same(A.compose(B).matrix(), se3.compose(a, b))
    assert_same(A.between(B).matrix(), se3.between(a, b))
    assert_same(A.inverse().matrix(), se3.inverse(a))
    assert_same(A.AdjointMap(), se3.adjoint(a))
    assert_same(gtsam.Pose3.Expmap(xi).matrix(), se3.exp(xi), atol=1e-9)
    pose = se3.exp(xi)
    np.testing.assert_allclose(gtsam.Pose3.Logmap(gtsam.Pose3(pose)), se3.log(pose), atol=1e-6, rtol=1e-6)


@given(poses_2d(), poses_2d(), tangents_2d(), vectors(2))
def test_the_plane_is_a_subgroup(a: np.ndarray, b: np.ndarray, xi: np.ndarray, point: np.ndarray) -> None:
    A, B = se3.from_se2(a), se3.from_se2(b)
    assert_same(se3.compose(A, B), se3.from_se2(se2.compose(a, b)))
    assert_same(se3.transform(A, [*point, 0])[:2], se2.transform(a, point))
    assert_same(se3.exp([0, 0, xi[2], xi[0], xi[1], 0]), se3.from_se2(se2.exp(xi)))
    np.testing.assert_array_equal(A[np.ix_([0, 1, 3], [0, 1, 3])], se2.matrix(a))
    np.testing.assert_allclose(se3.to_se2(A), a, atol=1e-15)
    # The adjoint, with the coordinates reordered and the rest left out.
    order = [3, 4, 2]
    np.testing.assert_allclose(se3.adjoint(A)[np.ix_(order, order)], se2.adjoint(a), atol=ATOL)


def test_projected_headings_stay_in_the_half_open_turn() -> None:
    turned = se3.from_se2([0, 0, np.pi])
    turned[1, 0] = -0.0
    assert se3.to_se2(turned)[2] == np.pi


@pytest.mark.parametrize("shape", [(), (1,), (0,), (5,), (2, 3)])
def test_every_function_keeps_batch_shapes(shape: tuple[int, ...]) -> None:
    rng = np.random.default_rng(0)
    xi = rng.uniform(-1, 1, (*shape, 6))
    a, b = se3.exp(xi), se3.exp(-2 * xi)
    assert se3.identity(shape).shape == (*shape, 4, 4)
    for poses in (a, se3.compose(a, b), se3.between(a, b), se3.inverse(a), se3.as_poses(a)):
        assert poses.shape == (*shape, 4, 4)
    assert se3.log(a).shape == (*shape, 6)
    assert se3.adjoint(a).shape == (*shape, 6, 6)
    assert se3.quaternion(a).shape == (*shape, 4)
    assert se3.from_quaternion(a[..., :3, 3], se3.quaternion(a)).shape == (*shape, 4, 4)
    assert se3.interpolate(a, b, np.full(shape, 0.5)).shape == (*shape, 4, 4)
    assert se3.transform(a, xi[..., :3]).shape == (*shape, 3)
    assert se3.from_se2(se3.to_se2(a)).shape == (*shape, 4, 4)


def test_batches_broadcast_and_equal_single_calls() -> None:
    rng = np.random.default_rng(1)
    a, b = se3.exp(rng.uniform(-1, 1, (4, 1, 6))), se3.exp(rng.uniform(-1, 1, (5, 6)))
    table = se3.compose(a, b)
    assert table.shape == (4, 5, 4, 4)
    for i in range(4):
        for j in range(5):
            assert_same(table[i, j], se3.compose(a[i, 0], b[j]), atol=1e-15)
    assert se3.transform(a[:, 0, None], rng.normal(size=(7, 3))).shape == (4, 7, 3)
    assert se3.interpolate(b[0], b[1], np.linspace(0, 1, 9)).shape == (9, 4, 4)


@pytest.mark.parametrize(
    ("poses", "defect"),
    [
        (np.eye(3), "shape"),
        (1.0, "shape"),
        (np.full((4, 4), np.nan), "NaN"),
        (np.diag([1.0, 1.0, 1.1, 1.0]), "rigid"),
        (np.diag([1.0, 1.0, -1.0, 1.0]), "rigid"),
        (np.diag([1.0, 1.0, 1.0, 2.0]), "rigid"),
    ],
)
def test_bad_poses_are_named(poses: object, defect: str) -> None:
    with pytest.raises(GeometryError, match=f"^start: .*{defect}"):
        se3.as_poses(poses, "start")


@pytest.mark.parametrize("quaternion", [[0, 0, 0, 0], [0, 0, np.nan, 1]])
def test_a_quaternion_without_direction_is_refused(quaternion: list[float]) -> None:
    with pytest.raises(GeometryError, match=r"^quaternions: .*zero or not finite"):
        se3.from_quaternion(np.zeros(3), quaternion)
