"""Reflection window: hits and misses in a dense box of cells around a place, made anew for every local map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc import _jit
from factorloc.errors import MapError
from factorloc.geometry import se3
from factorloc.mapping._window_kernels import count_in_window
from factorloc.mapping.grid import Grid, require_memory
from factorloc.scan import Scan

__all__ = ["ReflectionWindow", "spatial_poses"]

Array = npt.NDArray[np.float64]
Counts = npt.NDArray[np.uint32]


@dataclass(frozen=True, eq=False)
class ReflectionWindow:
    """Hits and misses of the cells of a small spatial grid.

    What :class:`~factorloc.mapping.ray_statistics.RayStatistics` holds besides, path lengths, is left out: a reflection
    map needs none, and counting alone takes half the time.

    Parameters
    ----------
    grid : Grid
        Where the cells lie; three axes.
    rimmed_hits, rimmed_misses : ndarray of uint32, shape (n_z + 2, n_x + 2, n_y + 2)
        Counts, slice by slice, with a rim of one cell that holds nothing of meaning.
    """

    grid: Grid
    rimmed_hits: Counts
    rimmed_misses: Counts

    @classmethod
    def from_scans(cls, scans: Sequence[Scan], poses: npt.ArrayLike, grid: Grid) -> ReflectionWindow:
        """Count the rays of scans; those below the minimum range are left out, what lies outside is cut off.

        Parameters
        ----------
        scans : sequence of Scan
            Spatial scans.
        poses : array_like, shape (S, 4, 4) or (S, 3)
            Pose of the body in the frame of the grid at each scan.
        grid : Grid
            The window.

        Raises
        ------
        MapError
            If poses, scans and grid do not fit, or the window does not fit into memory.
        """
        if grid.dimension != 3:
            raise MapError("window: a planar grid; poles are found in space")
        bodies = spatial_poses(scans, poses)
        n_x, n_y, n_z = grid.shape
        shape, threads = (n_z + 2, n_x + 2, n_y + 2), _jit.threads()
        require_memory(8 * threads * int(np.prod(shape)), f"a window of {n_x} x {n_y} x {n_z} cells")
        hits, misses = np.zeros((threads, *shape), np.uint32), np.zeros((threads, *shape), np.uint32)
        sensors = [se3.compose(body, scan.T_body_sensor) for body, scan in zip(bodies, scans, strict=True)]
        for sensor in sensors:
            sensor[:3, 3] -= grid.origin

        def count(first: int, last: int) -> None:
            for part in range(first, last):
                for scan, sensor in zip(scans, sensors, strict=True):
                    n = len(scan)
                    count_in_window(
                        scan.origins, scan.directions, scan.ranges, scan.status, sensor, grid.resolution, grid.shape,
                        n * part // threads, n * (part + 1) // threads, hits[part].ravel(), misses[part].ravel(),
                    )  # fmt: skip

        _jit.in_threads(count, threads)
        # Whole numbers: how many threads there were leaves no trace.
        for part in range(1, threads):
            hits[0] += hits[part]
            misses[0] += misses[part]
        return cls(grid, hits[0], misses[0])

    @property
    def hits(self) -> Counts:
        """Hits of the cells, shape of the grid (x, y, z)."""
        return np.moveaxis(self.rimmed_hits[1:-1, 1:-1, 1:-1], 0, 2)

    @property
    def misses(self) -> Counts:
        """Misses of the cells, shape of the grid (x, y, z)."""
        return np.moveaxis(self.rimmed_misses[1:-1, 1:-1, 1:-1], 0, 2)


def spatial_poses(scans: Sequence[Scan], poses: npt.ArrayLike) -> Array:
    """Poses of spatial scans in space; planar ones are laid into z = 0.

    Raises
    ------
    MapError
        If a scan is planar, or there is not one pose a scan.
    """
    if any(scan.dimension != 3 for scan in scans):
        raise MapError("scans: planar ones; poles are found in scans in space")
    array = np.asarray(poses, np.float64)
    if array.shape == (len(scans), 3):
        array = se3.from_se2(array)
    if array.shape != (len(scans), 4, 4):
        raise MapError(f"poses: shape {array.shape}; expected one pose for each of the {len(scans)} scans")
    return se3.as_poses(array) if len(scans) else array
