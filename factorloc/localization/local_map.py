"""Local map: voxels of the latest scans, with which lidar odometry registers the next one."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc._jit import threads
from factorloc.config import Block
from factorloc.geometry import se3
from factorloc.scan import Scan

__all__ = ["Fit", "LidarOdometrySettings", "LocalMap", "ThinScan", "thin"]

Array = npt.NDArray[np.float64]

_START_SCALE = 4.0  # voxels and correspondences of the search without a velocity are so many times larger
_CLEAR_CYCLE = 10  # insertions between two clearings of old voxels
_ROTATION_TOLERANCE, _TRANSLATION_TOLERANCE = 1e-3, 1e-3  # rad, m; steps below them end the iteration


class LidarOdometrySettings(Block):
    """How scans are registered, and how far the result is trusted.

    Parameters
    ----------
    sampling : float
        Edge length of the voxels a scan is thinned by, m.
    voxel : float
        Edge length of the voxels of the local map, m.
    neighbours : int
        Points a neighbourhood is made of.
    max_distance : float
        Longest distance between a point and the centre of its voxel's points, m.
    max_iterations : int
        Steps of one registration.
    map_scans : int
        A voxel that was not hit by so many scans added to the map is forgotten.
    least_step : float
        A scan is added to the map if the body moved so far since the last one that was, m. At a standstill the map
        would only gather noise.
    least_points : int
        A scan needs so many points after thinning.
    least_inliers : float
        A registration needs this fraction of points that found a voxel; slid along a street it reaches some 0.7.
    inflation : float
        Factor on the covariances of registered poses.
    least_rotation, least_translation : float
        Standard deviations added to each axis of every motion, rad and m: for what registration does not see of its own
        errors, such as the distortion of sweeps.

    Raises
    ------
    ConfigError
        If a number is out of its range.
    """

    sampling: float = Field(0.4, gt=0)
    voxel: float = Field(1.0, gt=0)
    neighbours: int = Field(10, ge=5)
    max_distance: float = Field(1.0, gt=0)
    max_iterations: int = Field(30, gt=0)
    map_scans: int = Field(100, gt=0)
    least_step: float = Field(0.1, ge=0)
    least_points: int = Field(100, ge=10)
    least_inliers: float = Field(0.75, ge=0, le=1)
    inflation: float = Field(1.0, gt=0)
    least_rotation: float = Field(1e-4, gt=0)
    least_translation: float = Field(0.005, gt=0)


class ThinScan(NamedTuple):
    """A thinned scan.

    Parameters
    ----------
    points : small_gicp.PointCloud
        Its points in the sensor frame, with covariances; None if there are too few.
    T_body_sensor : ndarray, shape (4, 4)
        Pose of the sensor on the body.
    is_enough : bool
        Whether there are points enough to register it.
    """

    points: Any
    T_body_sensor: Array
    is_enough: bool


class Fit(NamedTuple):
    """A scan registered with the local map.

    Parameters
    ----------
    T_map_sensor : ndarray, shape (4, 4)
        Pose of its sensor in the map.
    covariance : ndarray, shape (6, 6)
        Covariance of that pose in the tangent space ``[omega, v]`` of the sensor.
    inliers : float
        Fraction of its points that found a voxel.
    residual : float
        Mean square of the whitened residuals.
    is_sound : bool
        Whether the registration succeeded.
    """

    T_map_sensor: Array
    covariance: Array
    inliers: float
    residual: float
    is_sound: bool


def thin(scan: Scan, settings: LidarOdometrySettings) -> ThinScan:
    """Points of a scan, one a voxel, with the covariances of their neighbourhoods."""
    import small_gicp

    points = scan.points()
    if len(points) < settings.least_points:
        return ThinScan(None, scan.T_body_sensor, False)
    # One thread: with more, which points are kept depends on chance.
    thinned = small_gicp.voxelgrid_sampling(points, settings.sampling, 1)
    if thinned.size() < settings.least_points:
        return ThinScan(None, scan.T_body_sensor, False)
    tree = small_gicp.KdTree(thinned, threads())
    small_gicp.estimate_covariances(thinned, tree, settings.neighbours, threads())
    return ThinScan(thinned, scan.T_body_sensor, True)


class LocalMap:
    """Voxels of the latest scans, in the frame of the sensor at the first of them.

    Parameters
    ----------
    settings : LidarOdometrySettings
        How scans are registered.
    cloud : ThinScan
        The first scan.
    """

    def __init__(self, settings: LidarOdometrySettings, cloud: ThinScan) -> None:
        self._settings = settings
        self._voxels = self._empty(settings.voxel)
        self._last = cloud
        self._T_map_sensor = self._T_map_inserted = se3.identity()
        self._covariance = np.zeros((6, 6))
        self._motion: Array | None = None
        if cloud.is_enough:
            self._voxels.insert(cloud.points, self._T_map_sensor)

    def register(self, cloud: ThinScan) -> Fit:
        """Find the scan that follows the last one.

        It is looked for where the last velocity leads. Where there is none yet, or it misleads, a registration of
        larger reach with the last scan alone, begun at a standstill, says where.
        """
        fit = Fit(self._T_map_sensor, np.zeros((6, 6)), 0.0, 0.0, False)
        if not (cloud.is_enough and self._last.is_enough):
            return fit
        if self._motion is not None:
            fit = self._fit_near(cloud, _moved(self._last.T_body_sensor, self._motion, cloud.T_body_sensor))
        return fit if fit.is_sound else self._fit_near(cloud, self._search(cloud))

    def aligned(self, cloud: ThinScan, T_last_now: Array) -> tuple[Array, Array] | None:
        """Find a scan near a pose of its body in that of the last one; its motion and covariance, None if it failed.

        The map is left as it is.
        """
        if not (cloud.is_enough and self._last.is_enough):
            return None
        fit = self._fit_near(cloud, _moved(self._last.T_body_sensor, T_last_now, cloud.T_body_sensor))
        return self._motion_of(cloud, fit) if fit.is_sound else None

    def advance(self, cloud: ThinScan, fit: Fit) -> tuple[Array, Array]:
        """Take a registered scan for the latest; return the motion of the body to it, and its covariance."""
        motion, total = self._motion_of(cloud, fit)
        to_body = se3.adjoint(cloud.T_body_sensor)
        covariance = to_body @ fit.covariance @ to_body.T
        self._last, self._T_map_sensor = cloud, fit.T_map_sensor
        self._covariance, self._motion = covariance, motion
        step = np.linalg.norm(se3.between(self._T_map_inserted, self._T_map_sensor)[:3, 3])
        if step >= self._settings.least_step:
            self._voxels.insert(cloud.points, self._T_map_sensor)
            self._T_map_inserted = self._T_map_sensor
        return motion, total

    def _motion_of(self, cloud: ThinScan, fit: Fit) -> tuple[Array, Array]:
        """Motion of the body from the last scan to a registered one, and its covariance."""
        mount = cloud.T_body_sensor
        T_last_now = se3.between(self._T_map_sensor, fit.T_map_sensor)
        motion = _moved(se3.inverse(self._last.T_body_sensor), T_last_now, se3.inverse(mount))
        # A tangent vector of the sensor is one of the body that carries it.
        to_body, back = se3.adjoint(mount), se3.adjoint(se3.inverse(motion))
        covariance = to_body @ fit.covariance @ to_body.T
        least = np.repeat([self._settings.least_rotation, self._settings.least_translation], 3) ** 2
        total = covariance + back @ self._covariance @ back.T + np.diag(least)
        return motion, (total + total.T) / 2

    def _search(self, cloud: ThinScan) -> Array:
        """Pose of the scan in the frame of the last one, roughly, out of nothing."""
        coarse = self._empty(_START_SCALE * self._settings.voxel)
        coarse.insert(self._last.points, se3.identity())
        at_rest = _moved(self._last.T_body_sensor, se3.identity(), cloud.T_body_sensor)
        fit = self._fit(coarse, cloud, at_rest, _START_SCALE * self._settings.max_distance)
        return fit.T_map_sensor if fit.is_sound else at_rest

    def _fit_near(self, cloud: ThinScan, T_last_now: Array) -> Fit:
        return self._fit(self._voxels, cloud, self._T_map_sensor @ T_last_now, self._settings.max_distance)

    def _fit(self, voxels: Any, cloud: ThinScan, T_map_sensor: Array, max_distance: float) -> Fit:
        import small_gicp

        settings = self._settings
        result = small_gicp.align(
            voxels,
            cloud.points,
            T_map_sensor,
            max_correspondence_distance=max_distance,
            num_threads=threads(),
            max_iterations=settings.max_iterations,
            rotation_epsilon=_ROTATION_TOLERANCE,
            translation_epsilon=_TRANSLATION_TOLERANCE,
        )
        pose, count = np.asarray(result.T_target_source), int(result.num_inliers)
        inliers, residual = count / cloud.points.size(), 2 * float(result.error) / max(3 * count - 6, 1)
        sound = bool(result.converged) and inliers >= settings.least_inliers and bool(np.isfinite(pose).all())
        # Perturbed by T_map_sensor * exp([omega, v]), as the tangent spaces of factorloc.geometry.
        hessian = (np.asarray(result.H) + np.asarray(result.H).T) / 2
        if not sound or not np.isfinite(hessian).all() or np.linalg.eigvalsh(hessian)[0] <= 0:
            return Fit(T_map_sensor, np.zeros((6, 6)), inliers, residual, False)
        # A constant velocity feeds rounding back: without making rotations orthonormal it doubles with each scan.
        pose = se3.from_quaternion(pose[:3, 3], se3.quaternion(pose))
        covariance = settings.inflation * max(1.0, residual) * np.linalg.inv(hessian)
        return Fit(pose, covariance, inliers, residual, True)

    def _empty(self, size: float) -> Any:
        import small_gicp

        voxels = small_gicp.GaussianVoxelMap(size)
        voxels.set_lru(self._settings.map_scans, _CLEAR_CYCLE)
        return voxels


def _moved(T_a_b: Array, T_b_c: Array, T_c_d: Array) -> Array:
    """Motion of a sensor that is carried, or of the body that carries it."""
    return se3.compose(se3.inverse(T_a_b), se3.compose(T_b_c, T_c_d))
