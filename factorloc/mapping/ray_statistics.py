"""Ray statistics: hits, misses and path length of every cell, the sufficient statistics of the beam models."""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from factorloc import _jit
from factorloc.errors import MapError
from factorloc.geometry import se2, se3
from factorloc.mapping._traversal_kernels import FIXED_POINT, MISS_BITS
from factorloc.mapping.accumulation import BYTES_A_THREAD, accumulate_rays, rays_in_map
from factorloc.mapping.grid import Grid, require_memory
from factorloc.mapping.spatial_accumulation import accumulate_dense, most_rays, spatial_rays_in_map
from factorloc.rays import Rays, pack
from factorloc.scan import RayStatus, Scan

__all__ = ["RayStatistics", "add_counts", "grid_of_scans", "scan_blocks"]

Array = npt.NDArray[np.float64]

_BLOCK_RAYS = 2_000_000
_PARALLEL_RAYS = 2_000  # fewer are walked faster than threads are woken
_MOST_VISITS = np.iinfo(np.uint32).max


@dataclass(frozen=True)
class RayStatistics:
    """Statistics of rays that crossed the cells of a grid.

    Every ray leaves its path length in each cell it crosses, a hit in the cell that reflects it and a miss in every
    other; a ray without return leaves misses up to the maximum range. Rays reflected below the minimum range tell
    neither where nor how far they went: they are counted in ``left_out`` only. All sums are integers, so the statistics
    do not depend on the order of the rays, on the number of threads, or on how they were split into parts.

    Parameters
    ----------
    grid : Grid
        Where the cells lie.
    hits, misses : ndarray of uint32, shape ``grid.shape``
        H and M of the thesis (chapters 7 and 8).
    path_fixed : ndarray of int64, shape ``grid.shape``
        Path length in units of 2^-20 m; see :attr:`path_lengths`.
    scans : int
        Scans that were added.
    left_out : dict of str to int
        Rays not used, by reason.
    """

    grid: Grid
    hits: npt.NDArray[np.uint32]
    misses: npt.NDArray[np.uint32]
    path_fixed: npt.NDArray[np.int64]
    scans: int = 0
    left_out: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("hits", "misses", "path_fixed"):
            if getattr(self, name).shape != self.grid.shape:
                raise MapError(f"{name}: shape {getattr(self, name).shape}; the grid has {self.grid.shape}")

    @classmethod
    def empty(cls, grid: Grid) -> RayStatistics:
        """Statistics of no ray.

        Raises
        ------
        MapError
            If they would not fit into memory (16 bytes a cell; as many again, and 12 a thread, while rays are added).
        """
        _require_memory(grid, 16)
        return cls(
            grid, np.zeros(grid.shape, np.uint32), np.zeros(grid.shape, np.uint32), np.zeros(grid.shape, np.int64)
        )

    @classmethod
    def from_scans(
        cls,
        scans: Sequence[Scan],
        poses: npt.ArrayLike,
        *,
        resolution: float = 0.1,
        grid: Grid | None = None,
        frame: str = "map",
        progress: Callable[[int], None] | None = None,
    ) -> RayStatistics:
        """Accumulate scans taken at known poses.

        Parameters
        ----------
        scans : sequence of Scan
            All planar, or all spatial.
        poses : array_like, shape (S, 3) or (S, 4, 4)
            Pose ``T_map_body`` of each scan.
        resolution : float
            Edge length of a cell, m; used when no grid is given.
        grid : Grid, optional
            Where to accumulate; by default around all returns and sensors.
        frame : str
            Name of the map's frame; used when no grid is given.
        progress : callable, optional
            Called with the number of scans done.

        Raises
        ------
        MapError
            If the poses do not fit the scans, the grid does not fit into memory, or its frame is another dimension.
        """
        rays, poses, grid = grid_of_scans(scans, poses, resolution, grid, frame)
        statistics = cls.empty(grid)
        for first, last, block in scan_blocks(rays):
            statistics = statistics.add(block, poses[first:last])
            if progress:
                progress(last)
        return statistics

    @property
    def path_lengths(self) -> Array:
        """Path length of all rays in each cell, m (R of the thesis)."""
        return self.path_fixed / FIXED_POINT

    @property
    def visits(self) -> npt.NDArray[np.int64]:
        """Rays that entered each cell: hits plus misses."""
        return self.hits.astype(np.int64) + self.misses

    def add(self, rays: Rays, poses: npt.ArrayLike) -> RayStatistics:
        """Return these statistics with more rays.

        Parameters
        ----------
        rays : Rays
            Rays in body frames.
        poses : array_like, shape (S, 3) or (S, 4, 4)
            Pose ``T_map_body`` of each scan.

        Raises
        ------
        MapError
            If poses, rays and grid do not fit, a cell would see more than 2^32 - 1 rays, or memory is short.
        """
        used = rays.status != RayStatus.BELOW_MINIMUM
        walked = rays.select(used)
        planar = self.grid.dimension == 2
        origins, directions = rays_in_map(walked, poses) if planar else spatial_rays_in_map(walked, poses)
        returns = np.asarray(walked.status == RayStatus.RETURN)
        threads = _jit.threads() if len(returns) > _PARALLEL_RAYS else 1
        if int(self.visits.max(initial=0)) + len(returns) > _MOST_VISITS:
            raise MapError(f"a cell may see more than {_MOST_VISITS} rays, where its counts end; split the map")
        # Threads own private grids in the plane, and slabs of one grid in space.
        _require_memory(self.grid, 16 + BYTES_A_THREAD * (threads if planar else 1))
        hits, misses, path = self.hits.copy(), self.misses.copy(), self.path_fixed.copy()
        if planar:
            accumulate_rays(
                origins, directions, walked.ranges, returns, np.array(self.grid.origin), self.grid.resolution,
                (self.grid.shape[0], self.grid.shape[1]), threads, hits, misses, path,
            )  # fmt: skip
        else:
            most = most_rays(self.grid)
            for first in range(0, len(returns), most):
                some = slice(first, first + most)
                packed, own_hits = accumulate_dense(
                    origins[some], directions[some], walked.ranges[some], returns[some], self.grid, threads
                )
                path += packed >> MISS_BITS
                misses += (packed & (2**MISS_BITS - 1)).astype(np.uint32)
                hits += own_hits
        left_out = {
            "below minimum range": int((~used).sum()),
            "ended outside the grid": int(returns.sum()) - (int(hits.sum()) - int(self.hits.sum())),
        }
        return RayStatistics(
            self.grid,
            hits,
            misses,
            path,
            self.scans + len(rays),
            add_counts(self.left_out, left_out),
        )

    def __add__(self, other: RayStatistics) -> RayStatistics:
        """Merge statistics of one raster; the grid becomes the union of both.

        Raises
        ------
        MapError
            If the two do not share frame, resolution and raster.
        """
        grid = self.grid.union(other.grid)
        _require_memory(grid, 32)
        hits, misses, path = (np.zeros(grid.shape, np.int64) for _ in range(3))
        for part in (self, other):
            window = grid.window(part.grid)
            hits[window] += part.hits
            misses[window] += part.misses
            path[window] += part.path_fixed
        return RayStatistics(
            grid,
            _checked(hits),
            _checked(misses),
            path,
            self.scans + other.scans,
            add_counts(self.left_out, other.left_out),
        )

    @staticmethod
    def merge(parts: Sequence[RayStatistics]) -> RayStatistics:
        """Merge any number of parts; see :meth:`__add__`.

        Raises
        ------
        MapError
            If there is none, or they do not share frame, resolution and raster.
        """
        if not parts:
            raise MapError("parts: none given; there is no grid to put nothing on")
        return functools.reduce(operator.add, parts)


