"""Initialization: what is believed of a pose before any scan, as something to draw particles from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from factorloc.errors import GeometryError, MapError
from factorloc.factors.prior import PosePrior
from factorloc.geometry import group_of, position_heading, se3, wrap
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.grid import Grid
from factorloc.mapping.ray_statistics import RayStatistics

__all__ = ["AroundPose", "FreeSpace", "Initialization", "NormalStart"]

Array = npt.NDArray[np.float64]


@runtime_checkable
class Initialization(Protocol):
    """A distribution of poses."""

    @property
    def dimension(self) -> int:
        """2 or 3."""
        ...

    def sample(self, count: int, rng: np.random.Generator) -> Array:
        """Draw independent poses ``T_map_body``, shape (count, 3) or (count, 4, 4)."""
        ...


@dataclass(frozen=True)
class NormalStart:
    """Gaussian around a pose, in the tangent space of its body.

    Parameters
    ----------
    prior : PosePrior
        Pose and covariance.
    """

    prior: PosePrior

    @classmethod
    def from_sigmas(cls, pose: npt.ArrayLike, sigmas: npt.ArrayLike) -> NormalStart:
        """Make it of standard deviations along the axes of the body's tangent space.

        Parameters
        ----------
        pose : array_like, shape (3,) or (4, 4)
            Mean.
        sigmas : array_like, shape (3,) or (6,)
            ``[x, y, heading]`` in the plane, ``[rotation, translation]`` in space; m and rad, all positive.

        Raises
        ------
        GeometryError
            If they are not positive, or do not fit the pose.
        """
        given = np.asarray(sigmas, np.float64)
        return cls(PosePrior(np.asarray(pose, np.float64), np.diag(given**2) if given.ndim == 1 else given))

    @classmethod
    def standing(cls, pose: npt.ArrayLike, position: float, heading: float) -> NormalStart:
        """Make it of one standard deviation of position (m) and one of heading (rad).

        In space height, roll and pitch have a tenth of them: a vehicle stands on its wheels.
        """
        dimension = 3 if np.ndim(pose) == 2 else 2
        sigmas = position_heading(dimension, position, heading)
        if dimension == 3:
            sigmas[[0, 1, 5]] *= 0.1
        return cls.from_sigmas(pose, sigmas)

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return self.prior.dimension

    def sample(self, count: int, rng: np.random.Generator) -> Array:
        """Draw poses; see :class:`Initialization`."""
        group, root = group_of(self.dimension), np.linalg.cholesky(self.prior.covariance)
        return group.compose(self.prior.pose, group.exp(rng.standard_normal((count, len(root))) @ root.T))


@dataclass(frozen=True)
class AroundPose:
    """Uniform over a disc or a box around a pose, headings uniform over a range.

    Parameters
    ----------
    pose : ndarray, shape (3,) or (4, 4)
        In the middle. In space height, roll and pitch stay its own but for the sigmas below.
    reach : float or (float, float)
        Radius of the disc, or half the lengths of the box along the axes of the map, m.
    heading : float
        Headings differ from the pose's by at most this, rad; pi is any heading.
    height_sigma, tilt_sigma : float
        In space, standard deviations of height (m), and of roll and pitch (rad).

    Raises
    ------
    GeometryError
        If the pose is not one finite pose, or a length or angle is negative or not finite.
    """

    pose: Array
    reach: float | tuple[float, float]
    heading: float = np.pi
    height_sigma: float = 0.0
    tilt_sigma: float = 0.0

    def __post_init__(self) -> None:
        pose = group_of(self.dimension).as_poses(self.pose, "pose")
        sizes = np.array([*np.atleast_1d(self.reach), self.heading, self.height_sigma, self.tilt_sigma])
        if pose.shape not in ((3,), (4, 4)) or np.size(self.reach) > 2:
            raise GeometryError(f"pose of shape {pose.shape} and reach {self.reach}; a pose, and one or two lengths")
        if not (np.isfinite(sizes).all() and (sizes >= 0).all()):
            raise GeometryError("reach, heading or sigma: negative or not finite")
        object.__setattr__(self, "pose", pose)

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return 3 if np.ndim(self.pose) == 2 else 2

    def sample(self, count: int, rng: np.random.Generator) -> Array:
        """Draw poses; see :class:`Initialization`."""
        if np.ndim(self.reach) == 0:
            radius, angle = np.sqrt(rng.random(count)), rng.uniform(-np.pi, np.pi, count)
            offsets = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        else:
            offsets = rng.uniform(-1, 1, (count, 2))
        offsets = offsets * self.reach
        turns = rng.uniform(-self.heading, self.heading, count)
        if self.dimension == 2:
            return np.column_stack([self.pose[:2] + offsets, wrap(self.pose[2] + turns)])
        # Turned about the vertical of the map where it stands, then moved.
        around = se3.from_se2(np.column_stack([np.zeros((count, 2)), turns]))
        poses = np.repeat(self.pose[None], count, 0)
        poses[:, :3, :3] = around[:, :3, :3] @ self.pose[:3, :3]
        poses[:, :2, 3] += offsets
        return _swayed(poses, self.height_sigma, self.tilt_sigma, rng)


@dataclass(frozen=True)
class FreeSpace:
    """Uniform over the free cells of a map seen from above, at any heading.

    Parameters
    ----------
    grid : Grid
        The map's.
    cells : ndarray of int64, shape (C, 2)
        Free cells, or columns of cells in space.
    height : float
        In space, height of the body, m.
    height_sigma, tilt_sigma : float
        In space, standard deviations of height (m), and of roll and pitch (rad).

    Raises
    ------
    MapError
        If nothing is free.
    """

    grid: Grid
    cells: npt.NDArray[np.int64]
    height: float = 0.0
    height_sigma: float = 0.0
    tilt_sigma: float = 0.0

    def __post_init__(self) -> None:
        if len(self.cells) == 0:
            raise MapError("map: no cell that rays crossed without being reflected; there is nowhere to start in it")

    @classmethod
    def of(
        cls,
        statistics: RayStatistics | BrickStatistics,
        *,
        height: float = 0.0,
        body: tuple[float, float] = (0.5, 1.5),
        height_sigma: float = 0.1,
        tilt_sigma: float = 0.02,
    ) -> FreeSpace:
        """Find the cells that were crossed by rays and reflected none.

        Parameters
        ----------
        statistics : RayStatistics or BrickStatistics
            The map.
        height : float
            In space, height of the body's origin above that of the map, m.
        body : (float, float)
            In space, what of a column must be free, from and to above the height, m: where a vehicle has its body, and
            not the ground it stands on.
        height_sigma, tilt_sigma : float
            In space, standard deviations of height (m), and of roll and pitch (rad).

        Raises
        ------
        MapError
            If nothing is free.
        """
        grid = statistics.grid
        if grid.dimension == 2:
            assert isinstance(statistics, RayStatistics)  # bricks are for space
            return cls(grid, np.argwhere((statistics.hits == 0) & (statistics.misses > 0)))
        bricks = statistics if isinstance(statistics, BrickStatistics) else BrickStatistics.from_dense(statistics)
        index = bricks.layout.cells(bricks.keys)
        level = grid.origin[2] + (index[:, 2] + 0.5) * grid.resolution - height
        within = (level >= body[0]) & (level <= body[1])
        columns = np.ravel_multi_index((index[:, 0], index[:, 1]), grid.shape[:2])
        n = grid.shape[0] * grid.shape[1]
        crossed = np.bincount(columns[within], minlength=n) > 0
        reflecting = np.bincount(columns[within & (bricks.hits > 0)], minlength=n) > 0
        free = np.argwhere((crossed & ~reflecting).reshape(grid.shape[:2]))
        return cls(grid, free, height, height_sigma, tilt_sigma)

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return self.grid.dimension

    def sample(self, count: int, rng: np.random.Generator) -> Array:
        """Draw poses; see :class:`Initialization`."""
        chosen = self.cells[rng.integers(len(self.cells), size=count)]
        position = np.array(self.grid.origin[:2]) + (chosen + rng.random((count, 2))) * self.grid.resolution
        planar = np.column_stack([position, rng.uniform(-np.pi, np.pi, count)])
        if self.dimension == 2:
            return planar
        poses = se3.from_se2(planar)
        poses[:, 2, 3] = self.height
        return _swayed(poses, self.height_sigma, self.tilt_sigma, rng)


def _swayed(poses: Array, height_sigma: float, tilt_sigma: float, rng: np.random.Generator) -> Array:
    """Disturb height, roll and pitch of poses (N, 4, 4)."""
    tangent = np.zeros((len(poses), 6))
    tangent[:, :2] = rng.standard_normal((len(poses), 2)) * tilt_sigma
    swayed = se3.compose(poses, se3.exp(tangent))
    swayed[:, 2, 3] += rng.standard_normal(len(poses)) * height_sigma
    return swayed
