"""Facade factors: points and lines of a scan on walls of a building map, stacked, one factor a scan.

Rows are weighed inside the factor, each by a Cauchy loss of its own: with ``rho(r) = c^2/2 log(1 + r^2/c^2)``, a row
is ``sign(r) sqrt(2 rho(r))``, so that half the sum of its squares is the loss. A robust noise model around a stacked
factor would weigh all rows as one.
"""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np
import numpy.typing as npt

from factorloc.errors import GeometryError
from factorloc.factors._custom import custom_factor
from factorloc.geometry import wrap

__all__ = ["FacadeLineFactor", "FacadePointFactor", "robust_rows"]

Array = npt.NDArray[np.float64]


def robust_rows(residual: Array, threshold: float) -> tuple[Array, Array]:
    """Rows whose half squares are Cauchy losses, and their derivatives by the residual.

    Parameters
    ----------
    residual : ndarray, shape (N,)
        Whitened.
    threshold : float
        c, in standard deviations; infinity for none.
    """
    if not np.isfinite(threshold):
        return residual, np.ones_like(residual)
    z = residual / threshold
    log = np.log1p(z * z)
    rows = np.sign(residual) * threshold * np.sqrt(log)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = np.abs(z) / (np.sqrt(log) * (1.0 + z * z))
    return rows, np.where(np.abs(z) < 1e-6, 1.0, slope)


def _arrays(given: dict[str, tuple[npt.ArrayLike, tuple[int, ...]]]) -> dict[str, Array]:
    arrays = {name: np.ascontiguousarray(values, np.float64) for name, (values, _) in given.items()}
    for name, (_, shape) in given.items():
        if arrays[name].shape != shape or not np.isfinite(arrays[name]).all():
            raise GeometryError(f"{name}: shape {arrays[name].shape}; expected finite numbers of shape {shape}")
    return arrays


@dataclass(frozen=True, eq=False)
class FacadePointFactor:
    """Points of one scan on facades: ``n . (R p + t) - d`` in the plane of the map, for each.

    Parameters
    ----------
    points : array_like, shape (N, D)
        In the frame of the body, m; planar for poses in the plane.
    normals : array_like, shape (N, 2)
        Unit normals of their facades.
    distances : array_like, shape (N,)
        Of the facades from the map's origin along the normals, m.
    sigmas : array_like, shape (N,)
        Standard deviations, m.
    cauchy : float
        Threshold of the robust loss, in standard deviations; infinity for none.

    Raises
    ------
    GeometryError
        If shapes differ, there is no point, a number is not finite, or a standard deviation or threshold not positive.
    """

    points: Array
    normals: Array
    distances: Array
    sigmas: Array
    cauchy: float = 2.0

    def __post_init__(self) -> None:
        n, d = np.shape(self.points) if np.ndim(self.points) == 2 else (0, 0)
        if n == 0 or d not in (2, 3):
            raise GeometryError(f"points: shape {np.shape(self.points)}; expected (N, 2) or (N, 3), at least one")
        given: dict[str, tuple[npt.ArrayLike, tuple[int, ...]]] = {
            "points": (self.points, (n, d)), "normals": (self.normals, (n, 2)), "distances": (self.distances, (n,)),
            "sigmas": (np.broadcast_to(self.sigmas, (n,)), (n,)),
        }  # fmt: skip
        for name, array in _arrays(given).items():
            object.__setattr__(self, name, array)
        if not ((self.sigmas > 0).all() and self.cauchy > 0):
            raise GeometryError("facade points: a standard deviation or the threshold is not positive")

    def rows(self, pose: Array, want_jacobian: bool = True) -> tuple[Array, Array]:
        """Residual, shape (N,), and its derivative by a perturbation of the body, shape (N, 3) or (N, 6).

        Parameters
        ----------
        pose : ndarray, shape (3,) or (4, 4)
            ``T_map_body``.
        want_jacobian : bool
            Whether to work out the derivative; zero otherwise.
        """
        R, t = _rotation_translation(pose)
        whitened = (self.normals / self.sigmas[:, None]) @ R[:2]
        d = R.shape[0]
        r = (whitened * self.points).sum(1) + ((self.normals @ t[:2]) - self.distances) / self.sigmas
        rows, slope = robust_rows(r, self.cauchy)
        J = np.zeros((len(r), 3 if d == 2 else 6))
        if want_jacobian:
            J[:, :] = np.concatenate([whitened, _moments(self.points, whitened)], 1) if d == 2 else (
                np.concatenate([_moments(self.points, whitened), whitened], 1)
            )  # fmt: skip
            J *= slope[:, None]
        return rows, J

    def factor(self, key: int) -> gtsam.CustomFactor:
        """Make the gtsam factor of a Pose2 (planar points) or a Pose3."""
        return _stacked(key, self, len(self.points), self.points.shape[1])


