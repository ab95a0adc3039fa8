"""Beam models: what sensor models that follow every ray through the cells of a grid have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from factorloc import _jit
from factorloc.mapping.body_rays import checked_poses, require_dimension
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.cell_layout import CellLayout
from factorloc.mapping.cell_table import CellTable
from factorloc.mapping.grid import Grid
from factorloc.mapping.ray_statistics import RayStatistics
from factorloc.rays import pack
from factorloc.scan import Scan

__all__ = ["BeamModel", "rimmed"]

Array = npt.NDArray[np.float64]

_PARALLEL_CELLS = 300_000  # about a millisecond of walking; less is done before threads are woken
_CELLS_A_RAY = 10  # what a ray costs besides its walk, in cells
_SIDE_BY_SIDE = 256  # poses close together that a ray is walked at in turn: it stays in the cells that are at hand
_REACH, _CLOSE = 10.0, 5.0  # m; poses are close together if the ends of a ray so long lie within so much
_STRIPE = 2.0  # m; others are weighed in turns through squares so wide: most of what a pose looks at is at hand then
_MOST_IN_FULL = 256 * 2**20  # bytes of a sparse map's cells up to which they are laid out in full


def rimmed(values: npt.ArrayLike, rim: float) -> Array:
    """Surround an array by one cell of a constant, as kernels want their grids; contiguous float64."""
    return np.pad(np.asarray(values, np.float64), 1, constant_values=rim)


@dataclass(frozen=True)
class BeamModel(ABC):
    """Likelihood of lidar rays by what lies along their way; satisfies :class:`~factorloc.mapping.SensorModel`.

    A model is laid out for its kernels when it is first asked; from then on a call costs its walks. A sparse map of up
    to 64 million cells (256 MiB) is laid out in full for that; a larger one stays in bricks, which are slower to read.
    Where all poses are close together, every ray is walked at many of them before the next, its cells being at hand;
    where they are not, neighbours are weighed one after the other, whatever their order.

    Parameters
    ----------
    statistics : RayStatistics or BrickStatistics
        What the mapping rays left behind.
    """

    statistics: RayStatistics | BrickStatistics

    @property
    def grid(self) -> Grid:
        """Where the cells lie."""
        return self.statistics.grid

    @property
    def normalized(self) -> bool:
        """The outcomes of every ray add up to one."""
        return True

    def log_likelihood(self, scan: Scan, T_map_body: npt.ArrayLike) -> Array:
        """Log-likelihood of each ray of a scan at one pose.

        Parameters
        ----------
        scan : Scan
            Of the map's dimension.
        T_map_body : array_like, shape (3,) or (4, 4)
            Pose of the body.

        Returns
        -------
        ndarray, shape (N,)
            Log densities (1/m) of returns, log probabilities of rays out of range; -inf where the model excludes them.

        Raises
        ------
        MapError
            If scan, pose and map differ in dimension.
        """
        require_dimension(scan, self.grid)
        pose = checked_poses(np.asarray(T_map_body, np.float64)[None], self.grid)
        rays = pack([scan])
        each = np.empty((1, len(scan)))

        def weigh(first: int, last: int) -> None:
            part = slice(first, last)
            block = (rays.origins[part], rays.directions[part], rays.ranges[part], rays.status[part])
            self._kernel(_placed(pose), 1, *block, each[:, part], np.empty(1))

        self._deal(weigh, len(scan), self._cells(scan))
        return each.ravel()

    def scan_log_likelihoods(self, scan: Scan, poses: npt.ArrayLike) -> Array:
        """Log-likelihood of a scan at each of many poses: the sum over its rays, as a particle filter weighs them.

        Parameters
        ----------
        scan : Scan
            Of the map's dimension.
        poses : array_like, shape (P, 3) or (P, 4, 4)
            Poses ``T_map_body``.

        Returns
        -------
        ndarray, shape (P,)
            Sums of :meth:`log_likelihood`; -inf where the model excludes any of the rays.

        Raises
        ------
        MapError
            If scan, poses and map differ in dimension.
        """
        require_dimension(scan, self.grid)
        array = checked_poses(poses, self.grid)
        rays = pack([scan])
        block = (rays.origins, rays.directions, rays.ranges, rays.status, np.empty((0, len(scan))))
        close = _are_close(array)
        order = np.arange(len(array)) if close else _through_the_map(array)
        placed, group = _placed(array[order]), _SIDE_BY_SIDE if close else 1
        sums = np.empty(len(array))

        def weigh(first: int, last: int) -> None:
            self._kernel(placed[first:last], group, *block, sums[first:last])

        self._deal(weigh, len(array), self._cells(scan) * len(array))
        in_place = np.empty_like(sums)
        in_place[order] = sums
        return in_place

    @abstractmethod
    def _bound_kernel(self) -> tuple[Any, ...]:
        """The kernel and its leading arguments, the map."""

    @cached_property
    def _kernel(self) -> Callable[..., None]:
        kernel, *tables = self._bound_kernel()
        low, resolution = np.array(self.grid.origin), self.grid.resolution

        def weigh(*rays: Any) -> None:
            kernel(*tables, low, resolution, *rays)

        return weigh

    def _laid_out(self, values: Array, outside: float) -> CellLayout:
        """One number of each cell of a spatial map, as kernels read them."""
        if isinstance(self.statistics, BrickStatistics):
            if self.grid.cells * 4 <= _MOST_IN_FULL:
                return CellLayout.in_full(self.statistics, values, outside)
            return CellLayout.bricks(CellTable.from_cells(self.statistics, values, outside))
        return CellLayout.dense(self.grid, values, outside)

    def _cells(self, scan: Scan) -> float:
        """About how many cells the rays of a scan cross, with what they cost besides."""
        return float(scan.ranges.sum()) / self.grid.resolution + _CELLS_A_RAY * len(scan)

    @staticmethod
    def _deal(weigh: Callable[[int, int], None], count: int, cells: float) -> None:
        if cells > _PARALLEL_CELLS:
            _jit.in_threads(weigh, count)
        else:
            weigh(0, count)


def _placed(poses: Array) -> Array:
    """Poses as kernels take them: in the plane x, y, and cosine and sine of the heading, shape (P, 4)."""
    if poses.ndim == 3:
        return poses
    return np.column_stack([poses[:, :2], np.cos(poses[:, 2]), np.sin(poses[:, 2])])


def _through_the_map(poses: Array) -> npt.NDArray[np.int64]:
    """Order in which poses follow a way up and down through stripes of the map."""
    positions = poses[:, :2] if poses.ndim == 2 else poses[:, :2, 3]
    x, y = np.floor(positions / _STRIPE).T
    return np.lexsort((np.where(x % 2 == 0, y, -y), x))


def _are_close(poses: Array) -> bool:
    """Whether a ray runs through much the same cells at all of some poses, by the deviation of its end."""
    if len(poses) < 2:
        return False
    if poses.ndim == 2:
        position, axes = poses[:, :2], np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], -1)
    else:
        position, axes = poses[:, :3, 3], poses[:, :3, :2].reshape(-1, 6)
    return bool(np.sqrt(position.var(0).sum() + _REACH**2 * axes.var(0).sum()) <= _CLOSE)
