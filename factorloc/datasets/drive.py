"""Drive: scans in the order they were taken, the odometry between them, and the truth where there is one."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from factorloc.datasets.report import ReadReport
from factorloc.errors import DataError
from factorloc.geometry import se2
from factorloc.scan import Scan
from factorloc.trajectory import Trajectory

__all__ = ["Drive"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Drive:
    """One recording of a vehicle in the plane.

    Odometry and truth are kept apart: no pose of the truth enters ``odometry``.

    Parameters
    ----------
    name : str
        What it is called.
    scans : tuple of Scan
        N sweeps in recorded order, at least one.
    odometry : ndarray, shape (N - 1, 3)
        Motion of the body ``T_body[k]_body[k + 1]`` from each scan to the next, ``[x, y, theta]`` in m, m, rad; finite
        everywhere, zero where it is not known.
    odometry_known : ndarray of bool, shape (N - 1,), optional
        Where a motion was measured; everywhere by default.
    truth : Trajectory, optional
        Body poses ``T_map_body`` at the scans, of length N.
    stamps : ndarray, shape (N,), optional
        Times of the scans as recorded, s: they may repeat or run backwards, and are never sorted by. Those of the
        scans by default.
    keys : ndarray, shape (N,), optional
        Numbers by which other files refer to the scans (for CARMEN the ipc time); the stamps by default.
    reports : tuple of ReadReport
        Account of each file it was read from.

    Raises
    ------
    DataError
        If there is no scan, lengths disagree or a number is not finite.
    """

    name: str
    scans: tuple[Scan, ...]
    odometry: Array
    odometry_known: npt.NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, np.bool_))
    truth: Trajectory | None = None
    stamps: Array = field(default_factory=lambda: np.zeros(0))
    keys: Array = field(default_factory=lambda: np.zeros(0))
    reports: tuple[ReadReport, ...] = ()

    def __post_init__(self) -> None:
        n = len(self.scans)
        if n == 0:
            raise DataError(f"{self.name}: a drive without scans")
        odometry = np.array(self.odometry, np.float64).reshape(-1, 3)
        known = np.array(self.odometry_known, np.bool_)
        known = np.ones(n - 1, np.bool_) if known.size == 0 else known
        stamps = np.array(self.stamps, np.float64)
        stamps = np.array([scan.stamp for scan in self.scans]) if stamps.size == 0 else stamps
        keys = np.array(self.keys, np.float64)
        keys = stamps.copy() if keys.size == 0 else keys
        arrays = {"odometry": odometry, "odometry_known": known, "stamps": stamps, "keys": keys}
        for name, array in arrays.items():
            expected = n - 1 if name.startswith("odometry") else n
            if len(array) != expected:
                raise DataError(f"{self.name}: {len(array)} rows of {name} for {n} scans; expected {expected}")
            if not np.isfinite(array).all():
                raise DataError(f"{self.name}: {name} holds NaN or infinity")
            object.__setattr__(self, name, array)
        odometry[~known] = 0
        if self.truth is not None and len(self.truth) != n:
            raise DataError(f"{self.name}: {len(self.truth)} poses of truth for {n} scans; one a scan is needed")

    def __len__(self) -> int:
        return len(self.scans)

    def dead_reckoning(self, start: npt.ArrayLike | None = None) -> Trajectory:
        """Chain the odometry from a start pose; unknown motions count as standing still.

        Parameters
        ----------
        start : array_like, shape (3,), optional
            Body pose at the first scan; identity by default.

        Returns
        -------
        Trajectory
            N body poses in the frame of the start pose.
        """
        first = se2.identity() if start is None else se2.as_poses(start, "start")
        headings = first[2] + np.concatenate([[0.0], np.cumsum(self.odometry[:, 2])])
        steps = se2.rotate(headings[:-1], self.odometry[:, :2])
        positions = first[:2] + np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
        world = "odom" if start is None else "map"
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
            A composed motion is known only if every motion in it is.

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
        path = self.dead_reckoning().poses[rows]
        gaps = np.concatenate([[0], np.cumsum(~self.odometry_known)])[rows]
        return replace(
            self,
            scans=tuple(self.scans[row] for row in rows),
            odometry=se2.between(path[:-1], path[1:]),
            odometry_known=np.diff(gaps) == 0,
            truth=None if self.truth is None else self.truth.select(rows),
            stamps=self.stamps[rows],
            keys=self.keys[rows],
        )
