"""Rigid motions of space: homogeneous matrices of shape (..., 4, 4), translations in m.

Tangent vectors are ``[omega, v]`` (rotation first, as in gtsam). Rotations are converted by scipy.
"""

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from factorloc.errors import GeometryError
from factorloc.geometry.angles import wrap

__all__ = [
    "adjoint",
    "as_poses",
    "between",
    "compose",
    "exp",
    "from_quaternion",
    "from_se2",
    "identity",
    "interpolate",
    "inverse",
    "log",
    "quaternion",
    "to_se2",
    "transform",
]

Array = npt.NDArray[np.float64]

_SMALL = 1e-4  # below this angle a Taylor series replaces quotients of vanishing numbers
_RIGID_TOLERANCE = 1e-6


def as_poses(poses: npt.ArrayLike, name: str = "poses") -> Array:
    """Check and convert poses.

    Parameters
    ----------
    poses : array_like, shape (..., 4, 4)
        Homogeneous matrices.
    name : str
        What to call them in an error message.

    Returns
    -------
    ndarray, shape (..., 4, 4)
        Float64.

    Raises
    ------
    GeometryError
        If a matrix is not 4 x 4, not finite or not a rigid motion (to 1e-6).
    """
    array = np.array(poses, np.float64)
    if array.shape[-2:] != (4, 4):
        raise GeometryError(f"{name}: shape {array.shape}; spatial poses are 4 x 4 matrices")
    if not np.isfinite(array).all():
        raise GeometryError(f"{name}: holds NaN or infinity; remove those poses")
    R = array[..., :3, :3]
    defect = np.abs(np.swapaxes(R, -1, -2) @ R - np.eye(3)).max(initial=0.0)
    bottom = np.abs(array[..., 3, :] - [0, 0, 0, 1]).max(initial=0.0)
    if max(defect, bottom) > _RIGID_TOLERANCE or (np.linalg.det(R) < 0).any():
        raise GeometryError(f"{name}: no rigid motions (defect {max(defect, bottom):.2g}); make rotations orthonormal")
    return array


def identity(shape: tuple[int, ...] = ()) -> Array:
    """Poses that do not move anything, shape ``(*shape, 4, 4)``."""
    return np.broadcast_to(np.eye(4), (*shape, 4, 4)).copy()


def transform(T_a_b: npt.ArrayLike, points_b: npt.ArrayLike) -> Array:
    """Map points (..., 3) of frame b into frame a by poses (..., 4, 4)."""
    pose, points = np.asarray(T_a_b, np.float64), np.asarray(points_b, np.float64)
    return np.asarray(np.einsum("...ij,...j->...i", pose[..., :3, :3], points) + pose[..., :3, 3])


def compose(T_a_b: npt.ArrayLike, T_b_c: npt.ArrayLike) -> Array:
    """Chain poses: ``T_a_c = T_a_b * T_b_c``."""
    return np.asarray(np.asarray(T_a_b, np.float64) @ np.asarray(T_b_c, np.float64))


def inverse(T_a_b: npt.ArrayLike) -> Array:
    """Turn poses around: ``T_b_a``."""
    pose = np.asarray(T_a_b, np.float64)
    result = np.zeros_like(pose)
    R_t = np.swapaxes(pose[..., :3, :3], -1, -2)
    result[..., :3, :3] = R_t
    result[..., :3, 3] = -np.einsum("...ij,...j->...i", R_t, pose[..., :3, 3])
    result[..., 3, 3] = 1
    return result


def between(T_a_b: npt.ArrayLike, T_a_c: npt.ArrayLike) -> Array:
    """Relative poses: ``T_b_c = inverse(T_a_b) * T_a_c``."""
    return compose(inverse(T_a_b), T_a_c)


def _skew(v: Array) -> Array:
    zero = np.zeros(v.shape[:-1])
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    rows = [np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)]
    return np.stack(rows, -2)


def _rotation_of(rotvec: Array) -> Array:
    return Rotation.from_rotvec(rotvec.reshape(-1, 3)).as_matrix().reshape(*rotvec.shape[:-1], 3, 3)


def _rotvec_of(R: Array) -> Array:
    return Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec().reshape(*R.shape[:-2], 3)


