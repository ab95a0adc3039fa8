"""Measurements as factors of a gtsam graph.

Measurements are frozen dataclasses; gtsam factors are built from them late. Scan terms evaluate a whole batch of poses
in one parallel call; their two adaptors are Gaussian Hessian factors for batch solvers and square-root custom factors
for incremental ones.
"""

from factorloc.factors.adaptors import hessian_factors, square_root_factor
from factorloc.factors.distance_field import DistanceFieldTerm
from factorloc.factors.end_point_levels import EndPointLevels
from factorloc.factors.end_point_term import EndPointTerm, SpatialEndPointTerm
from factorloc.factors.facades import FacadeLineFactor, FacadePointFactor
from factorloc.factors.grid_scan_term import DecayRateTerm, PosteriorTerm
from factorloc.factors.level_tables import LevelTables
from factorloc.factors.odometry import OdometryNoise, odometry_factors
from factorloc.factors.pole_association import JointCompatibility, MaxMixture, NearestNeighbour, PoleAssociation
from factorloc.factors.pole_detections import PoleDetections, PoleLandmarks, PoleMixture
from factorloc.factors.pole_factors import known_poles_factor, landmark_factors, landmark_priors
from factorloc.factors.pole_term import PoleTerm
from factorloc.factors.prior import PosePrior
from factorloc.factors.scan_term import ScanCosts, ScanTerm
from factorloc.factors.spatial_scan_term import SpatialScanTerm

__all__ = [
    "DecayRateTerm",
    "DistanceFieldTerm",
    "EndPointLevels",
    "EndPointTerm",
    "FacadeLineFactor",
    "FacadePointFactor",
    "JointCompatibility",
    "LevelTables",
    "MaxMixture",
    "NearestNeighbour",
    "OdometryNoise",
    "PoleAssociation",
    "PoleDetections",
    "PoleLandmarks",
    "PoleMixture",
    "PoleTerm",
    "PosePrior",
    "PosteriorTerm",
    "ScanCosts",
    "ScanTerm",
    "SpatialEndPointTerm",
    "SpatialScanTerm",
    "hessian_factors",
    "known_poles_factor",
    "landmark_factors",
    "landmark_priors",
    "odometry_factors",
    "square_root_factor",
]
