"""Cell tables: one number for every cell of a spatial grid, in bricks, as walks and interpolations read it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.bricks import BRICK, CELLS, BrickLayout
from factorloc.mapping.grid import Grid, require_memory
from factorloc.mapping.ray_statistics import RayStatistics

__all__ = ["CellTable"]

Array = npt.NDArray[np.float64]
Pool = npt.NDArray[np.float32]

_CHUNK = 6  # bricks along an edge of what is laid out in full at a time


@dataclass(frozen=True)
class CellTable:
    """Numbers of all cells of a grid; cells of bricks that are not there have the number of the outside.

    Parameters
    ----------
    layout : BrickLayout
        The grid and its bricks.
    pool : ndarray of float32, shape (B + 1, 4096)
        Numbers of the cells of each brick; the first brick is the outside.
    """

    layout: BrickLayout
    pool: Pool

    @property
    def outside(self) -> float:
        """The number outside of all bricks."""
        return float(self.pool[0, 0])

    @property
    def nbytes(self) -> int:
        """Memory of numbers and directory."""
        return self.pool.nbytes + self.layout.directory.nbytes

    def map(self, function: Callable[[Pool], npt.ArrayLike]) -> CellTable:
        """Return the table of a function of every number."""
        return CellTable(self.layout, np.asarray(function(self.pool), np.float32))

    def at(self, cells: npt.ArrayLike) -> Array:
        """Numbers of cells (..., 3), inside the grid and outside of it."""
        index = np.asarray(cells, np.int64)
        inside = np.asarray(((index >= 0) & (index < self.layout.grid.shape)).all(-1))
        keys = self.layout.keys(np.where(inside[..., None], index, 0))
        place = np.zeros(index.shape[:-1], np.int64)
        if len(self.layout.bricks):
            found = np.minimum(np.searchsorted(self.layout.bricks, keys // CELLS), len(self.layout.bricks) - 1)
            place = np.where(inside & (self.layout.bricks[found] == keys // CELLS), found + 1, 0)
        return np.asarray(self.pool[place, np.where(place > 0, keys % CELLS, 0)], np.float64)

    @classmethod
    def from_dense(cls, grid: Grid, values: npt.ArrayLike, outside: float) -> CellTable:
        """Keep the bricks of a dense array, shape ``grid.shape``, that are not outside all over."""
        array = np.asarray(values, np.float32)
        layout = BrickLayout(grid, np.zeros(0, np.int64))
        n = layout.shape
        full = np.full(tuple(k * BRICK for k in n), outside, np.float32)
        full[tuple(slice(k) for k in grid.shape)] = array
        blocks = full.reshape(n[0], BRICK, n[1], BRICK, n[2], BRICK).transpose(0, 2, 4, 1, 3, 5).reshape(-1, CELLS)
        keep = np.flatnonzero((blocks != np.float32(outside)).any(1))
        return cls(BrickLayout(grid, keep), np.concatenate([np.full((1, CELLS), outside, np.float32), blocks[keep]]))

    @classmethod
    def from_cells(cls, statistics: BrickStatistics, values: npt.ArrayLike, outside: float) -> CellTable:
        """Give every visited cell of a map its number, and the others that of the outside."""
        layout = statistics.layout
        require_memory((len(layout.bricks) + 1) * CELLS * 4, f"a table of {len(layout.bricks)} bricks")
        pool = np.full((len(layout.bricks) + 1) * CELLS, outside, np.float32)
        pool[layout.places(statistics.keys)] = values
        return cls(layout, pool.reshape(-1, CELLS))

    @classmethod
    def from_neighbourhoods(
        cls,
        statistics: BrickStatistics,
        function: Callable[[RayStatistics], npt.ArrayLike],
        halo: int,
        outside: float,
    ) -> CellTable:
        """Compute each cell's number from the counts around it, without laying out the whole map.

        Parameters
        ----------
        statistics : BrickStatistics
            The map.
        function : callable
            Numbers of all cells of a part of the map, shape as its grid; those within ``halo`` of its border are not
            used.
        halo : int
            Cells a number depends on to each side.
        outside : float
            What the function gives where nothing was visited within the halo.
        """
        layout = statistics.layout
        reach = -(-halo // BRICK)
        there = np.zeros(layout.shape, np.bool_)
        there.ravel()[layout.bricks] = True
        bricks: list[npt.NDArray[np.int64]] = []
        pools: list[Pool] = []
        for corner, count in _chunks(there, reach):
            # Bricks reach beyond the grid, its numbers do not: interpolation and walks look at cells of the rim.
            shape = np.minimum(count * BRICK, np.array(statistics.grid.shape) - corner * BRICK)
            grid = _part(statistics.grid, corner * BRICK - halo, shape + 2 * halo)
            values = np.asarray(function(statistics.window(grid)), np.float32)
            inner = tuple(slice(halo, halo + int(n)) for n in shape)
            part = cls.from_dense(_part(statistics.grid, corner * BRICK, shape), values[inner], outside)
            own = np.stack(np.unravel_index(part.layout.bricks, part.layout.shape), -1) + corner
            bricks.append(np.ravel_multi_index(tuple(own.T), layout.shape))
            pools.append(part.pool[1:])
        numbers = np.concatenate([np.zeros(0, np.int64), *bricks])
        order = np.argsort(numbers)
        pool = np.concatenate([np.full((1, CELLS), outside, np.float32), *pools])
        return cls(BrickLayout(statistics.grid, numbers[order]), pool[np.concatenate([[0], order + 1])])


def _part(grid: Grid, corner: npt.NDArray[np.int64], shape: npt.NDArray[np.int64]) -> Grid:
    origin = np.array(grid.origin) + corner * grid.resolution
    return Grid(tuple(origin), grid.resolution, tuple(int(n) for n in shape), grid.frame)


def _chunks(there: npt.NDArray[np.bool_], reach: int) -> Iterator[tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]]:
    """Boxes of bricks, by corner and count, that have one that is there within reach."""
    shape = np.array(there.shape)
    for first in np.ndindex(*(-(-n // _CHUNK) for n in there.shape)):
        corner = np.array(first) * _CHUNK
        last = np.minimum(corner + _CHUNK, shape)
        around = tuple(slice(max(a - reach, 0), b + reach) for a, b in zip(corner, last, strict=True))
        if there[around].any():
            yield corner, last - corner
