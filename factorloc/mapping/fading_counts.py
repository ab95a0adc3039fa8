"""Fading counts: the counts of a map over sessions, of which old ones may fade."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from factorloc.errors import MapError
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.bricks import BrickLayout
from factorloc.mapping.grid import Grid
from factorloc.mapping.ray_statistics import RayStatistics

__all__ = ["Counts", "FadingCounts"]

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]

_NAMES = ("hits", "misses", "path_lengths")


@dataclass(frozen=True)
class FadingCounts:
    """Hits, misses and path lengths as real numbers: rays of old sessions count for less than one.

    Parameters
    ----------
    grid : Grid
        Where the cells lie.
    hits, misses, path_lengths : ndarray, shape ``grid.shape``, or (V,)
        H, M and R (m) of every cell, or of those with keys.
    keys : ndarray of int64, shape (V,), optional
        Keys of the visited cells of a sparse map, increasing (:class:`~factorloc.mapping.bricks.BrickLayout`).

    Raises
    ------
    MapError
        If shapes disagree.
    """

    grid: Grid
    hits: Array
    misses: Array
    path_lengths: Array
    keys: Index | None = None

    def __post_init__(self) -> None:
        shape = self.grid.shape if self.keys is None else self.keys.shape
        for name in _NAMES:
            if getattr(self, name).shape != shape:
                raise MapError(f"{name}: shape {getattr(self, name).shape}; the map has {shape}")

    @classmethod
    def of(cls, counts: Counts) -> FadingCounts:
        """Take the counts of a map as they are."""
        if isinstance(counts, FadingCounts):
            return counts
        keys = counts.keys if isinstance(counts, BrickStatistics) else None
        hits, misses = counts.hits.astype(np.float64), counts.misses.astype(np.float64)
        return cls(counts.grid, hits, misses, counts.path_lengths, keys)

    @cached_property
    def visited(self) -> npt.NDArray[np.bool_]:
        """Cells with some count, shape as theirs."""
        return np.asarray((self.hits > 0) | (self.misses > 0) | (self.path_lengths > 0))

    def faded(self, forgetting: float) -> FadingCounts:
        """Return all counts times a factor in (0, 1].

        Raises
        ------
        MapError
            If it is out of bounds.
        """
        if not 0 < forgetting <= 1:
            raise MapError(f"forgetting: {forgetting}; expected a factor in (0, 1], 1 forgets nothing")
        if forgetting == 1:
            return self
        hits, misses, path = (getattr(self, name) * forgetting for name in _NAMES)
        return FadingCounts(self.grid, hits, misses, path, self.keys)

    def update(self, session: Counts, forgetting: float = 1.0) -> FadingCounts:
        """Return these counts, faded, with those of a new session.

        With ``forgetting = 1`` they are those of all sessions at once, to the last bit: hits, misses and path lengths
        (whole multiples of 2^-20 m) are added without rounding up to 2^53 units.

        Parameters
        ----------
        session : RayStatistics, BrickStatistics or FadingCounts
            Of the same raster; sparse, if these counts are.
        forgetting : float
            What older rays count for from now on, in (0, 1]. With n sessions a ray of the first counts for its
            ``n - 1``-th power; a map that is always seen alike keeps ``1 / (1 - forgetting)`` sessions in mind.

        Raises
        ------
        MapError
            If the rasters differ, or only one of the two is sparse.
        """
        return self.faded(forgetting) + FadingCounts.of(session)

    def __add__(self, other: FadingCounts) -> FadingCounts:
        """Merge counts of one raster; the grid becomes the union of both."""
        one, two = self.aligned(other)
        hits, misses, path = (getattr(one, name) + getattr(two, name) for name in _NAMES)
        return FadingCounts(one.grid, hits, misses, path, one.keys)

    def aligned(self, other: Counts) -> tuple[FadingCounts, FadingCounts]:
        """Lay both out on the union of their grids and, if sparse, of their cells: zeros where a map has none.

        Raises
        ------
        MapError
            If the rasters differ, or only one of the two is sparse.
        """
        second = FadingCounts.of(other)
        if (self.keys is None) != (second.keys is None):
            raise MapError("counts: one map is sparse, the other dense; use BrickStatistics.from_dense or to_dense")
        grid = self.grid if self.grid == second.grid else self.grid.union(second.grid)
        if self.keys is None:
            return self._spread(grid), second._spread(grid)
        one, two = self._renumbered(grid), second._renumbered(grid)
        keys = one if np.array_equal(one, two) else np.union1d(one, two)
        return self._on(grid, one, keys), second._on(grid, two, keys)

    def _spread(self, grid: Grid) -> FadingCounts:
        if grid == self.grid:
            return self
        window = grid.window(self.grid)
        hits, misses, path = (np.zeros(grid.shape) for _ in _NAMES)
        hits[window], misses[window], path[window] = self.hits, self.misses, self.path_lengths
        return FadingCounts(grid, hits, misses, path)

    def _renumbered(self, grid: Grid) -> Index:
        """Keys of the cells on a grid that holds this one; no longer in order."""
        keys = np.zeros(0, np.int64) if self.keys is None else self.keys
        if grid == self.grid:
            return keys
        none = np.zeros(0, np.int64)
        shift = np.round((np.array(self.grid.origin) - grid.origin) / grid.resolution).astype(np.int64)
        return BrickLayout(grid, none).keys(BrickLayout(self.grid, none).cells(keys) + shift)

    def _on(self, grid: Grid, own: Index, keys: Index) -> FadingCounts:
        if own is keys:
            return replace(self, grid=grid, keys=keys)
        place = np.searchsorted(keys, own)
        hits, misses, path = (np.zeros(len(keys)) for _ in _NAMES)
        hits[place], misses[place], path[place] = self.hits, self.misses, self.path_lengths
        return FadingCounts(grid, hits, misses, path, keys)


Counts = RayStatistics | BrickStatistics | FadingCounts
"""The counts of a map, of whatever kind."""
