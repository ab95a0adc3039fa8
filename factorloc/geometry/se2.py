"""Rigid motions of the plane: poses ``[x, y, theta]`` in rows of shape (..., 3), in m, m, rad.

Headings are kept in (-pi, pi]. Exponential and logarithm are the group's own (a tangent vector is a constant body
velocity over unit time), as in gtsam 4.3.
"""

import numpy as np
import numpy.typing as npt

from factorloc.errors import GeometryError
from factorloc.geometry.angles import wrap

__all__ = [
    "adjoint",
    "as_poses",
    "between",
    "compose",
    "exp",
    "from_matrix",
    "identity",
    "interpolate",
    "inverse",
    "log",
    "matrix",
    "rotate",
    "rotation",
    "transform",
    "way",
]

Array = npt.NDArray[np.float64]

_SMALL = 1e-4  # below this angle the series of sin(a)/a is exact to double precision


def as_poses(poses: npt.ArrayLike, name: str = "poses") -> Array:
    """Check and convert poses.

    Parameters
    ----------
    poses : array_like, shape (..., 3)
        Rows ``[x, y, theta]``.
    name : str
        What to call them in an error message.

    Returns
    -------
    ndarray, shape (..., 3)
        Float64, headings in (-pi, pi].

    Raises
    ------
    GeometryError
        If the last axis is not 3 long or a value is not finite.
    """
    array = np.array(poses, np.float64)
    if array.ndim == 0 or array.shape[-1] != 3:
        raise GeometryError(f"{name}: shape {array.shape}; planar poses are rows [x, y, theta]")
    if not np.isfinite(array).all():
        raise GeometryError(f"{name}: holds NaN or infinity; remove those rows")
    array[..., 2] = wrap(array[..., 2])
    return array


def identity(shape: tuple[int, ...] = ()) -> Array:
    """Return poses that do not move anything, shape ``(*shape, 3)``."""
    return np.zeros((*shape, 3))


def rotation(theta: npt.ArrayLike) -> Array:
    """Rotation matrices of headings, shape (..., 2, 2)."""
    theta = np.asarray(theta, np.float64)
    c, s = np.cos(theta), np.sin(theta)
    return np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2)


def rotate(theta: npt.ArrayLike, vectors: npt.ArrayLike) -> Array:
    """Turn vectors (..., 2) by angles (...)."""
    vectors = np.asarray(vectors, np.float64)
    c, s = np.cos(theta), np.sin(theta)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([c * x - s * y, s * x + c * y], -1)


def transform(T_a_b: npt.ArrayLike, points_b: npt.ArrayLike) -> Array:
    """Map points (..., 2) of frame b into frame a by poses (..., 3)."""
    T_a_b = np.asarray(T_a_b, np.float64)
    return np.asarray(rotate(T_a_b[..., 2], points_b) + T_a_b[..., :2])


def compose(T_a_b: npt.ArrayLike, T_b_c: npt.ArrayLike) -> Array:
    """Chain poses: ``T_a_c = T_a_b * T_b_c``, shapes (..., 3)."""
    first, second = np.asarray(T_a_b, np.float64), np.asarray(T_b_c, np.float64)
    return np.concatenate([transform(first, second[..., :2]), wrap(first[..., 2] + second[..., 2])[..., None]], axis=-1)


def inverse(T_a_b: npt.ArrayLike) -> Array:
    """Turn poses around: ``T_b_a``, shape (..., 3)."""
    pose = np.asarray(T_a_b, np.float64)
    return np.concatenate([-rotate(-pose[..., 2], pose[..., :2]), wrap(-pose[..., 2])[..., None]], axis=-1)


def between(T_a_b: npt.ArrayLike, T_a_c: npt.ArrayLike) -> Array:
    """Relative poses: ``T_b_c = inverse(T_a_b) * T_a_c``, shapes (..., 3)."""
    return compose(inverse(T_a_b), T_a_c)


def _half_tangent(theta: Array) -> tuple[Array, Array]:
    """``sin(theta)/theta`` and ``(1 - cos(theta))/theta``, with their limits at 0."""
    small = np.abs(theta) < _SMALL
    safe = np.where(small, 1.0, theta)
    a = np.where(small, 1 - theta**2 / 6, np.sin(safe) / safe)
    b = np.where(small, theta / 2 - theta**3 / 24, 2 * np.sin(safe / 2) ** 2 / safe)
    return a, b


def exp(xi: npt.ArrayLike) -> Array:
    """Poses reached by constant body velocities ``[v_x, v_y, omega]`` after unit time, shape (..., 3)."""
    xi = np.asarray(xi, np.float64)
    a, b = _half_tangent(xi[..., 2])
    x, y = xi[..., 0], xi[..., 1]
    return np.stack([a * x - b * y, b * x + a * y, wrap(xi[..., 2])], -1)


def log(T_a_b: npt.ArrayLike) -> Array:
    """Tangent vectors of poses, the inverse of :func:`exp` for headings in (-pi, pi]."""
    pose = np.asarray(T_a_b, np.float64)
    theta = wrap(pose[..., 2])
    a, b = _half_tangent(theta)
    x, y = pose[..., 0], pose[..., 1]
    scale = 1 / (a * a + b * b)
    return np.stack([scale * (a * x + b * y), scale * (a * y - b * x), theta], -1)


def adjoint(T_a_b: npt.ArrayLike) -> Array:
    """Matrices (..., 3, 3) that carry tangent vectors of frame b to frame a: ``T exp(xi) = exp(Ad xi) T``."""
    pose = np.asarray(T_a_b, np.float64)
    result = np.zeros((*pose.shape[:-1], 3, 3))
    result[..., :2, :2] = rotation(pose[..., 2])
    result[..., 0, 2] = pose[..., 1]
    result[..., 1, 2] = -pose[..., 0]
    result[..., 2, 2] = 1
    return result


def interpolate(T_a_b: npt.ArrayLike, T_a_c: npt.ArrayLike, fraction: npt.ArrayLike) -> Array:
    """Poses on the geodesic from ``T_a_b`` (fraction 0) to ``T_a_c`` (fraction 1)."""
    fraction = np.asarray(fraction, np.float64)
    return compose(T_a_b, exp(fraction[..., None] * log(between(T_a_b, T_a_c))))


def matrix(T_a_b: npt.ArrayLike) -> Array:
    """Homogeneous matrices (..., 3, 3) of poses."""
    pose = np.asarray(T_a_b, np.float64)
    result = np.zeros((*pose.shape[:-1], 3, 3))
    result[..., :2, :2] = rotation(pose[..., 2])
    result[..., :2, 2] = pose[..., :2]
    result[..., 2, 2] = 1
    return result


def from_matrix(matrices: npt.ArrayLike) -> Array:
    """Poses (..., 3) of homogeneous matrices (..., 3, 3)."""
    m = np.asarray(matrices, np.float64)
    return np.stack([m[..., 0, 2], m[..., 1, 2], wrap(np.arctan2(m[..., 1, 0], m[..., 0, 0]))], -1)


def way(motions: npt.ArrayLike) -> Array:
    """Way driven up to each of N poses, shape (N,), m, by the motions (N - 1, 3) between them."""
    steps = np.asarray(motions, np.float64)
    return np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])
