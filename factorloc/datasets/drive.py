"""Drive: scans in the order they were taken, the odometry between them, and the truth where there is one."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from factorloc.datasets.report import ReadReport
from factorloc.errors import DataError, GeometryError
from factorloc.geometry import se2, se3
from factorloc.scan import Scan
from factorloc.trajectory import Trajectory

__all__ = ["Drive"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Drive:
    """One recording of a vehicle, in the plane or in space: its scans tell which.

    Odometry and truth are kept apart: no pose of the truth enters ``odometry``.

    Parameters
    ----------
    name : str
        What it is called.
    scans : tuple of Scan
        N sweeps in recorded order, at least one, all of the same dimension.
    odometry : ndarray, shape (N - 1, 3) or (N - 1, 4, 4)
        Motion of the body ``T_body[k]_body[k + 1]`` from each scan to the next; ``[x, y, theta]`` in m, m, rad in the
        plane, homogeneous matrices in space. Finite everywhere, and no motion at all where it is not known.
    odometry_known : ndarray of bool, shape (N - 1,), optional
        Where a motion was measured; everywhere by default.
    truth : Trajectory, optional
        Body poses ``T_map_body`` at the scans, of length N and the dimension of the scans.
    stamps : ndarray, shape (N,), optional
        Times of the scans as recorded, s: they may repeat or run backwards, and are never sorted by. Those of the
        scans by default.
    keys : ndarray, shape (N,), optional
        Numbers by which other files refer to the scans (for CARMEN the ipc time, for KITTI the frame number); the
        stamps by default.
    reports : tuple of ReadReport
        Account of each file it was read from.
    odometry_covariances : ndarray, shape (N - 1, 3, 3) or (N - 1, 6, 6), optional
        Covariances of the motions in the tangent space of the body *after* each motion (order of
        :mod:`factorloc.geometry`); zero where the motion is not known.

    Raises
    ------
    DataError
        If there is no scan, lengths or dimensions disagree, a number is not finite, a motion is not rigid, or the
        covariance of a known motion is not positive definite.
    """

    name: str
    scans: tuple[Scan, ...]
    odometry: Array
    odometry_known: npt.NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, np.bool_))
    truth: Trajectory | None = None
    stamps: Array = field(default_factory=lambda: np.zeros(0))
    keys: Array = field(default_factory=lambda: np.zeros(0))
    reports: tuple[ReadReport, ...] = ()
    odometry_covariances: Array | None = None

    def __post_init__(self) -> None:
        n = len(self.scans)
        if n == 0:
            raise DataError(f"{self.name}: a drive without scans")
        if len({scan.dimension for scan in self.scans}) > 1:
            raise DataError(f"{self.name}: planar and spatial scans cannot share a drive; read them apart")
        known = np.array(self.odometry_known, np.bool_)
        known = np.ones(n - 1, np.bool_) if known.size == 0 else known
        stamps = np.array(self.stamps, np.float64)
        stamps = np.array([scan.stamp for scan in self.scans]) if stamps.size == 0 else stamps
        keys = np.array(self.keys, np.float64)
        keys = stamps.copy() if keys.size == 0 else keys
        arrays = {"odometry": self._rows("odometry", self.odometry), "odometry_known": known}
        arrays |= {"stamps": stamps, "keys": keys}
        if self.odometry_covariances is not None:
            arrays["odometry_covariances"] = self._rows("odometry_covariances", self.odometry_covariances)
        for name, array in arrays.items():
            expected = n - 1 if name.startswith("odometry") else n
            if len(array) != expected:
                raise DataError(f"{self.name}: {len(array)} rows of {name} for {n} scans; expected {expected}")
            if not np.isfinite(array).all():
                raise DataError(f"{self.name}: {name} holds NaN or infinity")
            object.__setattr__(self, name, array)
        self._settle(known)
        if self.truth is not None and len(self.truth) != n:
            raise DataError(f"{self.name}: {len(self.truth)} poses of truth for {n} scans; one a scan is needed")
        if self.truth is not None and self.truth.dimension != self.dimension:
            raise DataError(f"{self.name}: truth and scans differ in dimension; see Trajectory.to_2d and to_3d")

    def _rows(self, name: str, values: Array) -> Array:
        """Take motions or covariances, of the shape that suits the scans."""
        freedom = 3 * (self.dimension - 1)
        pose = (3,) if self.dimension == 2 else (4, 4)
        row = pose if name == "odometry" else (freedom, freedom)
        array = np.array(values, np.float64)
        if array.size == 0:
            return array.reshape(0, *row)
        if array.shape[1:] != row:
            expected = f"({len(self.scans) - 1}, {', '.join(map(str, row))})"
            raise DataError(f"{self.name}: shape {array.shape} of {name}; expected {expected}")
        return array

    def _settle(self, known: npt.NDArray[np.bool_]) -> None:
        """Let nothing stand where a motion is not known, and only what is possible where it is."""
        self.odometry[~known] = 0 if self.dimension == 2 else np.eye(4)
        if self.dimension == 3:
            try:
                motions = se3.as_poses(self.odometry, "odometry")
            except GeometryError as error:
                raise DataError(f"{self.name}: {error}") from error
            # Long chains amplify the last digits of rotations.
            exact = se3.from_quaternion(motions[:, :3, 3], se3.quaternion(motions))
            object.__setattr__(self, "odometry", exact)
        if self.odometry_covariances is None:
            return
        self.odometry_covariances[~known] = 0
        told = self.odometry_covariances[known]
        variances = np.einsum("nii->ni", told)
        # Correlations do not depend on units, in which variances may lie many powers of ten apart.
        deviations = np.sqrt(np.where(variances > 0, variances, 1.0))
        correlations = told / (deviations[:, :, None] * deviations[:, None, :])
        even = np.allclose(correlations, np.swapaxes(correlations, -1, -2), rtol=0, atol=1e-6)
        if not even or (variances <= 0).any() or (np.linalg.eigvalsh(correlations) <= 0).any():
            raise DataError(f"{self.name}: odometry_covariances: one is not symmetric and positive definite")

    def __len__(self) -> int:
        return len(self.scans)

    @property
    def dimension(self) -> int:
        """2 for a drive in the plane, 3 for one in space."""
        return self.scans[0].dimension

    def dead_reckoning(self, start: npt.ArrayLike | None = None) -> Trajectory:
        """Chain the odometry from a start pose; unknown motions count as standing still.

        Parameters
        ----------
        start : array_like, shape (3,) or (4, 4), optional
            Body pose at the first scan; identity by default.

        Returns
        -------
        Trajectory
            N body poses in the frame of the start pose.
        """
        world = "odom" if start is None else "map"
        if self.dimension == 3:
            chain = [se3.identity() if start is None else se3.as_poses(start, "start")]
            for motion in self.odometry:
                chain.append(se3.compose(chain[-1], motion))
            return Trajectory(self.stamps, np.array(chain), world=world)
        first = se2.identity() if start is None else se2.as_poses(start, "start")
        headings = first[2] + np.concatenate([[0.0], np.cumsum(self.odometry[:, 2])])
        steps = se2.rotate(headings[:-1], self.odometry[:, :2])
        positions = first[:2] + np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
        return Trajectory(self.stamps, np.column_stack([positions, headings]), world=world)

    def select(self, indices: npt.ArrayLike | slice) -> Drive:
        """Return the drive of some of its scans, in their order; odometry is composed across those left out.

        Parameters
        ----------
        indices : array_like or slice
            Rows as increasing indices, a mask or a slice; negative indices count from the end.

        Returns
        -------
        Drive
            A composed motion is known only if every motion in it is. Its covariance, to first order, is the sum of
            theirs, each carried by the adjoint to the body after the last of them.

        Raises
        ------
        DataError
            If no scan is left, one does not exist, or they are not in increasing order.
        """
        try:
            rows = np.arange(len(self))[indices if isinstance(indices, slice) else np.asarray(indices)]
        except IndexError as error:
            raise DataError(f"{self.name}: cannot select from {len(self)} scans ({error})") from error
        if rows.ndim != 1 or rows.size == 0 or (np.diff(rows) <= 0).any():
            raise DataError(f"{self.name}: select at least one scan, by indices that increase; got {rows.tolist()[:6]}")
        group = se2 if self.dimension == 2 else se3
        path = self.dead_reckoning().poses
        gaps = np.concatenate([[0], np.cumsum(~self.odometry_known)])[rows]
        return replace(
            self,
            scans=tuple(self.scans[row] for row in rows),
            odometry=group.between(path[rows[:-1]], path[rows[1:]]),
            odometry_known=np.diff(gaps) == 0,
            truth=None if self.truth is None else self.truth.select(rows),
            stamps=self.stamps[rows],
            keys=self.keys[rows],
            odometry_covariances=self._composed_covariances(path, rows),
        )

    def _composed_covariances(self, path: Array, rows: npt.NDArray[np.int64]) -> Array | None:
        """Covariances of the motions between some of the poses of a path, each the sum of those it is made of."""
        if self.odometry_covariances is None or len(rows) < 2:
            return None if self.odometry_covariances is None else self.odometry_covariances[:0]
        group = se2 if self.dimension == 2 else se3
        within = np.arange(rows[0], rows[-1])
        ends = np.repeat(rows[1:], np.diff(rows))
        carry = group.adjoint(group.between(path[ends], path[within + 1]))
        parts = carry @ self.odometry_covariances[within] @ np.swapaxes(carry, -1, -2)
        whole = np.add.reduceat(parts, rows[:-1] - rows[0])
        return np.asarray((whole + np.swapaxes(whole, -1, -2)) / 2)
