"""Shots and drives of a district: true poses, scans, and odometry with its bounds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchmarks.stored_scans import StoredScans

__all__ = ["DistrictDrive", "Shots"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Shots:
    """Single poses.

    Parameters
    ----------
    T_world_body : ndarray, shape (N, 4, 4)
        True poses, tilt and height included.
    scans : StoredScans
        One a pose.
    """

    T_world_body: Array
    scans: StoredScans

    def __len__(self) -> int:
        return len(self.T_world_body)

    @property
    def poses(self) -> Array:
        """True x, y and heading, (N, 3)."""
        T = self.T_world_body
        return np.column_stack([T[:, 0, 3], T[:, 1, 3], np.arctan2(T[:, 1, 0], T[:, 0, 0])])


@dataclass(frozen=True)
class DistrictDrive(Shots):
    """A drive.

    Parameters
    ----------
    odometry : ndarray, shape (N - 1, 3)
        Measured motions in the body frame at the first of two scans, m and rad.
    odometry_bounds : ndarray, shape (N - 1, 3)
        Their greatest errors, as the settings tell from what was measured.
    """

    odometry: Array
    odometry_bounds: Array
