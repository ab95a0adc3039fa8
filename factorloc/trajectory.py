"""Trajectory: stamped poses of the body in the world, and the two file formats everybody reads."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from factorloc.errors import DataError, GeometryError
from factorloc.files import open_text, write_text
from factorloc.geometry import se2, se3

__all__ = ["Trajectory"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Trajectory:
    """Poses ``T_world_body`` over time.

    Parameters
    ----------
    stamps : ndarray, shape (N,)
        Times, s. Rows keep the order they are given in; only interpolation needs increasing times.
    poses : ndarray, shape (N, 3) or (N, 4, 4)
        Planar rows ``[x, y, theta]`` or homogeneous matrices.
    covariances : ndarray, shape (N, 3, 3) or (N, 6, 6), optional
        Covariance of each pose in the tangent space of the body (order of :mod:`factorloc.geometry`).
    world, body : str
        Names of the frames.

    Raises
    ------
    GeometryError
        If shapes disagree or a value is not finite.
    """

    stamps: Array
    poses: Array
    covariances: Array | None = None
    world: str = "map"
    body: str = "body"
    dimension: int = field(init=False)

    def __post_init__(self) -> None:
        stamps, poses = np.asarray(self.stamps, np.float64), np.asarray(self.poses, np.float64)
        if poses.ndim not in (2, 3):
            raise GeometryError(f"poses: shape {poses.shape}; expected (poses, 3) or (poses, 4, 4)")
        planar = poses.ndim == 2
        poses = se2.as_poses(poses.reshape(-1, 3) if poses.size == 0 else poses) if planar else se3.as_poses(poses)
        if stamps.shape != (len(poses),):
            raise GeometryError(f"stamps: shape {stamps.shape} does not fit {len(poses)} poses")
        if not np.isfinite(stamps).all():
            raise GeometryError("stamps: not finite")
        if self.covariances is not None:
            freedom = 3 if planar else 6
            covariances = np.asarray(self.covariances, np.float64)
            if covariances.shape != (len(poses), freedom, freedom):
                expected = (len(poses), freedom, freedom)
                raise GeometryError(f"covariances: shape {covariances.shape}; expected {expected}")
            if not np.isfinite(covariances).all():
                raise GeometryError("covariances: hold NaN or infinity; leave them out where unknown")
            object.__setattr__(self, "covariances", covariances)
        object.__setattr__(self, "stamps", stamps)
        object.__setattr__(self, "poses", poses)
        object.__setattr__(self, "dimension", 2 if planar else 3)

    def __len__(self) -> int:
        return len(self.stamps)

    @property
    def positions(self) -> Array:
        """Positions of the body in the world, m, shape (N, D)."""
        return self.poses[:, :2] if self.dimension == 2 else self.poses[:, :3, 3]

    @property
    def headings(self) -> Array:
        """Yaw angles, rad, shape (N,)."""
        return self.poses[:, 2] if self.dimension == 2 else se3.to_se2(self.poses)[:, 2]

    @property
    def length(self) -> float:
        """Length of the driven path, m."""
        return float(np.linalg.norm(np.diff(self.positions, axis=0), axis=1).sum())

    def select(self, keep: npt.ArrayLike | slice) -> Trajectory:
        """Return the trajectory of some of its rows (mask, indices or slice)."""
        rows = keep if isinstance(keep, slice) else np.asarray(keep)
        covariances = None if self.covariances is None else self.covariances[rows]
        return replace(self, stamps=self.stamps[rows], poses=self.poses[rows], covariances=covariances)

    def at(self, stamps: npt.ArrayLike) -> Trajectory:
        """Interpolate on the geodesics between neighbouring poses.

        Parameters
        ----------
        stamps : array_like, shape (M,)
            Wanted times, s.

        Returns
        -------
        Trajectory
            Without covariances.

        Raises
        ------
        GeometryError
            If own times do not increase or a wanted time lies outside.
        """
        wanted = np.atleast_1d(np.asarray(stamps, np.float64))
        if len(self) < 2 or (np.diff(self.stamps) <= 0).any():
            raise GeometryError("trajectory: interpolation needs at least two poses with increasing stamps")
        if not ((wanted >= self.stamps[0]) & (wanted <= self.stamps[-1])).all():
            raise GeometryError(
                f"stamps: {wanted.min():.6f} to {wanted.max():.6f} s reach beyond the trajectory "
                f"({self.stamps[0]:.6f} to {self.stamps[-1]:.6f} s)"
            )
        right = np.clip(np.searchsorted(self.stamps, wanted), 1, len(self) - 1)
        left = right - 1
        fraction = (wanted - self.stamps[left]) / (self.stamps[right] - self.stamps[left])
        group = se2 if self.dimension == 2 else se3
        poses = group.interpolate(self.poses[left], self.poses[right], fraction)
        return replace(self, stamps=wanted, poses=poses, covariances=None)

    def to_3d(self) -> Trajectory:
        """Return the same trajectory in SE(3); a planar one is laid into z = 0, without its covariances."""
        if self.dimension == 3:
            return self
        return Trajectory(self.stamps, se3.from_se2(self.poses), world=self.world, body=self.body)

    def to_2d(self) -> Trajectory:
        """Return its projection onto the plane, without covariances."""
        if self.dimension == 2:
            return self
        return Trajectory(self.stamps, se3.to_se2(self.poses), world=self.world, body=self.body)

    def write_tum(self, path: Path | str) -> None:
        """Write ``stamp x y z q_x q_y q_z q_w`` rows (TUM RGB-D format)."""
        poses = self.to_3d().poses
        rows = np.column_stack([self.stamps, poses[:, :3, 3], se3.quaternion(poses)])
        body = "".join(f"{row[0]:.6f} " + " ".join(f"{v:.9f}" for v in row[1:]) + "\n" for row in rows)
        write_text(path, "# stamp x y z q_x q_y q_z q_w\n" + body)

    def write_kitti(self, path: Path | str) -> None:
        """Write the upper 3 x 4 of each pose as one row (KITTI odometry format; times are not kept)."""
        rows = self.to_3d().poses[:, :3, :].reshape(-1, 12)
        write_text(path, "".join(" ".join(f"{v:.9e}" for v in row) + "\n" for row in rows))

    @classmethod
    def read_tum(cls, path: Path | str, *, planar: bool = False, world: str = "map", body: str = "body") -> Trajectory:
        """Read a TUM file.

        Parameters
        ----------
        path : Path or str
            Rows ``stamp x y z q_x q_y q_z q_w``; ``#`` begins a comment. May be compressed.
        planar : bool
            Project the poses onto the plane.
        world, body : str
            Names of the frames.

        Raises
        ------
        DataError
            If the file is missing, empty, or a row has not 8 finite numbers.
        """
        table = _read_table(path, 8, "stamp x y z q_x q_y q_z q_w")
        try:
            poses = se3.from_quaternion(table[:, 1:4], table[:, 4:])
        except GeometryError as error:
            raise DataError(f"{path}: {error}") from error
        trajectory = cls(table[:, 0], poses, world=world, body=body)
        return trajectory.to_2d() if planar else trajectory

    @classmethod
    def read_kitti(
        cls,
        path: Path | str,
        stamps: npt.ArrayLike | None = None,
        *,
        planar: bool = False,
        world: str = "map",
        body: str = "body",
    ) -> Trajectory:
        """Read a KITTI odometry pose file.

        Parameters
        ----------
        path : Path or str
            Rows of 12 numbers, the upper 3 x 4 of each pose. May be compressed.
        stamps : array_like, optional
            Times; the row number by default.
        planar : bool
            Project the poses onto the plane.
        world, body : str
            Names of the frames.

        Raises
        ------
        DataError
            If the file is missing, empty, a row has not 12 finite numbers or is no rigid motion.
        """
        table = _read_table(path, 12, "the upper 3 x 4 of a pose")
        poses = se3.identity((len(table),))
        poses[:, :3, :] = table.reshape(-1, 3, 4)
        # Files carry 6 to 9 digits; project onto the nearest rotation before the rigidity check.
        u, _, vt = np.linalg.svd(poses[:, :3, :3])
        nearest = u @ vt
        if np.abs(nearest - poses[:, :3, :3]).max() > 1e-3 or (np.linalg.det(nearest) < 0).any():
            raise DataError(f"{path}: a row is not a rigid motion; is it a KITTI pose file?")
        poses[:, :3, :3] = nearest
        times = np.arange(len(table), dtype=np.float64) if stamps is None else np.asarray(stamps, np.float64)
        trajectory = cls(times, poses, world=world, body=body)
        return trajectory.to_2d() if planar else trajectory


def _read_table(path: Path | str, columns: int, meaning: str) -> Array:
    rows: list[list[float]] = []
    for number, line in open_text(path):
        text = line.split("#", 1)[0].replace(",", " ").strip()
        if not text:
            continue
        try:
            row = [float(word) for word in text.split()]
        except ValueError:
            row = []
        if len(row) != columns or not np.isfinite(row).all():
            raise DataError(f"{path}: line {number} has not {columns} finite numbers ({meaning})")
        rows.append(row)
    if not rows:
        raise DataError(f"{path}: holds no poses")
    return np.array(rows)
