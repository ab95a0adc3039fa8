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
from factorloc.mapping._brick_kernels import count_visited, gather_visited, merge_sorted
from factorloc.mapping._traversal_kernels import FIXED_POINT
from factorloc.mapping.bricks import BRICK, CELLS, BrickLayout
from factorloc.mapping.grid import Grid, require_memory
from factorloc.mapping.ray_statistics import RayStatistics, add_counts, grid_of_scans, scan_blocks
from factorloc.mapping.spatial_accumulation import accumulate_bricks, spatial_rays_in_map, touched_bricks
from factorloc.rays import Rays
from factorloc.scan import RayStatus, Scan

__all__ = ["BrickStatistics"]

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]

_MOST_BRICKS = 4096  # in a pool while rays are added: 256 MiB
_MOST_VISITS = np.iinfo(np.uint32).max


@dataclass(frozen=True)
class BrickStatistics:
    """Statistics of rays in a spatial grid of which only visited cells take memory, 18 bytes each.

    What :class:`~factorloc.mapping.ray_statistics.RayStatistics` holds for every cell, this holds for those that some
    ray has met, brick by brick and sorted. The numbers are the same to the last bit. While rays are added, the bricks
    they meet are laid out in full, at most 4096 of them at a time (256 MiB): a map grows by streaming.

    Parameters
    ----------
    grid : Grid
        Where the cells lie; three axes.
    bricks : ndarray of int64, shape (B,)
        Numbers of the bricks with visited cells, increasing (:class:`~factorloc.mapping.bricks.BrickLayout`).
    offsets : ndarray of int64, shape (B + 1,)
        Brick ``k`` owns the cells ``offsets[k]:offsets[k + 1]``.
    local : ndarray of uint16, shape (V,)
        Number of each cell in its brick, increasing within each.
    hits, misses : ndarray of uint32, shape (V,)
        H and M of the thesis (chapters 7 and 8).
    path_fixed : ndarray of int64, shape (V,)
        Path length in units of 2^-20 m.
    scans : int
        Scans that were added.
    left_out : dict of str to int
        Rays not used, by reason.

    Raises
    ------
    MapError
        If the grid is planar, or the arrays disagree.
    """

    grid: Grid
    bricks: Index
    offsets: Index
    local: npt.NDArray[np.uint16]
    hits: npt.NDArray[np.uint32]
    misses: npt.NDArray[np.uint32]
    path_fixed: Index
    scans: int = 0
    left_out: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        count = int(self.offsets[-1]) if len(self.offsets) else -1
        sizes = {len(getattr(self, name)) for name in ("local", "hits", "misses", "path_fixed")}
        most = int(np.prod(self.layout.shape))
        sound = (
            len(self.offsets) == len(self.bricks) + 1
            and sizes == {count}
            and (np.diff(self.offsets) >= 0).all()
            and (np.diff(self.bricks) > 0).all()
            and (len(self.bricks) == 0 or 0 <= self.bricks[0] <= self.bricks[-1] < most)
            and (self.local < CELLS).all()
        )
        if not sound:
            raise MapError("bricks: numbers, offsets and cells disagree; is the map damaged?")

    @classmethod
    def empty(cls, grid: Grid) -> BrickStatistics:
        """Statistics of no ray."""
        none = np.zeros(0, np.int64)
        return cls._of_keys(grid, none, none.astype(np.uint32), none.astype(np.uint32), none, 0, {})

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
        return cls._of_keys(statistics.grid, keys[order], *values, statistics.scans, dict(statistics.left_out))

    @property
    def layout(self) -> BrickLayout:
        """Which bricks there are."""
        return BrickLayout(self.grid, self.bricks)

    @property
    def keys(self) -> Index:
        """Key of each visited cell, increasing, shape (V,)."""
        return np.repeat(self.bricks, np.diff(self.offsets)) * CELLS + self.local

    @property
    def path_lengths(self) -> Array:
        """Path length of all rays in each visited cell, m (R of the thesis)."""
        return self.path_fixed / FIXED_POINT

    @property
    def nbytes(self) -> int:
        """Memory of the arrays."""
        arrays = self.bricks, self.offsets, self.local, self.hits, self.misses, self.path_fixed
        return sum(array.nbytes for array in arrays)

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
        """Statistics of these rays alone; so many rays that they meet too many bricks are halved."""
        threads = _jit.threads()
        layout = touched_bricks(origins, directions, lengths, is_return, self.grid, threads)
        if len(layout.bricks) > _MOST_BRICKS and len(lengths) > 1:
            half = len(lengths) // 2
            one = self._walk(origins[:half], directions[:half], lengths[:half], is_return[:half])
            return one + self._walk(origins[half:], directions[half:], lengths[half:], is_return[half:])
        require_memory((len(layout.bricks) + 1) * CELLS * 16, f"{len(layout.bricks)} bricks of cells")
        pool = accumulate_bricks(origins, directions, lengths, is_return, layout, threads)
        counts = np.empty(len(layout.bricks), np.int64)
        count_visited(pool, counts)
        offsets = np.concatenate([[0], np.cumsum(counts)])
        v = int(offsets[-1])
        local, hits, misses = np.empty(v, np.uint16), np.empty(v, np.uint32), np.empty(v, np.uint32)
        path = np.empty(v, np.int64)
        gather_visited(pool, offsets, local, hits, misses, path)
        some = counts > 0
        offsets = np.concatenate([[0], np.cumsum(counts[some])])
        return BrickStatistics(self.grid, layout.bricks[some], offsets, local, hits, misses, path)

    def __add__(self, other: BrickStatistics) -> BrickStatistics:
        """Merge statistics of one raster; the grid becomes the union of both.

        Raises
        ------
        MapError
            If the two do not share frame, resolution and raster, or a cell saw more than 2^32 - 1 rays.
        """
        grid = self.grid if self.grid == other.grid else self.grid.union(other.grid)
        a, b = self._on(grid), other._on(grid)
        from_a, from_b = np.empty(len(a.local), np.int64), np.empty(len(b.local), np.int64)
        keys_a, keys_b = a.keys, b.keys
        count = merge_sorted(keys_a, keys_b, from_a, from_b)
        keys = np.empty(count, np.int64)
        keys[from_a], keys[from_b] = keys_a, keys_b
        sums = []
        for name in ("hits", "misses", "path_fixed"):
            total = np.zeros(count, np.int64)
            total[from_a] = getattr(a, name)
            total[from_b] += getattr(b, name)
            sums.append(total)
        if max(sums[0].max(initial=0), sums[1].max(initial=0)) > _MOST_VISITS:
            raise MapError(f"a cell was visited more than {_MOST_VISITS} times, where its counts end; split the map")
        hits, misses, path = sums[0].astype(np.uint32), sums[1].astype(np.uint32), sums[2]
        left_out = add_counts(self.left_out, other.left_out)
        return BrickStatistics._of_keys(grid, keys, hits, misses, path, self.scans + other.scans, left_out)

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
        near = np.flatnonzero(((corner + BRICK > 0) & (corner < grid.shape)).all(1))
        rows = _ranges(self.offsets[near], self.offsets[near + 1])
        cells = self.layout.cells(self.keys_of(near)) - shift
        inside = ((cells >= 0) & (cells < grid.shape)).all(1)
        at, rows = tuple(cells[inside].T), rows[inside]
        dense.hits[at], dense.misses[at], dense.path_fixed[at] = (
            self.hits[rows],
            self.misses[rows],
            self.path_fixed[rows],
        )
        return replace(dense, scans=self.scans, left_out=dict(self.left_out))

    def keys_of(self, places: Index) -> Index:
        """Keys of the visited cells of some bricks, given by their places in ``bricks``."""
        counts = self.offsets[places + 1] - self.offsets[places]
        rows = _ranges(self.offsets[places], self.offsets[places + 1])
        return np.asarray(np.repeat(self.bricks[places], counts) * CELLS + self.local[rows])

    def to_dense(self) -> RayStatistics:
        """Lay out the whole map in full."""
        return self.window(self.grid)

    def crop(self, grid: Grid) -> BrickStatistics:
        """Return the part of the map within a grid of the same raster.

        Raises
        ------
        MapError
            If the rasters differ.
        """
        return self._on(grid)

    def _on(self, grid: Grid) -> BrickStatistics:
        """The same cells numbered on another grid of the raster; cells outside of it are dropped."""
        if grid == self.grid:
            return self
        if not self.grid.shares_raster(grid):
            raise MapError(f"grid: {grid} does not lie on the raster of the map")
        shift = np.round((np.array(grid.origin) - self.grid.origin) / grid.resolution).astype(np.int64)
        cells = self.layout.cells(self.keys) - shift
        rows = np.flatnonzero(((cells >= 0) & (cells < grid.shape)).all(1))
        keys = BrickLayout(grid, np.zeros(0, np.int64)).keys(cells[rows])
        rows = rows[np.argsort(keys)]
        values = self.hits[rows], self.misses[rows], self.path_fixed[rows]
        return BrickStatistics._of_keys(grid, np.sort(keys), *values, self.scans, dict(self.left_out))

    @staticmethod
    def _of_keys(
        grid: Grid,
        keys: Index,
        hits: npt.NDArray[np.uint32],
        misses: npt.NDArray[np.uint32],
        path_fixed: Index,
        scans: int,
        left_out: dict[str, int],
    ) -> BrickStatistics:
        brick = keys // CELLS
        first = np.flatnonzero(np.diff(brick, prepend=-1))
        offsets = np.append(first, len(keys)).astype(np.int64)
        local = (keys % CELLS).astype(np.uint16)
        return BrickStatistics(grid, brick[first], offsets, local, hits, misses, path_fixed, scans, left_out)


def _ranges(starts: Index, stops: Index) -> Index:
    """All numbers of several ranges, one after the other."""
    counts = stops - starts
    total = int(counts.sum())
    skip = np.repeat(starts - np.concatenate([[0], np.cumsum(counts)[:-1]]) if len(counts) else starts, counts)
    return np.asarray(np.arange(total) + skip)
