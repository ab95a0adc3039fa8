"""Bricks: where the cells of a sparse spatial grid lie in memory."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from factorloc.errors import MapError
from factorloc.mapping._spatial_traversal_kernels import BRICK
from factorloc.mapping.grid import Grid

__all__ = ["BRICK", "CELLS", "BrickLayout"]

Index = npt.NDArray[np.int64]

CELLS = BRICK**3
"""Cells of a brick."""


@dataclass(frozen=True)
class BrickLayout:
    """Some of the bricks of 16 x 16 x 16 cells that cover a spatial grid.

    Cells are named by keys, ``brick * 4096 + cell``: the number of the brick in row-major order of the covering bricks,
    and of the cell in the brick, row-major as well.

    Parameters
    ----------
    grid : Grid
        The cells.
    bricks : ndarray of int64, shape (B,)
        Numbers of the bricks there are, increasing.

    Raises
    ------
    MapError
        If the grid is planar.
    """

    grid: Grid
    bricks: Index

    def __post_init__(self) -> None:
        if self.grid.dimension != 3:
            raise MapError("grid: planar; bricks are for spatial ones")

    @property
    def shape(self) -> tuple[int, int, int]:
        """Bricks along each axis."""
        n_x, n_y, n_z = (-(-n // BRICK) for n in self.grid.shape)
        return n_x, n_y, n_z

    @property
    def strides(self) -> tuple[int, int, int]:
        """Strides of the directory."""
        _, n_y, n_z = self.shape
        return (n_y + 2) * (n_z + 2), n_z + 2, 1

    @cached_property
    def directory(self) -> npt.NDArray[np.int32]:
        """Place of each brick in a pool, with a rim of one brick, flat; 0 where there is none, pools begin with 1."""
        places = np.zeros(tuple(n + 2 for n in self.shape), np.int32)
        inner = np.zeros(self.shape, np.int32)
        inner.ravel()[self.bricks] = np.arange(1, len(self.bricks) + 1)
        places[1:-1, 1:-1, 1:-1] = inner
        return places.ravel()

    def slabs(self, most: int) -> list[tuple[int, int, BrickLayout]]:
        """Cut the bricks across x, so that as many as may be, but one layer at least, lie between two planes.

        Parameters
        ----------
        most : int
            Bricks of a slab; only a single layer has more.

        Returns
        -------
        list of (first, last, layout)
            Cells ``first <= x < last``, and the bricks there; those without bricks are left out.
        """
        n_x, n_y, n_z = self.shape
        starts = np.searchsorted(self.bricks, np.arange(n_x + 1) * n_y * n_z)
        slabs, first = [], 0
        while first < n_x:
            last = max(int(np.searchsorted(starts, starts[first] + most, side="right")) - 1, first + 1)
            bricks = self.bricks[starts[first] : starts[last]]
            if len(bricks):
                end = min(last * BRICK, self.grid.shape[0])
                slabs.append((first * BRICK, end, BrickLayout(self.grid, bricks)))
            first = last
        return slabs

    def corners(self) -> Index:
        """Lowest cell of each brick there is, shape (B, 3)."""
        return np.stack(np.unravel_index(self.bricks, self.shape), -1).astype(np.int64) * BRICK

    def keys(self, cells: npt.ArrayLike) -> Index:
        """Keys of cells (..., 3) of the grid."""
        index = np.asarray(cells, np.int64)
        brick = np.ravel_multi_index(tuple(np.moveaxis(index // BRICK, -1, 0)), self.shape)
        x, y, z = np.moveaxis(index % BRICK, -1, 0)
        return np.asarray(brick * CELLS + (x * BRICK + y) * BRICK + z)

    def cells(self, keys: npt.ArrayLike) -> Index:
        """Cells (..., 3) with keys; the inverse of :meth:`keys`."""
        key = np.asarray(keys, np.int64)
        brick = np.stack(np.unravel_index(key // CELLS, self.shape), -1)
        local = key % CELLS
        return np.asarray(brick * BRICK + np.stack([local // BRICK**2, local // BRICK % BRICK, local % BRICK], -1))

    def places(self, keys: npt.ArrayLike) -> Index:
        """Addresses in a pool of cells with keys whose bricks are there."""
        key = np.asarray(keys, np.int64)
        return np.asarray((np.searchsorted(self.bricks, key // CELLS) + 1) * CELLS + key % CELLS)