def exp(xi: npt.ArrayLike) -> Array:
    """Poses reached by constant body velocities ``[omega, v]`` (..., 6) after unit time, shape (..., 4, 4)."""
    xi = np.asarray(xi, np.float64)
    omega, v = xi[..., :3], xi[..., 3:]
    angle = np.linalg.norm(omega, axis=-1)[..., None, None]
    small = angle < _SMALL
    safe = np.where(small, 1.0, angle)
    b = np.where(small, 0.5 - angle**2 / 24, 2 * (np.sin(safe / 2) / safe) ** 2)
    c = np.where(small, 1 / 6 - angle**2 / 120, (safe - np.sin(safe)) / safe**3)
    W = _skew(omega)
    result = identity(xi.shape[:-1])
    result[..., :3, :3] = _rotation_of(omega)
    result[..., :3, 3] = np.einsum("...ij,...j->...i", np.eye(3) + b * W + c * (W @ W), v)
    return result


def log(T_a_b: npt.ArrayLike) -> Array:
    """Tangent vectors ``[omega, v]`` (..., 6) of poses, the inverse of :func:`exp` for angles below pi."""
    pose = np.asarray(T_a_b, np.float64)
    omega = _rotvec_of(pose[..., :3, :3])
    angle = np.linalg.norm(omega, axis=-1)[..., None, None]
    small = angle < _SMALL
    safe = np.where(small, 1.0, angle)
    half = safe / 2
    d = np.where(small, 1 / 12 + angle**2 / 720, (1 - half / np.tan(half)) / safe**2)
    W = _skew(omega)
    v = np.einsum("...ij,...j->...i", np.eye(3) - W / 2 + d * (W @ W), pose[..., :3, 3])
    return np.concatenate([omega, v], -1)


def adjoint(T_a_b: npt.ArrayLike) -> Array:
    """Matrices (..., 6, 6) that carry tangent vectors of frame b to frame a: ``T exp(xi) = exp(Ad xi) T``."""
    pose = np.asarray(T_a_b, np.float64)
    R = pose[..., :3, :3]
    result = np.zeros((*pose.shape[:-2], 6, 6))
    result[..., :3, :3] = R
    result[..., 3:, 3:] = R
    result[..., 3:, :3] = _skew(pose[..., :3, 3]) @ R
    return result


def interpolate(T_a_b: npt.ArrayLike, T_a_c: npt.ArrayLike, fraction: npt.ArrayLike) -> Array:
    """Poses on the geodesic from ``T_a_b`` (fraction 0) to ``T_a_c`` (fraction 1)."""
    fraction = np.asarray(fraction, np.float64)
    return compose(T_a_b, exp(fraction[..., None] * log(between(T_a_b, T_a_c))))


def quaternion(T_a_b: npt.ArrayLike) -> Array:
    """Unit quaternions ``[q_x, q_y, q_z, q_w]`` (..., 4) of poses, with q_w >= 0."""
    R = np.asarray(T_a_b, np.float64)[..., :3, :3]
    return Rotation.from_matrix(R.reshape(-1, 3, 3)).as_quat(canonical=True).reshape(*R.shape[:-2], 4)


def from_quaternion(translation: npt.ArrayLike, quaternions: npt.ArrayLike) -> Array:
    """Poses of translations (..., 3) and quaternions ``[q_x, q_y, q_z, q_w]`` (..., 4), which are normalized.

    Raises
    ------
    GeometryError
        If a quaternion is zero or not finite.
    """
    t, q = np.asarray(translation, np.float64), np.asarray(quaternions, np.float64)
    norm = np.linalg.norm(q, axis=-1)
    if not (np.isfinite(norm) & (norm > 1e-9)).all():
        raise GeometryError("quaternions: one is zero or not finite; its rotation is unknown")
    result = identity(t.shape[:-1])
    result[..., :3, :3] = Rotation.from_quat(q.reshape(-1, 4)).as_matrix().reshape(*q.shape[:-1], 3, 3)
    result[..., :3, 3] = t
    return result


def from_se2(poses: npt.ArrayLike) -> Array:
    """Planar poses (..., 3) as motions of space in the plane z = 0."""
    p = np.asarray(poses, np.float64)
    result = identity(p.shape[:-1])
    c, s = np.cos(p[..., 2]), np.sin(p[..., 2])
    result[..., 0, 0], result[..., 0, 1], result[..., 1, 0], result[..., 1, 1] = c, -s, s, c
    result[..., :2, 3] = p[..., :2]
    return result


def to_se2(poses: npt.ArrayLike) -> Array:
    """Project poses (..., 4, 4) onto the plane: position x, y and yaw, shape (..., 3)."""
    p = np.asarray(poses, np.float64)
    return np.stack([p[..., 0, 3], p[..., 1, 3], wrap(np.arctan2(p[..., 1, 0], p[..., 0, 0]))], -1)
