"""How good bounds are: whether they enclose the truth, and how small they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from factorloc.errors import EvaluationError
from factorloc.result import Bounds

__all__ = ["BoundCoverage", "bound_coverage", "bound_radii"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class BoundCoverage:
    """Coverage and size of the bounds of N poses.

    Parameters
    ----------
    encloses : ndarray of bool, shape (N,)
        Whether the true pose is inside: position in a polygon, heading in the interval. An empty set encloses nothing.
    radii : ndarray, shape (N, 3)
        Smaller and larger radius (m) and half of the interval (rad); NaN for empty sets.
    """

    encloses: npt.NDArray[np.bool_]
    radii: Array

    @property
    def share(self) -> float:
        """Part of the poses that are enclosed; empty sets count as failures."""
        return float(self.encloses.mean())

    @property
    def empty(self) -> float:
        """Part of the sets that are empty."""
        return float(np.isnan(self.radii[:, 0]).mean())

    @property
    def mean_radii(self) -> Array:
        """Means over the sets that are not empty, shape (3,): m, m, rad."""
        return np.asarray(np.nanmean(self.radii, 0)) if self.empty < 1 else np.full(3, np.nan)


def bound_radii(bounds: Bounds) -> tuple[float, float, float]:
    """Half sides of the smallest rectangle around all polygons, smaller first (m), and half of the interval (rad)."""
    if bounds.is_empty:
        return (np.nan,) * 3
    rectangle = shapely.minimum_rotated_rectangle(shapely.MultiPoint(np.concatenate(bounds.polygons)))
    corners = shapely.get_coordinates(rectangle)
    sides = np.hypot(*np.diff(corners[:3], axis=0).T) / 2 if len(corners) > 2 else np.zeros(2)
    low, high = bounds.orientation
    return float(sides.min()), float(sides.max()), 0.5 * (high - low)


def bound_coverage(bounds: Sequence[Bounds], truth: npt.ArrayLike) -> BoundCoverage:
    """Compare bounds with true poses.

    Parameters
    ----------
    bounds : sequence of Bounds
        One a pose.
    truth : array_like, shape (N, 3)
        ``[x, y, theta]``.

    Raises
    ------
    EvaluationError
        If there are none, or not as many of either.
    """
    poses = np.asarray(truth, np.float64)
    if not len(bounds) or poses.shape != (len(bounds), 3):
        raise EvaluationError(f"bounds: {len(bounds)} for true poses of shape {poses.shape}; give (N, 3), one each")
    encloses = np.array([one.contains(pose) for one, pose in zip(bounds, poses, strict=True)], np.bool_)
    return BoundCoverage(encloses, np.array([bound_radii(one) for one in bounds]))
