"""Poles as a scan term: the detections of every local map against landmarks, associated anew at every evaluation."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from factorloc.errors import GeometryError, MapError
from factorloc.factors._pole_kernels import match_places, pole_batch
from factorloc.factors.pole_detections import PoleDetections, PoleLandmarks, PoleMixture
from factorloc.factors.scan_term import ScanCosts
from factorloc.geometry import se2
from factorloc.mapping.point_cells import PointCells

__all__ = ["PoleTerm"]

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]

_LEAST_CELL = 2.0  # m; smaller cells are more work than they save


class PoleTerm:
    """Max-mixture of pole detections with a null hypothesis (Olson and Agarwal, IJRR 2013), in the plane.

    The cost of a detection is that of its likeliest explanation (:class:`PoleMixture`): the landmark with the largest
    likelihood ratio, or none, at cost 0. So association is part of every evaluation, a detection without a landmark
    pulls at nothing, and the loss is robust by itself: never wrap it in another. Levels are blurred: standard
    deviations are widened by the blur, and with them the gate.

    Parameters
    ----------
    detections : PoleDetections
        Of S local maps, one a pose.
    landmarks : PoleLandmarks
        The map.
    mixture : PoleMixture, optional
        The model.
    information : float
        Factor of all costs: the error of a landmark is the same in all local maps that see it, so that they count less
        than independent ones.
    blurs : sequence of float
        Blur of the levels, m, coarse to fine.

    Raises
    ------
    MapError
        If there are no landmarks, they lie too far apart, or the blurs do not decrease.
    """

    def __init__(
        self,
        detections: PoleDetections,
        landmarks: PoleLandmarks,
        mixture: PoleMixture | None = None,
        information: float = 1.0,
        blurs: Sequence[float] = (1.0, 0.5, 0.25, 0.0),
    ) -> None:
        if len(landmarks) == 0:
            raise MapError("landmarks: none; a map without poles localizes nothing")
        if not blurs or min(blurs) < 0 or any(a <= b for a, b in itertools.pairwise(blurs)):
            raise MapError(f"blurs: {tuple(blurs)} m; expected decreasing lengths, 0 at the end for the map itself")
        self.detections, self.landmarks = detections, landmarks
        self.mixture = mixture = mixture or PoleMixture()
        self.information = information
        self._blurs = tuple(float(blur) for blur in blurs)
        self._columns = detections.columns(mixture)
        self._numbers = np.array([mixture.width_sigma**-2, mixture.height_sigma**-2, mixture.attribute_cap])
        attributes = landmarks.columns(mixture)
        self._cells = [
            PointCells.of(landmarks.poles.positions, max(self.gate(blur), _LEAST_CELL)) for blur in self._blurs
        ]
        self._attributes = [np.ascontiguousarray(attributes[cells.order]) for cells in self._cells]

    @property
    def scans(self) -> int:
        """Number of local maps."""
        return len(self.detections)

    @property
    def blurs(self) -> tuple[float, ...]:
        """Blur of each level, m."""
        return self._blurs

    def gate(self, blur: float = 0.0) -> float:
        """Farthest that a detection may be from its landmark, m."""
        mixture = self.mixture
        variance = mixture.sigma**2 + mixture.landmark_sigma**2 + blur**2
        rarest = float(self._columns[:, 3].min(initial=np.log(mixture.clutter)))
        return float(np.sqrt(2 * variance * max(-np.log(2 * np.pi * variance) - rarest, 0.0)))

    def batch(self, poses: npt.ArrayLike, level: int = -1, scan_of_pose: npt.ArrayLike | None = None) -> ScanCosts:
        """Cost, gradient and Hessian at poses ``T_map_body`` (N, 3); pose ``n`` is of local map ``n`` unless told.

        Raises
        ------
        GeometryError
            If poses are not finite planar rows or do not fit the local maps.
        """
        array = se2.as_poses(poses)
        own = np.arange(len(array)) if scan_of_pose is None else np.asarray(scan_of_pose)
        index = np.ascontiguousarray(own, np.int64)
        fits = index.shape == array.shape[:1] and array.ndim == 2
        if not fits or (len(index) and not (index.min() >= 0 and index.max() < self.scans)):
            raise GeometryError(f"poses: shape {array.shape} does not fit {self.scans} local maps")
        n = len(array)
        cost, gradient, hessian = np.empty(n), np.empty((n, 3)), np.empty((n, 3, 3))
        cells = self._cells[level]
        pole_batch(
            array, index, self.detections.offsets, self._columns, self.detections.poles.positions, self._blurs[level],
            cells.starts, cells.points, self._attributes[level], cells.shape, cells.low, cells.cell, self._numbers,
            self.information, cost, gradient, hessian,
        )  # fmt: skip
        return ScanCosts(cost, gradient, hessian)

    def cost(self, poses: npt.ArrayLike, level: int = -1, scan_of_pose: npt.ArrayLike | None = None) -> Array:
        """Cost alone, shape (N,); arguments as :meth:`batch`."""
        return self.batch(poses, level, scan_of_pose).cost

    def least_cost(self, level: int = -1) -> Array:
        """Lower bound of the cost of each local map, shape (S,)."""
        variance = self.mixture.sigma**2 + self.mixture.landmark_sigma**2 + self._blurs[level] ** 2
        least = np.minimum(np.log(2 * np.pi * variance) + self._columns[:, 3], 0.0)
        return np.asarray(self.information * np.bincount(self.detections.pose_of, least, minlength=self.scans))

    def matches(self, poses: npt.ArrayLike, level: int = -1) -> tuple[Index, Array]:
        """Landmark of each detection at the poses of all local maps (S, 3).

        Returns
        -------
        matches : ndarray of int64, shape (K,)
            Rows of the landmarks; -1 where none is likelier than clutter.
        costs : ndarray, shape (K,)
            Negative log-likelihood ratios, at most 0.
        """
        matches, costs = np.empty(len(self._columns), np.int64), np.empty(len(self._columns))
        cells = self._cells[level]
        match_places(
            self._columns, self.detections.placed(se2.as_poses(poses)), self._blurs[level], cells.starts, cells.points,
            self._attributes[level], cells.shape, cells.low, cells.cell, self._numbers, matches, costs,
        )  # fmt: skip
        found = matches >= 0
        matches[found] = cells.order[matches[found]]
        return matches, costs
