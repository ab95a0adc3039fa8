"""Body rays: one scan as kernels in space take it, placed in a map at one pose or at many."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc import _jit
from factorloc.errors import MapError
from factorloc.geometry import se3
from factorloc.mapping.grid import Grid
from factorloc.rays import pack
from factorloc.scan import Scan

__all__ = ["BodyRays", "RayKernel", "checked_poses", "require_dimension"]

Array = npt.NDArray[np.float64]


def require_dimension(scan: Scan, grid: Grid) -> None:
    """Refuse a scan of another dimension than the map's.

    Raises
    ------
    MapError
        If they differ.
    """
    if scan.dimension != grid.dimension:
        raise MapError(f"scan: it has {scan.dimension} dimensions, the map {grid.dimension}; use a map made for it")


def checked_poses(poses: npt.ArrayLike, grid: Grid) -> Array:
    """Poses ``T_map_body`` of a map's dimension, shape (P, 3) or (P, 4, 4).

    Raises
    ------
    MapError
        If they are of another dimension, or not one row each.
    """
    array = np.asarray(poses, np.float64)
    row = (3,) if grid.dimension == 2 else (4, 4)
    if array.shape[1:] != row or array.ndim != len(row) + 1:
        raise MapError(f"poses: shape {array.shape}; this map of {grid.dimension} dimensions wants {('P', *row)}")
    if grid.dimension == 3:
        return se3.as_poses(array)
    if not np.isfinite(array).all():
        raise MapError("poses: holds NaN or infinity; remove those rows")
    return np.ascontiguousarray(array)


@dataclass(frozen=True)
class BodyRays:
    """Rays of one scan in its body frame, in space; those of a planar scan lie in the plane z = 0.

    Parameters
    ----------
    grid : Grid
        Of the map they are for.
    origins, directions : ndarray, shape (N, 3)
    lengths : ndarray, shape (N,)
    status : ndarray of uint8, shape (N,)
    limits : ndarray, shape (2,)
        Minimum and maximum range, m.
    """

    grid: Grid
    origins: Array
    directions: Array
    lengths: Array
    status: npt.NDArray[np.uint8]
    limits: Array

    @classmethod
    def of(cls, scan: Scan, grid: Grid) -> BodyRays:
        """Bring a scan into its body frame.

        Raises
        ------
        MapError
            If scan and map differ in dimension.
        """
        require_dimension(scan, grid)
        rays = pack([scan])
        flat = ((0, 0), (0, 3 - rays.dimension))
        origins, directions = np.pad(rays.origins, flat), np.pad(rays.directions, flat)
        return cls(grid, origins, directions, rays.ranges, rays.status, np.array(scan.range_limits))

    def each(self, kernel: RayKernel, T_map_body: npt.ArrayLike) -> Array:
        """What a kernel says of each ray at one pose, shape (N,)."""
        out = np.empty(len(self.lengths))
        kernel(self._in_space(np.asarray(T_map_body, np.float64)[None])[0], self, out)
        return out

    def sums(self, kernel: RayKernel, poses: npt.ArrayLike) -> Array:
        """Sum over the rays of what a kernel says, at each of many poses, shape (P,); in threads."""
        placed = self._in_space(poses)
        total = np.empty(len(placed))

        def add_up(first: int, last: int) -> None:
            out = np.empty(len(self.lengths))
            for k in range(first, last):
                kernel(placed[k], self, out)
                total[k] = out.sum()

        _jit.in_threads(add_up, len(placed))
        return total

    def _in_space(self, poses: npt.ArrayLike) -> Array:
        array = checked_poses(poses, self.grid)
        return np.ascontiguousarray(se3.from_se2(array) if self.grid.dimension == 2 else array)


RayKernel = Callable[[Array, BodyRays, Array], None]
"""Writes a number for each ray at a pose (4, 4) into an array (N,)."""
