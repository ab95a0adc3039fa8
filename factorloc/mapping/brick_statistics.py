"""Brick statistics: hits, misses and path length of a sparse spatial grid."""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from factorloc import _jit
from factorloc.errors import MapError
from factorloc.mapping._brick_kernels import count_visited, gather_visited
from factorloc.mapping.bricks import BRICK, CELLS, BrickLayout
from factorloc.mapping.grid import Grid, require_memory
from factorloc.mapping.ray_statistics import RayStatistics, add_counts, grid_of_scans, scan_blocks
from factorloc.mapping.spatial_accumulation import accumulate_bricks, most_rays, spatial_rays_in_map, touched_bricks
from factorloc.mapping.visited_cells import VisitedCells
from factorloc.rays import Rays
from factorloc.scan import RayStatus, Scan

__all__ = ["BrickStatistics"]

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]

_MOST_BRICKS = 4096  # in a pool while rays are added: 192 MiB


@dataclass(frozen=True)
class BrickStatistics:
    """Statistics of rays in a spatial grid of which only visited cells take memory, about 7 bytes each.

    What :class:`~factorloc.mapping.ray_statistics.RayStatistics` holds for every cell, this holds for those that some
    ray has met, brick by brick and sorted. The numbers are the same to the last bit; they are packed, as a hit or a
    miss is rarely one of many. While rays are added, the bricks they meet are laid out in full, at most 4096 of them
    at a time (192 MiB): a map grows by streaming.

    Parameters
    ----------
    grid : Grid
        Where the cells lie; three axes.
    cells : VisitedCells
        Their counts.
    scans : int
        Scans that were added.
    left_out : dict of str to int
        Rays not used, by reason.

    Raises
    ------
    MapError
        If the grid is planar, or a brick is none of its own.
    """

    grid: Grid
    cells: VisitedCells
    scans: int = 0
    left_out: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        bricks = self.cells.bricks
        if len(bricks) and not 0 <= bricks[0] <= bricks[-1] < np.prod(self.layout.shape):
            raise MapError("bricks: a number is none of the grid's; is the map damaged?")

    @classmethod
    def empty(cls, grid: Grid) -> BrickStatistics:
        """Statistics of no ray."""
        none = np.zeros(0, np.int64)
        BrickLayout(grid, none)
        return cls(grid, VisitedCells.of_keys(none, none.astype(np.uint32), none.astype(np.uint32), none))

    @classmethod
    def from_scans(
        cls,
        scans: Sequence[Scan],
        poses: npt.ArrayLike,
        *,
        resolution: float = 0.2,
        grid: Grid | None = None,
        frame: str = "map",
        progress: Callable[[int], None] | None = None,
    ) -> BrickStatistics:
        """Accumulate spatial scans taken at known poses; as :meth:`RayStatistics.from_scans`."""
        rays, poses, grid = grid_of_scans(scans, poses, resolution, grid, frame)
        statistics = cls.empty(grid)
        for first, last, block in scan_blocks(rays):
            statistics = statistics.add(block, poses[first:last])
            if progress:
                progress(last)
        return statistics

    @classmethod
    def from_dense(cls, statistics: RayStatistics) -> BrickStatistics:
        """Keep of dense statistics only the visited cells."""
        layout = BrickLayout(statistics.grid, np.zeros(0, np.int64))
        seen = (statistics.path_fixed != 0) | (statistics.hits != 0) | (statistics.misses != 0)
        cells = np.argwhere(seen)
        keys = layout.keys(cells)
        order = np.argsort(keys)
        at = tuple(cells[order].T)
        values = statistics.hits[at], statistics.misses[at], statistics.path_fixed[at]
        counted = VisitedCells.of_keys(keys[order], *values)
        return cls(statistics.grid, counted, statistics.scans, dict(statistics.left_out))

    @property
    def layout(self) -> BrickLayout:
        """Which bricks there are."""
        return BrickLayout(self.grid, self.cells.bricks)

    @property
    def keys(self) -> Index:
        """Key of each visited cell, increasing, shape (V,)."""
        return self.cells.keys

    @property
    def hits(self) -> npt.NDArray[np.uint32]:
        """Rays reflected in each visited cell (H of the thesis, chapters 7 and 8), shape (V,)."""
        return self.cells.hits

    @property
    def misses(self) -> npt.NDArray[np.uint32]:
        """Rays that crossed each visited cell (M), shape (V,)."""
        return self.cells.misses

    @property
    def path_fixed(self) -> Index:
        """Path length in each visited cell, in units of 2^-20 m, shape (V,)."""
        return self.cells.path_fixed

    @property
    def path_lengths(self) -> Array:
        """Path length of all rays in each visited cell, m (R of the thesis), shape (V,)."""
        return self.cells.path_lengths

    @property
    def nbytes(self) -> int:
        """Memory of the counts."""
        return self.cells.nbytes

    def add(self, rays: Rays, poses: npt.ArrayLike) -> BrickStatistics:
        """Return these statistics with more rays.

        Parameters
        ----------
        rays : Rays
            Spatial rays in body frames.
        poses : array_like, shape (S, 4, 4)
            Pose ``T_map_body`` of each scan.

        Raises
        ------
        MapError
            If poses, rays and grid do not fit, or a cell would see more than 2^32 - 1 rays.
        """
        used = rays.status != RayStatus.BELOW_MINIMUM
        walked = rays.select(used)
        origins, directions = spatial_rays_in_map(walked, poses)
        returns = np.asarray(walked.status == RayStatus.RETURN)
        added = self._walk(origins, directions, walked.ranges, returns)
        left_out = {
            "below minimum range": int((~used).sum()),
            "ended outside the grid": int(returns.sum()) - int(added.hits.sum()),
        }
        return self + replace(added, scans=len(rays), left_out=left_out)

    def _walk(
        self, origins: Array, directions: Array, lengths: Array, is_return: npt.NDArray[np.bool_]
    ) -> BrickStatistics:
        """Statistics of these rays alone; too many, or so many that they meet too many bricks, are halved."""
        threads = _jit.threads()
        layout = touched_bricks(origins, directions, lengths, is_return, self.grid, threads)
        if (len(layout.bricks) > _MOST_BRICKS and len(lengths) > 1) or len(lengths) > most_rays(self.grid):
            half = len(lengths) // 2
            one = self._walk(origins[:half], directions[:half], lengths[:half], is_return[:half])
            return one + self._walk(origins[half:], directions[half:], lengths[half:], is_return[half:])
        require_memory((len(layout.bricks) + 1) * CELLS * 12, f"{len(layout.bricks)} bricks of cells")
        walked, ends = accumulate_bricks(origins, directions, lengths, is_return, layout, threads)
        counts = np.empty(len(layout.bricks), np.int64)
        count_visited(walked, ends, counts)
        offsets = np.concatenate([[0], np.cumsum(counts)])
        v = int(offsets[-1])
        local, hits, misses = np.empty(v, np.uint16), np.empty(v, np.uint32), np.empty(v, np.uint32)
        path = np.empty(v, np.int64)
        gather_visited(walked, ends, offsets, local, hits, misses, path)
        some = counts > 0
        offsets = np.concatenate([[0], np.cumsum(counts[some])])
        return BrickStatistics(
            self.grid, VisitedCells.in_order(layout.bricks[some], offsets, local, hits, misses, path)
        )

    def __add__(self, other: BrickStatistics) -> BrickStatistics:
        """Merge statistics of one raster; the grid becomes the union of both.

        Raises
        ------
        MapError
            If the two do not share frame, resolution and raster, or a cell saw more than 2^32 - 1 rays.
        """
        grid = self.grid if self.grid == other.grid else self.grid.union(other.grid)
        cells = self.crop(grid).cells + other.crop(grid).cells
        return BrickStatistics(grid, cells, self.scans + other.scans, add_counts(self.left_out, other.left_out))

    @staticmethod
    def merge(parts: Sequence[BrickStatistics]) -> BrickStatistics:
        """Merge any number of parts; see :meth:`__add__`.

        Raises
        ------
        MapError
            If there is none, or they do not share frame, resolution and raster.
        """
        if not parts:
            raise MapError("parts: none given; there is no grid to put nothing on")
        return functools.reduce(operator.add, parts)

    def window(self, grid: Grid) -> RayStatistics:
        """Lay out a part of the map in full.

        Parameters
        ----------
        grid : Grid
            Cells on the same raster; they may reach beyond the map.

        Raises
        ------
        MapError
            If the rasters differ, or the part does not fit into memory.
        """
        if not self.grid.shares_raster(grid):
            raise MapError(f"window: {grid} does not lie on the raster of the map")
        dense = RayStatistics.empty(grid)
        shift = np.round((np.array(grid.origin) - self.grid.origin) / grid.resolution).astype(np.int64)
        corner = self.layout.corners() - shift
        part = self.cells.of_bricks(np.flatnonzero(((corner + BRICK > 0) & (corner < grid.shape)).all(1)))
        index = self.layout.cells(part.keys) - shift
        inside = ((index >= 0) & (index < grid.shape)).all(1)
        at = tuple(index[inside].T)
        for name in ("hits", "misses", "path_fixed"):
            getattr(dense, name)[at] = getattr(part, name)[inside]
        return replace(dense, scans=self.scans, left_out=dict(self.left_out))

    def to_dense(self) -> RayStatistics:
        """Lay out the whole map in full."""
        return self.window(self.grid)

    def crop(self, grid: Grid) -> BrickStatistics:
        """Return the part of the map within a grid of the same raster, numbered on that.

        Raises
        ------
        MapError
            If the rasters differ.
        """
        if grid == self.grid:
            return self
        if not self.grid.shares_raster(grid):
            raise MapError(f"grid: {grid} does not lie on the raster of the map")
        shift = np.round((np.array(grid.origin) - self.grid.origin) / grid.resolution).astype(np.int64)
        index = self.layout.cells(self.keys) - shift
        rows = np.flatnonzero(((index >= 0) & (index < grid.shape)).all(1))
        keys = BrickLayout(grid, np.zeros(0, np.int64)).keys(index[rows])
        order = np.argsort(keys)
        rows = rows[order]
        cells = VisitedCells.of_keys(keys[order], self.hits[rows], self.misses[rows], self.path_fixed[rows])
        return BrickStatistics(grid, cells, self.scans, dict(self.left_out))
