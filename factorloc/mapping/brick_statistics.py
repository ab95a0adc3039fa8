"""Brick statistics: hits, misses and path length of a sparse spatial grid."""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from factorloc import _jit
from factorloc.errors import MapError
from factorloc.mapping._brick_kernels import count_visited, gather_visited
from factorloc.mapping._traversal_kernels import FIXED_POINT
from factorloc.mapping.bricks import BRICK, CELLS, BrickLayout
from factorloc.mapping.cell_tiles import CellTiles
from factorloc.mapping.grid import Grid, require_memory
from factorloc.mapping.ray_statistics import RayStatistics, add_counts, grid_of_scans, scan_blocks
from factorloc.mapping.spatial_accumulation import accumulate_bricks, most_rays, spatial_rays_in_map, touched_bricks
from factorloc.mapping.visited_cells import VisitedCells
from factorloc.rays import Rays
from factorloc.scan import RayStatus, Scan

__all__ = ["BrickStatistics"]

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]

_MOST_BRICKS = 1024  # in a pool while rays are added: 48 MiB


@dataclass(frozen=True)
class BrickStatistics:
    """Statistics of rays in a spatial grid of which only visited cells take memory, about 7 bytes each.

    What :class:`~factorloc.mapping.ray_statistics.RayStatistics` holds for every cell, this holds for those that some
    ray has met, brick by brick and sorted. The numbers are the same to the last bit; they are packed, as a hit or a
    miss is rarely one of many. While rays are added, the bricks they meet are laid out in full, at most 1024 of them
    at a time (48 MiB), and the sum shares with this map all tiles they do not touch: a map grows by streaming.

    Parameters
    ----------
    grid : Grid
        Where the cells lie; three axes.
    cells : CellTiles
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
    cells: CellTiles
    scans: int = 0
    left_out: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        layout = self.layout
        if len(layout.bricks) and not 0 <= layout.bricks[0] <= layout.bricks[-1] < np.prod(layout.shape):
            raise MapError("bricks: a number is none of the grid's; is the map damaged?")

    @classmethod
    def empty(cls, grid: Grid) -> BrickStatistics:
        """Statistics of no ray."""
        return cls(grid, CellTiles({}))

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
        counted = CellTiles.of_keys(keys[order], *values)
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
        return self.path_fixed / FIXED_POINT

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
        hits = sum(int(tile.hits.sum(dtype=np.int64)) for tile in added.tiles.values())
        left_out = {
            "below minimum range": int((~used).sum()),
            "ended outside the grid": int(returns.sum()) - hits,
        }
        return self + BrickStatistics(self.grid, added, len(rays), left_out)

    def _walk(self, origins: Array, directions: Array, lengths: Array, is_return: npt.NDArray[np.bool_]) -> CellTiles:
        """Cells of these rays alone, slab by slab; too many, or so many that a slab is too large, are halved."""
        threads = _jit.threads()
        layout = touched_bricks(origins, directions, lengths, is_return, self.grid, threads)
        slabs = layout.slabs(_MOST_BRICKS)
        largest = max((len(part.bricks) for _, _, part in slabs), default=0)
        if len(lengths) > 1 and (largest > _MOST_BRICKS or len(lengths) > most_rays(self.grid)):
            half = len(lengths) // 2
            one = self._walk(origins[:half], directions[:half], lengths[:half], is_return[:half])
            return one + self._walk(origins[half:], directions[half:], lengths[half:], is_return[half:])
        require_memory((largest + 1) * CELLS * 12, f"{largest} bricks of cells")
        cells = CellTiles({})
        for first, last, part in slabs:
            walked, ends = accumulate_bricks(origins, directions, lengths, is_return, part, threads, (first, last))
            cells += _gathered(part, walked, ends)
        return cells

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
        for tile, index in self._moved(grid):
            inside = ((index >= 0) & (index < grid.shape)).all(1)
            if inside.any():
                at = tuple(index[inside].T)
                for name in ("hits", "misses", "path_fixed"):
                    getattr(dense, name)[at] = getattr(tile, name)[inside]
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
        layout, cells = BrickLayout(grid, np.zeros(0, np.int64)), CellTiles({})
        for tile, index in self._moved(grid):
            rows = np.flatnonzero(((index >= 0) & (index < grid.shape)).all(1))
            keys = layout.keys(index[rows])
            order = np.argsort(keys)
            rows = rows[order]
            cells += CellTiles.of_keys(keys[order], tile.hits[rows], tile.misses[rows], tile.path_fixed[rows])
        return BrickStatistics(grid, cells, self.scans, dict(self.left_out))

    def _moved(self, grid: Grid) -> Iterator[tuple[VisitedCells, Index]]:
        """Tiles that touch a grid of the same raster, with the indices there of their cells."""
        shift = np.round((np.array(grid.origin) - self.grid.origin) / grid.resolution).astype(np.int64)
        for tile in self.cells.tiles.values():
            corner = BrickLayout(self.grid, tile.bricks).corners() - shift
            if ((corner + BRICK > 0) & (corner < grid.shape)).all(1).any():
                yield tile, self.layout.cells(tile.keys) - shift


def _gathered(layout: BrickLayout, walked: Index, ends: npt.NDArray[np.uint32]) -> CellTiles:
    """Pack the visited cells of a pool of bricks; arguments as :func:`accumulate_bricks` returns them."""
    counts = np.empty(len(layout.bricks), np.int64)
    count_visited(walked, ends, counts)
    offsets = np.concatenate([[0], np.cumsum(counts)])
    v = int(offsets[-1])
    local, hits, misses = np.empty(v, np.uint16), np.empty(v, np.uint32), np.empty(v, np.uint32)
    path = np.empty(v, np.int64)
    gather_visited(walked, ends, offsets, local, hits, misses, path)
    some = counts > 0
    offsets = np.concatenate([[0], np.cumsum(counts[some])])
    return CellTiles.in_order(layout.bricks[some], offsets, local, hits, misses, path)
