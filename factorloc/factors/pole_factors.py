"""Pole factors: detections of one local map as stacked rows of a gtsam factor, and landmarks as variables."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import gtsam
import numpy as np
import numpy.typing as npt

from factorloc.errors import GeometryError
from factorloc.factors._custom import custom_factor
from factorloc.factors.pole_association import PoleAssociation
from factorloc.factors.pole_detections import PoleLandmarks
from factorloc.geometry import se2, se3
from factorloc.mapping.poles import Poles

__all__ = ["known_poles_factor", "landmark_factors", "landmark_priors", "pole_rows", "vertical_line_rows"]

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]


def known_poles_factor(
    key: int,
    detections: Poles,
    landmarks: PoleLandmarks,
    association: PoleAssociation,
    *,
    sigma: float = 0.13,
    null_cost: float = 4.5,
    spatial: bool = False,
) -> gtsam.CustomFactor:
    """Make a factor of all detections of a local map, two rows each, associated anew at every call.

    In the plane a row pair is the difference of detection and landmark. In space it says that a point of the detected
    axis, half-way up its span, lies on the vertical line of the landmark; height, and turns about the line, stay free.
    A row pair costs at most ``null_cost``, weighed inside (robust noise would weigh all rows as one block): beyond it,
    or without a landmark, it is a constant without derivative.

    In gtsam's *batch* optimizers every call of a Python factor copies all values; use
    :class:`~factorloc.factors.pole_term.PoleTerm` there.

    Parameters
    ----------
    key : int
        The pose, of Pose2 or, ``spatial``, of Pose3.
    detections : Poles
        In the frame of the body, K of them.
    landmarks : PoleLandmarks
        The map.
    association : PoleAssociation
        Names landmarks; in space, of the pose seen from above.
    sigma : float
        Standard deviation of a detection against its landmark, m.
    null_cost : float
        Cost of a detection without landmark.
    spatial : bool
        Whether the pose is in space.
    """
    rows, dimension = 2 * len(detections), 6 if spatial else 3
    points = detections.positions
    if spatial:
        points = np.column_stack([points, detections.spans.mean(1)])

    def residual(values: gtsam.Values, want_jacobians: bool) -> tuple[Array, list[Array]]:
        if spatial:
            pose = values.atPose3(key).matrix()
            planar = se3.to_se2(pose)
        else:
            native = values.atPose2(key)
            pose = planar = np.array([native.x(), native.y(), native.theta()])
        matches = association.associate(detections, landmarks, planar)
        make = vertical_line_rows if spatial else pole_rows
        error, jacobian = make(pose, points, landmarks.poles.positions[np.maximum(matches, 0)])
        error, jacobian = error / sigma, jacobian / sigma
        null = (matches < 0) | (0.5 * (error**2).sum(1) >= null_cost)
        error[null], jacobian[null] = [np.sqrt(2 * null_cost), 0.0], 0.0
        return error.ravel(), [jacobian.reshape(rows, dimension)] if want_jacobians else []

    return custom_factor(gtsam.noiseModel.Unit.Create(rows), [key], [dimension], rows, residual)


def pole_rows(pose: Array, points: Array, landmarks: Array) -> tuple[Array, Array]:
    """Differences of detections and landmarks in the map, with derivatives in the tangent space of the body.

    Parameters
    ----------
    pose : ndarray, shape (3,)
        ``T_map_body``.
    points : ndarray, shape (K, 2)
        Detections in the frame of the body, m.
    landmarks : ndarray, shape (K, 2)
        m.

    Returns
    -------
    error : ndarray, shape (K, 2)
    jacobian : ndarray, shape (K, 2, 3)
    """
    R = se2.rotation(pose[2])
    jacobian = np.zeros((len(points), 2, 3))
    jacobian[:, :, :2] = R
    jacobian[:, :, 2] = np.stack([-points[:, 1], points[:, 0]], -1) @ R.T
    return se2.transform(pose, points) - landmarks, jacobian


def vertical_line_rows(pose: Array, points: Array, landmarks: Array) -> tuple[Array, Array]:
    """Horizontal differences of points and vertical lines, with derivatives in the tangent space of the body.

    Parameters
    ----------
    pose : ndarray, shape (4, 4)
        ``T_map_body``.
    points : ndarray, shape (K, 3)
        In the frame of the body, m.
    landmarks : ndarray, shape (K, 2)
        Where the lines stand, m.

    Returns
    -------
    error : ndarray, shape (K, 2)
    jacobian : ndarray, shape (K, 2, 6)
    """
    R = pose[:3, :3]
    jacobian = np.zeros((len(points), 2, 6))
    x, y, z = points.T
    zero = np.zeros(len(points))
    # A turn omega of the body moves a point by R (omega x p) = -R [p]x omega.
    skew = np.stack([np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)], 1)
    jacobian[:, :, :3] = -(R @ skew)[:, :2]
    jacobian[:, :, 3:] = R[:2]
    return se3.transform(pose, points)[:, :2] - landmarks, jacobian


def landmark_factors(
    pose_keys: Sequence[int],
    landmark_keys: Sequence[int],
    points: npt.ArrayLike,
    sigma: float | npt.ArrayLike,
    huber: float = 2.0,
) -> Iterator[gtsam.NonlinearFactor]:
    """Native factors between planar poses and landmarks that are variables (Point2): mapping and localization in one.

    Bearing and range with ``sigma / range`` and ``sigma`` are, to first order, a point with the same deviation in every
    direction. Each factor is one detection, so that the Huber loss weighs it alone.

    Parameters
    ----------
    pose_keys, landmark_keys : sequence of int, length K
        Who saw whom.
    points : array_like, shape (K, 2)
        Detections in the frame of the body, m.
    sigma : float, or array_like of shape (K, 2)
        Standard deviation of a detection, m; or of bearings (rad) and ranges (m).
    huber : float
        Threshold of the loss, in standard deviations.

    Raises
    ------
    GeometryError
        If there are not as many keys as points, or a point is where the body is.
    """
    z = np.asarray(points, np.float64).reshape(-1, 2)
    if not len(pose_keys) == len(landmark_keys) == len(z):
        raise GeometryError(f"landmarks: {len(pose_keys)} poses, {len(landmark_keys)} landmarks, {len(z)} detections")
    ranges, bearings = np.hypot(z[:, 0], z[:, 1]), np.arctan2(z[:, 1], z[:, 0])
    if len(ranges) and ranges.min() < 1e-3:
        raise GeometryError("landmarks: a detection at the origin of the body has no bearing; leave it out")
    given = np.asarray(sigma, np.float64)
    sigmas = np.column_stack([given / ranges, np.full(len(z), given)]) if given.ndim == 0 else given
    if sigmas.shape != z.shape or not (sigmas > 0).all():
        raise GeometryError(f"landmarks: sigmas of shape {sigmas.shape}; a positive one, or two for each detection")
    loss = gtsam.noiseModel.mEstimator.Huber.Create(huber)
    for pose, landmark, bearing, distance, row in zip(pose_keys, landmark_keys, bearings, ranges, sigmas, strict=True):
        noise = gtsam.noiseModel.Robust.Create(loss, gtsam.noiseModel.Diagonal.Sigmas(row))
        yield gtsam.BearingRangeFactor2D(pose, landmark, gtsam.Rot2(bearing), distance, noise)


def landmark_priors(keys: Sequence[int], positions: npt.ArrayLike, sigma: float) -> Iterator[gtsam.NonlinearFactor]:
    """Priors of landmarks whose places (L, 2) a map knows up to a standard deviation, m."""
    noise = gtsam.noiseModel.Isotropic.Sigma(2, sigma)
    for key, position in zip(keys, np.asarray(positions, np.float64), strict=True):
        yield gtsam.PriorFactorPoint2(key, position, noise)
