"""Where the rooms meet: registration, tracking, smoothing, and the localizer that runs them in order.

And Monte Carlo localization by particles: propagate, reweight, resample, estimate. Both among poles as well. And
localization among facades: feasible sets by intervals, and the most likely pose in them by bounded least squares.
"""

from factorloc.localization.bounded_least_squares import BoundedEstimate, estimate_in_bounds
from factorloc.localization.bounded_motion import OdometryBounds, propagate
from factorloc.localization.correspondences import CorrespondenceSettings, find_correspondences
from factorloc.localization.derivative_free import RefinementSettings, refine
from factorloc.localization.facade_scan import localize_scan
from factorloc.localization.facade_settings import FacadeSettings
from factorloc.localization.facade_tracker import FacadeTracker
from factorloc.localization.feasible_set import FeasibleSet, intersect_correspondences
from factorloc.localization.feasible_settings import FeasibleSettings
from factorloc.localization.initialization import AroundPose, FreeSpace, Initialization, NormalStart
from factorloc.localization.interval_tracking import FacadeTrack, track_facades
from factorloc.localization.kld import KldSettings
from factorloc.localization.landmark_smoother import LandmarkSolution, smooth_landmarks
from factorloc.localization.least_squares_settings import LeastSquaresSettings
from factorloc.localization.lidar_odometry import (
    LidarOdometry,
    LidarOdometrySettings,
    lidar_odometry,
    with_lidar_odometry,
)
from factorloc.localization.localizer import Localization, LocalizationSettings, localize
from factorloc.localization.monte_carlo import MonteCarloSettings, localize_by_particles
from factorloc.localization.motion_model import MotionModel, TangentMotion, TurnDriveTurn
from factorloc.localization.optimizer import OptimizerSettings, ScanFactors, optimize
from factorloc.localization.particle_estimates import ParticleEstimates, PoseEstimate
from factorloc.localization.particle_filter import ParticleFilter, ParticleFilterSettings
from factorloc.localization.particles import Particles
from factorloc.localization.pole_drive import PoleDrive
from factorloc.localization.pole_filter import PoleFilterSettings, filter_poles
from factorloc.localization.pole_localization import PoleLocalization
from factorloc.localization.pole_persistence import PersistenceSettings, persistence
from factorloc.localization.pole_smoother import PoleSmootherSettings, smooth_poles
from factorloc.localization.prepared_map import MeasurementSettings, PreparedMap
from factorloc.localization.recovery import RecoverySettings
from factorloc.localization.registration import Registration, RegistrationSettings, register, register_many
from factorloc.localization.smoother import smooth
from factorloc.localization.tracking import TrackingSettings, find_start, track
from factorloc.localization.trajectory_refinement import (
    RefinedTrajectory,
    TrajectoryRefinementSettings,
    refine_trajectory,
)
from factorloc.localization.wall_lines import WallLines

__all__ = [
    "AroundPose",
    "BoundedEstimate",
    "CorrespondenceSettings",
    "FacadeSettings",
    "FacadeTrack",
    "FacadeTracker",
    "FeasibleSet",
    "FeasibleSettings",
    "FreeSpace",
    "Initialization",
    "KldSettings",
    "LandmarkSolution",
    "LeastSquaresSettings",
    "LidarOdometry",
    "LidarOdometrySettings",
    "Localization",
    "LocalizationSettings",
    "MeasurementSettings",
    "MonteCarloSettings",
    "MotionModel",
    "NormalStart",
    "OdometryBounds",
    "OptimizerSettings",
    "ParticleEstimates",
    "ParticleFilter",
    "ParticleFilterSettings",
    "Particles",
    "PersistenceSettings",
    "PoleDrive",
    "PoleFilterSettings",
    "PoleLocalization",
    "PoleSmootherSettings",
    "PoseEstimate",
    "PreparedMap",
    "RecoverySettings",
    "RefinedTrajectory",
    "RefinementSettings",
    "Registration",
    "RegistrationSettings",
    "ScanFactors",
    "TangentMotion",
    "TrackingSettings",
    "TrajectoryRefinementSettings",
    "TurnDriveTurn",
    "WallLines",
    "estimate_in_bounds",
    "filter_poles",
    "find_correspondences",
    "find_start",
    "intersect_correspondences",
    "lidar_odometry",
    "localize",
    "localize_by_particles",
    "localize_scan",
    "optimize",
    "persistence",
    "propagate",
    "refine",
    "refine_trajectory",
    "register",
    "register_many",
    "smooth",
    "smooth_landmarks",
    "smooth_poles",
    "track",
    "track_facades",
    "with_lidar_odometry",
]
