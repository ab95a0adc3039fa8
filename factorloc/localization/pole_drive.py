"""Pole drive: what a recorded drive sees of poles, as the smoother and the filter take it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.datasets.drive import Drive
from factorloc.errors import DataError
from factorloc.factors.pole_detections import PoleDetections
from factorloc.geometry import se3
from factorloc.mapping.local_maps import local_maps, segments
from factorloc.mapping.pole_settings import PoleSettings
from factorloc.mapping.poles import Poles

__all__ = ["PoleDrive"]

Array = npt.NDArray[np.float64]

_PLANAR = np.array([3, 4, 2])  # x, y and heading in the tangent space [rotation, translation]


@dataclass(frozen=True)
class PoleDrive:
    """A spatial drive, seen from above.

    Parameters
    ----------
    detections : PoleDetections
        Poles of the local maps, each at the pose of its newest scan.
    motions : ndarray, shape (N - 1, 3)
        Odometry.
    covariances : ndarray, shape (N - 1, 3, 3), optional
        Of the motions, where the drive has them.
    known : ndarray of bool, shape (N - 1,)
        Which motions were measured.
    stamps : ndarray, shape (N,)
        Times, s.
    """

    detections: PoleDetections
    motions: Array
    covariances: Array | None
    known: npt.NDArray[np.bool_]
    stamps: Array

    @classmethod
    def of(
        cls, drive: Drive, settings: PoleSettings | None = None, progress: Callable[[int], None] | None = None
    ) -> PoleDrive:
        """Find the poles along a drive, in local maps that odometry holds together.

        Parameters
        ----------
        drive : Drive
            With spatial scans.
        settings : PoleSettings, optional
            Of the local maps.
        progress : callable, optional
            Called with the number of local maps done.

        Raises
        ------
        DataError
            If its scans are planar: the poles in one plane are no poles.
        """
        if drive.dimension != 3:
            raise DataError(f"{drive.name}: planar scans; poles are found in scans of space")
        path = drive.dead_reckoning()
        found: list[Poles] = [Poles.none()] * len(drive)
        for count, one in enumerate(local_maps(drive.scans, path, settings), 1):
            newest = int(one.scans[-1])
            found[newest] = Poles.joined([found[newest], one.poles])
            if progress:
                progress(count)
        covariances = drive.odometry_covariances
        if covariances is not None:
            covariances = covariances[:, _PLANAR[:, None], _PLANAR]
        return cls(
            PoleDetections.of(found), se3.to_se2(drive.odometry), covariances, drive.odometry_known, drive.stamps
        )

    @staticmethod
    def count(drive: Drive, settings: PoleSettings | None = None) -> int:
        """Number of local maps that a drive has."""
        chosen = settings or PoleSettings()
        return len(segments(drive.dead_reckoning(), chosen.segment_length, chosen.segment_spacing))
