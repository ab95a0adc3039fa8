"""What is built offline: ray statistics, and the lidar sensor models on them.

Nothing here knows of gtsam. Maps are made from scans at known poses, merged, written and read; a sensor model turns
their statistics into the likelihood of a scan.
"""

from factorloc.mapping.belief import BetaBelief, GammaBelief
from factorloc.mapping.beta_prior import BetaPrior, estimate_beta_prior
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.building_outlines import BuildingOutlines, Outline
from factorloc.mapping.decay_rate import DecayRateMap, DecayRatePosterior
from factorloc.mapping.distance_transform import DistanceField
from factorloc.mapping.end_point import EndPointModel
from factorloc.mapping.evidence import RateEvidence, ReflectionEvidence
from factorloc.mapping.facade_bounds import FacadeBounds
from factorloc.mapping.facade_map import FacadeMap, MapUncertainty
from factorloc.mapping.facade_storage import is_facade_map, read_facade_map, write_facade_geojson, write_facade_map
from factorloc.mapping.facade_visibility import SightLines
from factorloc.mapping.facades import Facades
from factorloc.mapping.fading_counts import FadingCounts
from factorloc.mapping.georeference import Georeference
from factorloc.mapping.grid import Grid
from factorloc.mapping.local_frame import LocalFrame
from factorloc.mapping.local_maps import LocalMap, local_maps
from factorloc.mapping.map_change import MapChange
from factorloc.mapping.map_shift import MapShift, log_match
from factorloc.mapping.noisy_decay_rate import NoisyDecayRateMap
from factorloc.mapping.normalized_end_point import NormalizedEndPointModel
from factorloc.mapping.occupancy import OccupancyMap
from factorloc.mapping.out_of_range import OutOfRangePrior
from factorloc.mapping.pole_detection_rates import PoleDetectionRates
from factorloc.mapping.pole_extractor import PoleExtractor
from factorloc.mapping.pole_map import PoleMap
from factorloc.mapping.pole_map_storage import is_pole_map, read_pole_map, write_pole_map
from factorloc.mapping.pole_mapping import PoleMapper, PoleMappingSettings
from factorloc.mapping.pole_settings import BY_EVIDENCE, KITTI_LIKE, NCLT_LIKE, EvidenceSettings, PoleSettings
from factorloc.mapping.poles import Poles
from factorloc.mapping.prior import GammaPrior, estimate_prior
from factorloc.mapping.pyramid import DEFAULT_BLURS, BlurPyramid
from factorloc.mapping.ray_statistics import RayStatistics
from factorloc.mapping.reflection import ReflectionMap, ReflectionPosterior
from factorloc.mapping.sensor_model import SensorModel
from factorloc.mapping.sensor_models import SENSOR_MODELS, make_sensor_model
from factorloc.mapping.spatial_pyramid import SPATIAL_BLURS, SpatialPyramid
from factorloc.mapping.storage import MapInfo, read_map, read_map_info, write_map
from factorloc.mapping.top_view import top_view

__all__ = [
    "BY_EVIDENCE",
    "DEFAULT_BLURS",
    "KITTI_LIKE",
    "NCLT_LIKE",
    "SENSOR_MODELS",
    "SPATIAL_BLURS",
    "BetaBelief",
    "BetaPrior",
    "BlurPyramid",
    "BrickStatistics",
    "BuildingOutlines",
    "DecayRateMap",
    "DecayRatePosterior",
    "DistanceField",
    "EndPointModel",
    "EvidenceSettings",
    "FacadeBounds",
    "FacadeMap",
    "Facades",
    "FadingCounts",
    "GammaBelief",
    "GammaPrior",
    "Georeference",
    "Grid",
    "LocalFrame",
    "LocalMap",
    "MapChange",
    "MapInfo",
    "MapShift",
    "MapUncertainty",
    "NoisyDecayRateMap",
    "NormalizedEndPointModel",
    "OccupancyMap",
    "OutOfRangePrior",
    "Outline",
    "PoleDetectionRates",
    "PoleExtractor",
    "PoleMap",
    "PoleMapper",
    "PoleMappingSettings",
    "PoleSettings",
    "Poles",
    "RateEvidence",
    "RayStatistics",
    "ReflectionEvidence",
    "ReflectionMap",
    "ReflectionPosterior",
    "SensorModel",
    "SightLines",
    "SpatialPyramid",
    "estimate_beta_prior",
    "estimate_prior",
    "is_facade_map",
    "is_pole_map",
    "local_maps",
    "log_match",
    "make_sensor_model",
    "read_facade_map",
    "read_map",
    "read_map_info",
    "read_pole_map",
    "top_view",
    "write_facade_geojson",
    "write_facade_map",
    "write_map",
    "write_pole_map",
]
