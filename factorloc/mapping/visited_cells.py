"""Visited cells: counts of the cells that rays have met in some bricks, packed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.errors import MapError
from factorloc.mapping._brick_kernels import merge_sorted
from factorloc.mapping.bricks import CELLS
from factorloc.mapping.packed_integers import PackedIntegers

__all__ = ["VisitedCells"]

Index = npt.NDArray[np.int64]

_MOST_VISITS = np.iinfo(np.uint32).max


@dataclass(frozen=True)
class VisitedCells:
    """Hits, misses and path length of the cells of some bricks, about 7 bytes each.

    Parameters
    ----------
    bricks : ndarray of int64, shape (B,)
        Numbers of the bricks with visited cells, increasing (:class:`~factorloc.mapping.bricks.BrickLayout`).
    visited : ndarray of uint8, shape (B, 512)
        Which of its 4096 cells each brick holds, a bit a cell.
    packed_hits, packed_misses, packed_path : PackedIntegers, of length V
        See :attr:`hits`, :attr:`misses` and :attr:`path_fixed`.

    Raises
    ------
    MapError
        If the arrays disagree.
    """

    bricks: Index
    visited: npt.NDArray[np.uint8]
    packed_hits: PackedIntegers
    packed_misses: PackedIntegers
    packed_path: PackedIntegers

    def __post_init__(self) -> None:
        packed = (self.packed_hits, self.packed_misses, self.packed_path)
        if (
            self.visited.shape != (len(self.bricks), CELLS // 8)
            or {len(part.narrow) for part in packed} != {len(self)}
            or not (np.diff(self.bricks) > 0).all()
        ):
            raise MapError("bricks: numbers and cells disagree; is the map damaged?")

    @classmethod
    def in_order(
        cls,
        bricks: Index,
        offsets: Index,
        local: npt.NDArray[np.uint16],
        hits: npt.NDArray[np.uint32],
        misses: npt.NDArray[np.uint32],
        path_fixed: Index,
    ) -> VisitedCells:
        """Pack cells that are given brick by brick.

        Parameters
        ----------
        bricks : ndarray of int64, shape (B,)
            See above.
        offsets : ndarray of int64, shape (B + 1,)
            Brick ``k`` owns the cells ``offsets[k]:offsets[k + 1]``.
        local : ndarray of uint16, shape (V,)
            Number of each cell in its brick, increasing within each.
        hits, misses, path_fixed : ndarray, shape (V,)

        Raises
        ------
        MapError
            If the arrays disagree.
        """
        counts = np.diff(offsets)
        sizes = {len(local), len(hits), len(misses), len(path_fixed), int(offsets[-1]) if len(offsets) else -1}
        if len(offsets) != len(bricks) + 1 or len(sizes) > 1 or (counts < 0).any() or (local >= CELLS).any():
            raise MapError("bricks: numbers, offsets and cells disagree; is the map damaged?")
        owner = np.repeat(np.arange(len(bricks), dtype=np.int32), counts)
        if ((local[1:] <= local[:-1]) & (owner[1:] == owner[:-1])).any():
            raise MapError("bricks: cells are out of order; is the map damaged?")
        bits = np.zeros((len(bricks), CELLS), np.bool_)
        bits[owner, local] = True
        return cls(
            np.asarray(bricks, np.int64),
            np.packbits(bits, axis=1),
            PackedIntegers.pack(hits, np.uint8),
            PackedIntegers.pack(misses, np.uint16),
            PackedIntegers.pack(path_fixed, np.uint32),
        )

    @classmethod
    def of_keys(
        cls, keys: Index, hits: npt.NDArray[np.uint32], misses: npt.NDArray[np.uint32], path_fixed: Index
    ) -> VisitedCells:
        """Pack cells that are given by increasing keys."""
        brick = keys // CELLS
        first = np.flatnonzero(np.diff(brick, prepend=-1))
        offsets = np.append(first, len(keys)).astype(np.int64)
        return cls.in_order(brick[first], offsets, (keys % CELLS).astype(np.uint16), hits, misses, path_fixed)

    def __len__(self) -> int:
        return int(np.bitwise_count(self.visited).sum(dtype=np.int64))

    @property
    def counts(self) -> Index:
        """Visited cells of each brick, shape (B,)."""
        return np.asarray(np.bitwise_count(self.visited).sum(1, dtype=np.int64))

    @property
    def local(self) -> npt.NDArray[np.uint16]:
        """Number of each cell in its brick, increasing within each, shape (V,)."""
        return (np.flatnonzero(np.unpackbits(self.visited)) % CELLS).astype(np.uint16)

    @property
    def keys(self) -> Index:
        """Key of each cell, increasing, shape (V,)."""
        return np.repeat(self.bricks, self.counts) * CELLS + self.local

    @property
    def hits(self) -> npt.NDArray[np.uint32]:
        """Rays reflected in each cell (H of the thesis, chapters 7 and 8), shape (V,)."""
        return self.packed_hits.unpack(np.uint32)

    @property
    def misses(self) -> npt.NDArray[np.uint32]:
        """Rays that crossed each cell (M), shape (V,)."""
        return self.packed_misses.unpack(np.uint32)

    @property
    def path_fixed(self) -> Index:
        """Path length in each cell, in units of 2^-20 m, shape (V,)."""
        return self.packed_path.unpack(np.int64)

    @property
    def nbytes(self) -> int:
        """Memory of the arrays."""
        packed = (self.packed_hits, self.packed_misses, self.packed_path)
        return self.bricks.nbytes + self.visited.nbytes + sum(part.nbytes for part in packed)

    def __add__(self, other: VisitedCells) -> VisitedCells:
        """Add up the counts of cells of one grid, which are unpacked for it.

        Raises
        ------
        MapError
            If a cell saw more than 2^32 - 1 rays.
        """
        keys_a, keys_b = self.keys, other.keys
        from_a, from_b = np.empty(len(keys_a), np.int64), np.empty(len(keys_b), np.int64)
        count = merge_sorted(keys_a, keys_b, from_a, from_b)
        keys = np.empty(count, np.int64)
        keys[from_a], keys[from_b] = keys_a, keys_b
        hits, misses, path = (np.zeros(count, np.int64) for _ in range(3))
        for total, name in ((hits, "hits"), (misses, "misses"), (path, "path_fixed")):
            total[from_a] = getattr(self, name)
            total[from_b] += getattr(other, name)
        if max(hits.max(initial=0), misses.max(initial=0)) > _MOST_VISITS:
            raise MapError(f"a cell was visited more than {_MOST_VISITS} times, where its counts end; split the map")
        return VisitedCells.of_keys(keys, hits.astype(np.uint32), misses.astype(np.uint32), path)
