"""Cell layouts: the numbers of all cells of a map as walks through space take them, planar, dense or in bricks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.mapping.bricks import BRICK
from factorloc.mapping.cell_table import CellTable
from factorloc.mapping.grid import Grid

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
        array, low = np.asarray(values, np.float64), np.array(grid.origin)
        if grid.dimension == 2:
            array, low = array[..., None], np.append(low, -0.5 * grid.resolution)
        n_x, n_y, n_z = array.shape
        flat = np.pad(array, 1, constant_values=outside).ravel()
        strides = ((n_y + 2) * (n_z + 2), n_z + 2, 1)
        return cls(None, flat, strides, 1.0, (n_x, n_y, n_z), low, grid.resolution, float(outside))

    @classmethod
    def bricks(cls, table: CellTable) -> CellLayout:
        """Lay out a table of bricks."""
        grid, layout = table.layout.grid, table.layout
        n_x, n_y, n_z = grid.shape
        return cls(
            layout.directory, table.pool.ravel(), layout.strides, float(BRICK), (n_x, n_y, n_z),
            np.array(grid.origin), grid.resolution, table.outside,
        )  # fmt: skip
