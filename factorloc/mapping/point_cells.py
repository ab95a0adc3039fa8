"""Point cells: points of the plane, sorted by the cells they lie in, so that neighbours are found at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.errors import MapError

__all__ = ["PointCells"]

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]

_MOST_CELLS = 50_000_000


@dataclass(frozen=True, eq=False)
class PointCells:
    """A dense hash of points: all within the edge of a cell lie in the cell of a place or the eight around it.

    Parameters
    ----------
    points : ndarray, shape (N, 2)
        Sorted by cell, m.
    order : ndarray of int64, shape (N,)
        Which of the points given each of them is.
    starts : ndarray of int64, shape (cells + 1,)
        First point of each cell, row by row.
    low : ndarray, shape (2,)
        Lowest corner of the cells, m.
    cell : float
        Edge of a cell, m.
    shape : (int, int)
        Cells along both axes.
    """

    points: Array
    order: Index
    starts: Index
    low: Array
    cell: float
    shape: tuple[int, int]

    @classmethod
    def of(cls, points: npt.ArrayLike, cell: float) -> PointCells:
        """Sort points (N, 2) into cells of an edge, m.

        Raises
        ------
        MapError
            If the points lie too far apart for so small cells.
        """
        given = np.ascontiguousarray(np.asarray(points, np.float64).reshape(-1, 2))
        if len(given) == 0:
            return cls(given, np.zeros(0, np.int64), np.zeros(2, np.int64), np.zeros(2), float(cell), (1, 1))
        low = given.min(0)
        index = np.floor((given - low) / cell)
        extent = index.max(0) + 1
        if extent.prod() > _MOST_CELLS:
            far = (given.max(0) - low).max() / 1000
            raise MapError(f"poles: they lie up to {far:.0f} km apart; is one of them in another coordinate system?")
        shape = (int(extent[0]), int(extent[1]))
        number = (index[:, 0] * shape[1] + index[:, 1]).astype(np.int64)
        order = np.argsort(number, kind="stable").astype(np.int64)
        starts = np.zeros(shape[0] * shape[1] + 1, np.int64)
        np.cumsum(np.bincount(number, minlength=shape[0] * shape[1]), out=starts[1:])
        return cls(np.ascontiguousarray(given[order]), order, starts, low, float(cell), shape)
