"""Accumulation in space: rays walked through dense grids and bricks by threads that own slabs of cells."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from factorloc import _jit
from factorloc.errors import MapError
from factorloc.geometry import se3
from factorloc.mapping._spatial_traversal_kernels import BRICK, accumulate_spatial
from factorloc.mapping._traversal_kernels import FIXED_POINT, MOST_RAYS
from factorloc.mapping.bricks import CELLS, BrickLayout
from factorloc.mapping.grid import Grid
from factorloc.rays import Rays

__all__ = [
    "accumulate_bricks",
    "accumulate_dense",
    "most_rays",
    "spatial_rays_in_map",
    "touched_bricks",
    "walk_spatial",
]

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]

_SLABS_A_THREAD = 2  # smaller ones stay in the cache, but every ray is looked at by each
_SAMPLES = 4096  # rays that tell where the work lies


def spatial_rays_in_map(rays: Rays, poses: npt.ArrayLike) -> tuple[Array, Array]:
    """Origins and directions of spatial rays in the frame of the map, one pose ``T_map_body`` a scan.

    Parameters
    ----------
    rays : Rays
        Rays in body frames.
    poses : array_like, shape (S, 4, 4)
        One pose a scan.

    Returns
    -------
    origins, directions : ndarray, shape (M, 3)
        Contiguous.

    Raises
    ------
    MapError
        If the rays are planar, or there is not one spatial pose a scan.
    """
    if rays.dimension != 3:
        raise MapError("scans: planar; this grid of ray statistics is spatial")
    array = se3.as_poses(poses)
    if array.shape != (len(rays), 4, 4):
        raise MapError(f"poses: shape {array.shape}; expected one spatial pose for each of the {len(rays)} scans")
    origins, directions = np.empty_like(rays.origins), np.empty_like(rays.directions)
    for k, pose in enumerate(array):
        part = slice(int(rays.offsets[k]), int(rays.offsets[k + 1]))
        origins[part] = rays.origins[part] @ pose[:3, :3].T + pose[:3, 3]
        directions[part] = rays.directions[part] @ pose[:3, :3].T
    return origins, directions


def accumulate_dense(
    origins: Array, directions: Array, lengths: Array, is_return: npt.NDArray[np.bool_], grid: Grid, threads: int
) -> tuple[Index, npt.NDArray[np.uint32]]:
    """Walk rays through a dense spatial grid.

    Arguments as :func:`factorloc.mapping._spatial_traversal_kernels.accumulate_spatial`; at most
    :func:`most_rays`.

    Returns
    -------
    walked : ndarray of int64, shape ``grid.shape``
        Path length of each cell above its misses in the lower 22 bits.
    hits : ndarray of uint32, shape ``grid.shape``
    """
    rim = tuple(n + 2 for n in grid.shape)
    walked, hits = np.zeros(rim, np.int64), np.zeros(rim, np.uint32)
    walk_spatial(origins, directions, lengths, is_return, grid, None, walked.ravel(), hits.ravel(), threads)
    return walked[1:-1, 1:-1, 1:-1], hits[1:-1, 1:-1, 1:-1]


def most_rays(grid: Grid) -> int:
    """Rays that may be walked at a time before misses or path lengths of a cell could overflow."""
    return max(1, min(MOST_RAYS, int(2**41 / (2.0 * grid.resolution * FIXED_POINT))))


def touched_bricks(
    origins: Array, directions: Array, lengths: Array, is_return: npt.NDArray[np.bool_], grid: Grid, threads: int
) -> BrickLayout:
    """Find the bricks that rays meet, by walking a grid whose cells are bricks.

    Its planes are among those of the fine grid, and crossed in the same order: no ray meets another brick. Path lengths
    may overflow here; the bits of misses and hits cannot.
    """
    layout = BrickLayout(grid, np.zeros(0, np.int64))
    coarse = Grid(grid.origin, grid.resolution * BRICK, layout.shape, grid.frame)
    walked, hits = accumulate_dense(origins, directions, lengths, is_return, coarse, threads)
    return BrickLayout(grid, np.flatnonzero((walked != 0) | (hits != 0)))


def accumulate_bricks(
    origins: Array,
    directions: Array,
    lengths: Array,
    is_return: npt.NDArray[np.bool_],
    layout: BrickLayout,
    threads: int,
    between: tuple[int, int] | None = None,
) -> tuple[Index, npt.NDArray[np.uint32]]:
    """Walk rays through bricks, at most :func:`most_rays`.

    Parameters
    ----------
    between : (first, last), optional
        Walk only cells ``first <= x < last``; the bricks need not hold others.

    Returns
    -------
    walked : ndarray of int64, shape ``(bricks + 1, 4096)``
        Path length of each cell above its misses in the lower 22 bits; the first brick is spare.
    hits : ndarray of uint32, shape ``(bricks + 1, 4096)``
    """
    shape = (len(layout.bricks) + 1, CELLS)
    walked, hits = np.zeros(shape, np.int64), np.zeros(shape, np.uint32)
    directory = layout.directory
    walk_spatial(
        origins, directions, lengths, is_return, layout.grid, directory, walked.ravel(), hits.ravel(), threads, between
    )  # fmt: skip
    return walked, hits


def walk_spatial(
    origins: Array,
    directions: Array,
    lengths: Array,
    is_return: npt.NDArray[np.bool_],
    grid: Grid,
    directory: npt.NDArray[np.int32] | None,
    walked: Index,
    hits: npt.NDArray[np.uint32],
    threads: int,
    between: tuple[int, int] | None = None,
) -> None:
    """Walk rays through arrays that are there, in threads that own slabs of them; arguments as the kernel's."""
    low = np.array(grid.origin)
    first_x, last_x = between or (0, grid.shape[0])
    edges = _slabs(origins, directions, lengths, grid, _SLABS_A_THREAD * threads if threads > 1 else 1, first_x, last_x)

    def walk(first: int, last: int) -> None:
        for slab in range(first, last):
            accumulate_spatial(
                origins, directions, lengths, is_return, edges[slab], edges[slab + 1], low, grid.resolution,
                grid.shape, directory, walked, hits,
            )  # fmt: skip

    _jit.in_threads(walk, len(edges) - 1)


def _slabs(
    origins: Array, directions: Array, lengths: Array, grid: Grid, count: int, first_x: int, last_x: int
) -> list[int]:
    """Cells along x at which slabs of about equal work begin, with the end."""
    if count == 1 or len(lengths) == 0:
        return [first_x, last_x]
    some = slice(None, None, max(1, len(lengths) // _SAMPLES))
    along = np.linspace(0.05, 0.95, 10) * lengths[some, None]
    x = (origins[some, :1] + directions[some, :1] * along - grid.origin[0]) / grid.resolution
    weights = np.broadcast_to(lengths[some, None], x.shape)
    cell = np.clip(x, 0, grid.shape[0] - 1).astype(np.int64) - first_x
    inside = (cell >= 0) & (cell < last_x - first_x)
    work = np.bincount(cell[inside], weights[inside], last_x - first_x).cumsum()
    inner = first_x + np.searchsorted(work, work[-1] * np.arange(1, count) / count) + 1
    return [int(x) for x in np.unique(np.clip([first_x, *inner, last_x], first_x, last_x))]