def _require_memory(grid: Grid, bytes_a_cell: int) -> None:
    require_memory(grid.cells * bytes_a_cell, f"a grid of {' x '.join(map(str, grid.shape))} cells")


def grid_of_scans(
    scans: Sequence[Scan], poses: npt.ArrayLike, resolution: float, grid: Grid | None, frame: str
) -> tuple[Rays, Array, Grid]:
    """Pack scans, check their poses and lay a grid around them if none is given.

    Raises
    ------
    MapError
        If the poses do not fit the scans, or not one ray has a return to lay a grid around.
    """
    rays = pack(scans)
    planar = rays.dimension == 2
    array = se2.as_poses(poses) if planar else se3.as_poses(poses)
    expected = (len(rays), 3) if planar else (len(rays), 4, 4)
    if array.shape != expected:
        kind = "planar" if planar else "spatial"
        raise MapError(f"poses: shape {array.shape}; expected one {kind} pose for each of the {len(rays)} scans")
    if grid is not None:
        return rays, array, grid
    returns = rays.returns()
    if len(returns.ranges) == 0:
        raise MapError("scans: not one ray has a return; a map needs some")
    origins, directions = rays_in_map(returns, array) if planar else spatial_rays_in_map(returns, array)
    ends = origins + directions * returns.ranges[:, None]
    bodies = array[:, :2] if planar else array[:, :3, 3]
    return rays, array, Grid.around(np.concatenate([ends, origins, bodies]), resolution, frame=frame)


def scan_blocks(rays: Rays) -> Iterator[tuple[int, int, Rays]]:
    """Cut rays into blocks of whole scans, as many as keep the moved rays small: first scan, last, and their rays."""
    first = 0
    while first < len(rays):
        last = int(np.searchsorted(rays.offsets, rays.offsets[first] + _BLOCK_RAYS, side="right")) - 1
        last = min(max(last, first + 1), len(rays))
        yield first, last, _slice(rays, first, last)
        first = last


def _slice(rays: Rays, first: int, last: int) -> Rays:
    rows = slice(int(rays.offsets[first]), int(rays.offsets[last]))
    offsets = rays.offsets[first : last + 1] - rays.offsets[first]
    return Rays(rays.origins[rows], rays.directions[rows], rays.ranges[rows], rays.status[rows], offsets)


def _checked(counts: npt.NDArray[np.int64]) -> npt.NDArray[np.uint32]:
    if counts.max(initial=0) > _MOST_VISITS:
        raise MapError(f"a cell was visited {counts.max()} times; counts end at {_MOST_VISITS}: split the map")
    return counts.astype(np.uint32)


def add_counts(first: dict[str, int], second: dict[str, int]) -> dict[str, int]:
    """Add up two accounts of things left out."""
    return {key: first.get(key, 0) + second.get(key, 0) for key in {**first, **second}}
