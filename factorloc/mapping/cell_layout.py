"""Cell layouts: the numbers of all cells of a map as walks through space take them, planar, dense or in bricks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.bricks import BRICK
from factorloc.mapping.cell_table import CellTable
from factorloc.mapping.grid import Grid, require_memory

__all__ = ["CellLayout"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class CellLayout:
    """Numbers of cells with a rim, flat, and where they lie.

    A planar grid is one layer of cells around z = 0, in which rays at z = 0 run: it needs no walk of its own.

    Parameters
    ----------
    directory : None or ndarray of int32, flat
        None for a dense array; else the brick of every place, with a rim of one brick.
    values : ndarray of float64 or float32, flat
        Numbers of the cells: a dense array with a rim of one cell, or a pool of bricks.
    strides : (int, int, int)
        Of the dense array, or of the directory.
    rim : float
        Width of the rim, cells.
    shape : (int, int, int)
        Cells without rim.
    low : ndarray, shape (3,)
        Lowest corner, m.
    resolution : float
        Edge of a cell, m.
    outside : float
        The number outside the grid.
    """

    directory: npt.NDArray[np.int32] | None
    values: npt.NDArray[np.floating]
    strides: tuple[int, int, int]
    rim: float
    shape: tuple[int, int, int]
    low: Array
    resolution: float
    outside: float

    @classmethod
    def dense(cls, grid: Grid, values: npt.ArrayLike, outside: float) -> CellLayout:
        """Lay out an array of shape ``grid.shape``."""
        array = np.asarray(values, np.float64)
        if grid.dimension == 2:
            array = array[..., None]
        return cls._rimmed(grid, np.pad(array, 1, constant_values=outside), outside)

    @classmethod
    def in_full(cls, statistics: BrickStatistics, values: npt.ArrayLike, outside: float) -> CellLayout:
        """Lay out numbers of the visited cells of a sparse map, and the outside's of the others, as a dense array.

        Raises
        ------
        MapError
            If it does not fit into memory.
        """
        shape = [n + 2 for n in statistics.grid.shape]
        require_memory(4 * int(np.prod(shape)), f"{' x '.join(map(str, shape))} cells laid out in full")
        array = np.full(shape, outside, np.float32)
        array[tuple((statistics.layout.cells(statistics.keys) + 1).T)] = values
        return cls._rimmed(statistics.grid, array, outside)

    @classmethod
    def _rimmed(cls, grid: Grid, array: npt.NDArray[np.floating], outside: float) -> CellLayout:
        n_x, n_y, n_z = (n - 2 for n in array.shape)
        strides, low = ((n_y + 2) * (n_z + 2), n_z + 2, 1), np.array(grid.origin)
        if grid.dimension == 2:
            low = np.append(low, -0.5 * grid.resolution)
        return cls(None, array.ravel(), strides, 1.0, (n_x, n_y, n_z), low, grid.resolution, float(outside))

    @classmethod
    def bricks(cls, table: CellTable) -> CellLayout:
        """Lay out a table of bricks."""
        grid, layout = table.layout.grid, table.layout
        n_x, n_y, n_z = grid.shape
        return cls(
            layout.directory, table.pool.ravel(), layout.strides, float(BRICK), (n_x, n_y, n_z),
            np.array(grid.origin), grid.resolution, table.outside,
        )  # fmt: skip