@dataclass(frozen=True, eq=False)
class FacadeLineFactor:
    """Lines of one scan on facades: of each the direction of its normal, and the distance of its middle.

    Parameters
    ----------
    middles : array_like, shape (N, D)
        A point of each line in the frame of the body, m, best its middle.
    directions : array_like, shape (N,)
        Of the lines' normals in the level frame of the body, rad.
    alphas, distances : array_like, shape (N,)
        Normals (rad) and distances (m) of the facades in the map.
    angle_sigmas, distance_sigmas : array_like, shape (N,)
        Standard deviations, rad and m.
    cauchy : float
        Threshold of the robust loss of every row, in standard deviations; infinity for none.

    Raises
    ------
    GeometryError
        If shapes differ, there is no line, a number is not finite, or a standard deviation or threshold not positive.
    """

    middles: Array
    directions: Array
    alphas: Array
    distances: Array
    angle_sigmas: Array
    distance_sigmas: Array
    cauchy: float = 2.0

    def __post_init__(self) -> None:
        n, d = np.shape(self.middles) if np.ndim(self.middles) == 2 else (0, 0)
        if n == 0 or d not in (2, 3):
            raise GeometryError(f"middles: shape {np.shape(self.middles)}; expected (N, 2) or (N, 3), at least one")
        given: dict[str, tuple[npt.ArrayLike, tuple[int, ...]]] = {"middles": (self.middles, (n, d))}
        for name in ("directions", "alphas", "distances", "angle_sigmas", "distance_sigmas"):
            given[name] = (np.broadcast_to(getattr(self, name), (n,)), (n,))
        for name, array in _arrays(given).items():
            object.__setattr__(self, name, array)
        if not ((self.angle_sigmas > 0).all() and (self.distance_sigmas > 0).all() and self.cauchy > 0):
            raise GeometryError("facade lines: a standard deviation or the threshold is not positive")

    def rows(self, pose: Array, want_jacobian: bool = True) -> tuple[Array, Array]:
        """Residual, shape (2 N,), angles first, and its derivative; see :meth:`FacadePointFactor.rows`."""
        R, _ = _rotation_translation(pose)
        d, n = R.shape[0], len(self.alphas)
        local = np.zeros((n, d))
        local[:, 0], local[:, 1] = np.cos(self.directions), np.sin(self.directions)
        turned = local @ R.T
        angle = wrap(np.arctan2(turned[:, 1], turned[:, 0]) - self.alphas) / self.angle_sigmas
        normals = np.stack([np.cos(self.alphas), np.sin(self.alphas)], -1)
        points = FacadePointFactor(self.middles, normals, self.distances, self.distance_sigmas, np.inf)
        distance, by_pose = points.rows(pose, want_jacobian)
        rows, slope = robust_rows(np.concatenate([angle, distance]), self.cauchy)
        J = np.zeros((2 * n, by_pose.shape[1]))
        if want_jacobian:
            # d atan2 = (x dy - y dx) / (x^2 + y^2), and the vector moves by R (omega x local).
            square = turned[:, 0] ** 2 + turned[:, 1] ** 2
            by_vector = np.stack([-turned[:, 1], turned[:, 0]], -1) / (square * self.angle_sigmas)[:, None]
            moments = _moments(local, by_vector @ R[:2])
            J[:n, 2:] = moments if d == 2 else 0.0
            if d == 3:
                J[:n, :3] = moments
            J[n:] = by_pose
            J *= slope[:, None]
        return rows, J

    def factor(self, key: int) -> gtsam.CustomFactor:
        """Make the gtsam factor of a Pose2 (planar middles) or a Pose3."""
        return _stacked(key, self, 2 * len(self.alphas), self.middles.shape[1])


def _rotation_translation(pose: Array) -> tuple[Array, Array]:
    if pose.ndim == 2:
        return pose[:3, :3], pose[:3, 3]
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.array([[c, -s], [s, c]]), pose[:2]


def _moments(points: Array, forces: Array) -> Array:
    """Derivatives of ``forces . (turned points)`` by a turn of the body: ``points x forces``, (N, 1) in the plane."""
    if points.shape[1] == 2:
        return np.asarray(points[:, :1] * forces[:, 1:] - points[:, 1:] * forces[:, :1])
    return np.cross(points, forces)


def _stacked(
    key: int, measurement: FacadePointFactor | FacadeLineFactor, rows: int, dimension: int
) -> gtsam.CustomFactor:
    def residual(values: gtsam.Values, want_jacobians: bool) -> tuple[Array, list[Array]]:
        if dimension == 2:
            pose = values.atPose2(key)
            at = np.array([pose.x(), pose.y(), pose.theta()])
        else:
            at = values.atPose3(key).matrix()
        error, J = measurement.rows(at, want_jacobians)
        return error, [J] if want_jacobians else []

    freedom = 3 if dimension == 2 else 6
    return custom_factor(gtsam.noiseModel.Unit.Create(rows), [key], [freedom], rows, residual)
