"""Scan terms in space: decay rates, their posteriors and distance fields over one pool of bricks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from factorloc._jit import in_threads
from factorloc.errors import GeometryError, MapError
from factorloc.factors._spatial_scan_kernels import spatial_scan_batch
from factorloc.factors.level_tables import LevelTables
from factorloc.factors.scan_term import ScanCosts
from factorloc.mapping.grid import Grid
from factorloc.rays import Rays, pack
from factorloc.scan import Scan

__all__ = ["SpatialScanTerm"]

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]

_PARALLEL_RAYS = 2_000


class SpatialScanTerm:
    """Costs of spatial scans in a map, level by level, coarse to fine.

    A level is decay rates, with the hybrid negative log-likelihood of :class:`~factorloc.factors.DecayRateTerm`, their
    posteriors, with that of :class:`~factorloc.factors.PosteriorTerm`, an end-point model
    (:class:`~factorloc.factors.EndPointTerm`) or a distance field. The finest level should be decay rates or their
    posteriors: a distance field is quick and sees far, but draws end points to the middle of cells.

    Parameters
    ----------
    tables : LevelTables
        The map.
    scans : sequence of Scan, or Rays
        One scan a pose; rays without return do not take part. A thousand rays a scan are plenty
        (:func:`factorloc.rays.spread`).
    information : float
        Factor of all costs, at most 1.

    Raises
    ------
    MapError
        If a scan is planar.
    """

    def __init__(self, tables: LevelTables, scans: Sequence[Scan] | Rays, information: float = 1.0) -> None:
        self.tables = tables
        self.information = information
        self.rays = (scans if isinstance(scans, Rays) else pack(scans)).returns()
        if self.rays.dimension != 3:
            raise MapError("scans: planar, the map is spatial; use a map made for them")

    @property
    def scans(self) -> int:
        """Number of scans the term was made for."""
        return len(self.rays)

    @property
    def blurs(self) -> tuple[float, ...]:
        """Blur of each level, m."""
        return self.tables.blurs

    @property
    def grid(self) -> Grid:
        """Cells of the map."""
        return self.tables.grid

    def batch(self, poses: npt.ArrayLike, level: int = -1, scan_of_pose: npt.ArrayLike | None = None) -> ScanCosts:
        """Cost, gradient and Hessian of scans at poses.

        Parameters
        ----------
        poses : array_like, shape (N, 4, 4)
            Poses ``T_map_body``.
        level : int
            Level of the map.
        scan_of_pose : array_like of int, shape (N,), optional
            Scan of each pose; its own row by default.

        Raises
        ------
        GeometryError
            If poses are no finite 4 x 4 matrices or do not fit the scans.
        """
        return self._evaluate(poses, level, scan_of_pose, True)

    def cost(self, poses: npt.ArrayLike, level: int = -1, scan_of_pose: npt.ArrayLike | None = None) -> Array:
        """Cost alone, shape (N,); arguments as :meth:`batch`."""
        return self._evaluate(poses, level, scan_of_pose, False).cost

    def least_cost(self, level: int = -1) -> Array:
        """Lower bound of the cost of each scan, shape (S,)."""
        return np.asarray(self.information * self.tables.least_costs[level] * np.diff(self.rays.offsets))

    def _evaluate(
        self, poses: npt.ArrayLike, level: int, scan_of_pose: npt.ArrayLike | None, want_gradient: bool
    ) -> ScanCosts:
        array, index = self._checked(poses, scan_of_pose)
        n = len(array)
        cost, gradient, hessian = np.empty(n), np.empty((n, 6)), np.empty((n, 6, 6))
        rays, tables = self.rays, self.tables

        def evaluate(first: int, last: int) -> None:
            part = slice(first, last)
            spatial_scan_batch(
                array[part], index[part], rays.origins, rays.directions, rays.ranges, rays.offsets, tables.low,
                tables.directory, tables.primary, tables.secondary, tables.tertiary, tables.numbers[level],
                self.information, want_gradient, cost[part], gradient[part], hessian[part],
            )  # fmt: skip

        if n * len(rays.ranges) > _PARALLEL_RAYS * len(rays):
            in_threads(evaluate, n)
        else:  # waking threads for less than a millisecond of work costs more than it saves
            evaluate(0, n)
        return ScanCosts(cost, gradient, hessian)

    def _checked(self, poses: npt.ArrayLike, scan_of_pose: npt.ArrayLike | None) -> tuple[Array, Index]:
        array = np.ascontiguousarray(poses, np.float64)
        if array.ndim != 3 or array.shape[1:] != (4, 4) or not np.isfinite(array).all():
            raise GeometryError(f"poses: shape {array.shape}; expected finite 4 x 4 matrices")
        if scan_of_pose is None:
            if len(array) != self.scans:
                raise GeometryError(f"poses: {len(array)} for {self.scans} scans; give one each, or scan_of_pose")
            return array, np.arange(self.scans, dtype=np.int64)
        index = np.ascontiguousarray(scan_of_pose, np.int64)
        if index.shape != (len(array),) or (len(index) and not 0 <= index.min() <= index.max() < self.scans):
            raise GeometryError(f"scan_of_pose: expected {len(array)} indices below {self.scans}")
        return array, index
