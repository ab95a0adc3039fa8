"""Lidar odometry: the motion of the body between scans, by registering each scan with those before it.

Each scan is thinned to one point per voxel, its points get the covariances of their neighbourhoods, and distributions
are matched with those of a voxel map of the latest scans (voxelized generalized ICP: Koide et al., "Voxelized GICP for
fast and accurate 3D point cloud registration", ICRA 2021; Segal et al., "Generalized-ICP", RSS 2009), beginning where a
constant velocity leads. Points are taken as measured at one instant: sweeps that need it are to be compensated for the
motion during the sweep before.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from factorloc.datasets.drive import Drive
from factorloc.errors import FactorlocWarning, GeometryError
from factorloc.geometry import se3
from factorloc.localization.local_map import LidarOdometrySettings, LocalMap, thin
from factorloc.scan import Scan

__all__ = ["LidarOdometry", "LidarOdometrySettings", "lidar_odometry", "with_lidar_odometry"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class LidarOdometry:
    """Motions of the body between N scans.

    Parameters
    ----------
    motions : ndarray, shape (N - 1, 4, 4)
        ``T_body[k]_body[k + 1]``; identity where not known.
    covariances : ndarray, shape (N - 1, 6, 6)
        Their covariances in the tangent space ``[omega, v]`` of the body *after* each motion; zero where not known.
    known : ndarray of bool, shape (N - 1,)
        Where the registration succeeded.
    inliers : ndarray, shape (N - 1,)
        Fraction of the points of scan k + 1 that found a voxel of the map.
    residuals : ndarray, shape (N - 1,)
        Mean square of the whitened residuals; below 1 if points fit better than their neighbourhoods are thick.
    """

    motions: Array
    covariances: Array
    known: npt.NDArray[np.bool_]
    inliers: Array
    residuals: Array

    @property
    def failed(self) -> int:
        """How many motions are not known."""
        return int((~self.known).sum())


def lidar_odometry(
    scans: Sequence[Scan],
    settings: LidarOdometrySettings | None = None,
    progress: Callable[[int], None] | None = None,
) -> LidarOdometry:
    """Estimate the motions between spatial scans.

    The covariance of a pose in the local map is the inverse Hessian of the registration, whose unit is the thickness
    generalized ICP gives to surfaces (0.03 m on either side), times the mean square of the whitened residuals where
    that exceeds 1. It is not scaled down where residuals are smaller: those of neighbouring points are not independent.
    The covariance of a motion is the sum of those of its two poses and of the floor in the settings. Neighbouring
    motions share a pose, so that treating them as independent overstates the drift; along a corridor without any
    structure, on the other hand, a registration believes its prediction more than it should.

    After a registration that fails the map begins anew with the scan that failed: its motion is not known, those after
    it are.

    Parameters
    ----------
    scans : sequence of Scan
        N spatial scans in recorded order.
    settings : LidarOdometrySettings, optional
        The defaults suit a vehicle with a lidar of many rings on a street.
    progress : callable, optional
        Called with the number of scans done.

    Returns
    -------
    LidarOdometry
        Results are the same for any number of threads, up to rounding.

    Raises
    ------
    GeometryError
        If a scan is planar.

    Warns
    -----
    FactorlocWarning
        If registrations failed; they are counted.
    """
    settings = settings or LidarOdometrySettings()
    if any(scan.dimension != 3 for scan in scans):
        raise GeometryError("scans: lidar odometry needs spatial scans; one is planar")
    steps = max(len(scans) - 1, 0)
    motions, covariances = se3.identity((steps,)), np.zeros((steps, 6, 6))
    known, inliers, residuals = np.zeros(steps, np.bool_), np.zeros(steps), np.zeros(steps)
    local: LocalMap | None = None
    for k, scan in enumerate(scans):
        cloud = thin(scan, settings)
        if local is None:
            local = LocalMap(settings, cloud)
        elif (fit := local.register(cloud)).is_sound:
            motions[k - 1], covariances[k - 1] = local.advance(cloud, fit)
            known[k - 1], inliers[k - 1], residuals[k - 1] = True, fit.inliers, fit.residual
        else:
            inliers[k - 1], residuals[k - 1] = fit.inliers, fit.residual
            local = LocalMap(settings, cloud)
        if progress is not None:
            progress(k + 1)
    odometry = LidarOdometry(motions, covariances, known, inliers, residuals)
    if odometry.failed:
        first = int(np.argmin(known))
        lost = f"{odometry.failed} of {steps} motions not known (first: to scan {first + 1})"
        warnings.warn(f"lidar odometry: {lost}; those registrations failed", FactorlocWarning, stacklevel=2)
    return odometry


def with_lidar_odometry(
    drive: Drive,
    settings: LidarOdometrySettings | None = None,
    progress: Callable[[int], None] | None = None,
) -> Drive:
    """Return the drive with the motions that lidar odometry finds in its scans, in place of what it had.

    Parameters
    ----------
    drive : Drive
        Spatial. Its truth is not looked at.
    settings, progress
        As for :func:`lidar_odometry`.

    Raises
    ------
    GeometryError
        If the drive is planar.
    """
    found = lidar_odometry(drive.scans, settings, progress)
    return replace(drive, odometry=found.motions, odometry_known=found.known, odometry_covariances=found.covariances)
