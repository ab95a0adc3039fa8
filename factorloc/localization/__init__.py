"""Where the rooms meet: registration, tracking, smoothing, and the localizer that runs them in order."""

from factorloc.localization.lidar_odometry import (
    LidarOdometry,
    LidarOdometrySettings,
    lidar_odometry,
    with_lidar_odometry,
)
from factorloc.localization.localizer import Localization, LocalizationSettings, localize
from factorloc.localization.optimizer import OptimizerSettings, ScanFactors, optimize
from factorloc.localization.prepared_map import MeasurementSettings, PreparedMap
from factorloc.localization.registration import Registration, RegistrationSettings, register, register_many
from factorloc.localization.smoother import smooth
from factorloc.localization.tracking import TrackingSettings, find_start, track

__all__ = [
    "LidarOdometry",
    "LidarOdometrySettings",
    "Localization",
    "LocalizationSettings",
    "MeasurementSettings",
    "OptimizerSettings",
    "PreparedMap",
    "Registration",
    "RegistrationSettings",
    "ScanFactors",
    "TrackingSettings",
    "find_start",
    "lidar_odometry",
    "localize",
    "optimize",
    "register",
    "register_many",
    "smooth",
    "track",
    "with_lidar_odometry",
]
