"""Cell tiles: the visited cells of a whole map in pieces, of which an addition makes anew only those it touches."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from factorloc.errors import MapError
from factorloc.mapping.bricks import CELLS
from factorloc.mapping.visited_cells import VisitedCells

__all__ = ["TILE", "CellTiles"]

Index = npt.NDArray[np.int64]

TILE = 128
"""Bricks of a tile, of numbers that follow each other; at most half a million cells, which is what a sum unpacks."""


@dataclass(frozen=True)
class CellTiles:
    """Hits, misses and path length of the cells of a map, about 7 bytes each.

    Tile ``k`` holds the bricks ``128 k`` to ``128 k + 127``, so that two maps of one grid are equal when their tiles
    are. Tiles never change: a sum shares with its terms those that only one of them has.

    Parameters
    ----------
    tiles : mapping of int to VisitedCells
        By increasing number; none is empty.
    """

    tiles: Mapping[int, VisitedCells]

    @classmethod
    def in_order(
        cls,
        bricks: Index,
        offsets: Index,
        local: npt.NDArray[np.uint16],
        hits: npt.NDArray[np.uint32],
        misses: npt.NDArray[np.uint32],
        path_fixed: Index,
    ) -> CellTiles:
        """Pack cells that are given brick by brick; as :meth:`VisitedCells.in_order`.

        Raises
        ------
        MapError
            If the arrays disagree.
        """
        if not (np.diff(bricks) > 0).all() or len(offsets) != len(bricks) + 1:
            raise MapError("bricks: numbers and cells disagree; is the map damaged?")
        tiles = {}
        for number, rows in _runs(bricks // TILE):
            own = offsets[rows.start : rows.stop + 1]
            at = slice(int(own[0]), int(own[-1]))
            tiles[number] = VisitedCells.in_order(
                bricks[rows], own - own[0], local[at], hits[at], misses[at], path_fixed[at]
            )
        return cls(tiles)

    @classmethod
    def of_keys(
        cls, keys: Index, hits: npt.NDArray[np.uint32], misses: npt.NDArray[np.uint32], path_fixed: Index
    ) -> CellTiles:
        """Pack cells that are given by increasing keys."""
        tiles = {}
        for number, rows in _runs(keys // (CELLS * TILE)):
            tiles[number] = VisitedCells.of_keys(keys[rows], hits[rows], misses[rows], path_fixed[rows])
        return cls(tiles)

    def __len__(self) -> int:
        return sum(map(len, self.tiles.values()))

    def __add__(self, other: CellTiles) -> CellTiles:
        """Add up the counts of cells of one grid.

        Raises
        ------
        MapError
            If a cell saw more than 2^32 - 1 rays.
        """
        few, many = sorted((self.tiles, other.tiles), key=len)
        both = {number: many[number] + tile if number in many else tile for number, tile in few.items()}
        return CellTiles(dict(sorted({**many, **both}.items())))

    @property
    def bricks(self) -> Index:
        """Numbers of the bricks with visited cells, increasing, shape (B,)."""
        return self._joined("bricks", np.int64)

    @property
    def offsets(self) -> Index:
        """Where the cells of each brick begin, and end, shape (B + 1,)."""
        return np.concatenate([[0], np.cumsum(self._joined("counts", np.int64))])

    @property
    def local(self) -> npt.NDArray[np.uint16]:
        """Number of each cell in its brick, increasing within each, shape (V,)."""
        return self._joined("local", np.uint16)

    @property
    def keys(self) -> Index:
        """Key of each cell, increasing, shape (V,)."""
        return self._joined("keys", np.int64)

    @property
    def hits(self) -> npt.NDArray[np.uint32]:
        """Rays reflected in each cell (H of the thesis, chapters 7 and 8), shape (V,)."""
        return self._joined("hits", np.uint32)

    @property
    def misses(self) -> npt.NDArray[np.uint32]:
        """Rays that crossed each cell (M), shape (V,)."""
        return self._joined("misses", np.uint32)

    @property
    def path_fixed(self) -> Index:
        """Path length in each cell, in units of 2^-20 m, shape (V,)."""
        return self._joined("path_fixed", np.int64)

    @property
    def nbytes(self) -> int:
        """Memory of the arrays."""
        return sum(tile.nbytes for tile in self.tiles.values())

    def _joined(self, name: str, dtype: npt.DTypeLike) -> npt.NDArray[Any]:
        return np.concatenate([np.zeros(0, dtype), *(getattr(tile, name) for tile in self.tiles.values())])


def _runs(numbers: Index) -> Iterator[tuple[int, slice]]:
    """Runs of the same number, and where they are."""
    first = np.flatnonzero(np.diff(numbers, prepend=-1)).tolist()
    for a, b in pairwise([*first, len(numbers)]):
        yield int(numbers[a]), slice(a, b)
