"""Distance transforms: how far every cell is from the nearest occupied one, exactly, up to a farthest distance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import distance_transform_edt

from factorloc.errors import MapError
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.cell_table import CellTable
from factorloc.mapping.grid import Grid
from factorloc.mapping.ray_statistics import RayStatistics

__all__ = ["DistanceField", "end_cells"]

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]


def end_cells(statistics: RayStatistics | BrickStatistics, least_hits: int = 1, least_reflection: float = 0.1) -> Mask:
    """Cells that count as occupied: hit often enough, and by a large enough share of the rays that met them.

    The share ``H / (H + M)`` is the most likely reflection probability (eq. 8.16). It is low in cells of a wall that
    rays graze, and far lower where a passer-by was hit; so the threshold is small.

    Parameters
    ----------
    statistics : RayStatistics or BrickStatistics
        The map.
    least_hits : int
        Hits a cell needs, at least 1.
    least_reflection : float
        Share a cell needs.

    Returns
    -------
    ndarray of bool, shape ``grid.shape``
        Of a sparse map the visited cells, shape (V,).
    """
    hits = statistics.hits.astype(np.float64)
    return np.asarray((hits >= max(least_hits, 1)) & (hits >= least_reflection * (hits + statistics.misses)))


def _distances(occupied: Mask, resolution: float, farthest: float) -> Array:
    if not occupied.any():
        return np.full(occupied.shape, farthest)
    return np.minimum(np.asarray(distance_transform_edt(~occupied), np.float64) * resolution, farthest)


@dataclass(frozen=True)
class DistanceField:
    """Euclidean distance from the centre of each cell to that of the nearest occupied one, cut off.

    Parameters
    ----------
    grid : Grid
        Where the cells lie.
    values : ndarray, shape ``grid.shape``, or CellTable
        Distances, m; of sparse maps a table of bricks.
    farthest : float
        Distances end here, m; also that of everything outside the grid.
    """

    grid: Grid
    values: Array | CellTable
    farthest: float

    @classmethod
    def from_occupied(cls, grid: Grid, occupied: npt.ArrayLike, farthest: float = 2.0) -> DistanceField:
        """Transform a mask of occupied cells.

        Parameters
        ----------
        grid : Grid
            Where they lie.
        occupied : array_like of bool, shape ``grid.shape``
        farthest : float
            m.

        Raises
        ------
        MapError
            If the shapes differ, or no cell is occupied.
        """
        mask = np.asarray(occupied, np.bool_)
        if mask.shape != grid.shape:
            raise MapError(f"occupied: shape {mask.shape}; the grid has {grid.shape}")
        _require(mask, farthest)
        return cls(grid, _distances(mask, grid.resolution, farthest), farthest)

    @classmethod
    def from_statistics(
        cls,
        statistics: RayStatistics | BrickStatistics,
        farthest: float = 2.0,
        *,
        least_hits: int = 1,
        least_reflection: float = 0.1,
    ) -> DistanceField:
        """Transform the occupied cells of a map (:func:`end_cells`).

        A sparse map is never laid out as a whole: its field is computed in boxes of bricks with a margin of
        ``farthest`` around, and holds the bricks that are near an occupied cell.

        Raises
        ------
        MapError
            If no cell is occupied.
        """
        rule = (least_hits, least_reflection)
        occupied = end_cells(statistics, *rule)
        if isinstance(statistics, RayStatistics):
            return cls.from_occupied(statistics.grid, occupied, farthest)
        _require(occupied, farthest)
        resolution = statistics.grid.resolution
        table = CellTable.from_neighbourhoods(
            statistics,
            lambda part: _distances(end_cells(part, *rule), resolution, farthest),
            math.ceil(farthest / resolution),
            farthest,
        )
        return cls(statistics.grid, table, farthest)

    def at(self, points: npt.ArrayLike) -> Array:
        """Distances (...) of the cells that hold points (..., D), m."""
        index = self.grid.index(points)
        if isinstance(self.values, CellTable):
            return self.values.at(index)
        inside = np.asarray(((index >= 0) & (index < self.grid.shape)).all(-1))
        cells = tuple(np.moveaxis(np.where(inside[..., None], index, 0), -1, 0))
        return np.where(inside, self.values[cells], self.farthest)


def _require(occupied: Mask, farthest: float) -> None:
    if not (np.isfinite(farthest) and farthest > 0):
        raise MapError(f"farthest: {farthest} m; expected a positive length")
    if not occupied.any():
        raise MapError("map: no cell is occupied; lower least_hits or least_reflection")
