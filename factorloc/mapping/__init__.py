"""What is built offline: ray statistics, and the lidar sensor models on them.

Nothing here knows of gtsam. Maps are made from scans at known poses, merged, written and read; a sensor model turns
their statistics into the likelihood of a scan.
"""

from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.decay_rate import DecayRateMap, DecayRatePosterior
from factorloc.mapping.grid import Grid
from factorloc.mapping.prior import GammaPrior, estimate_prior
from factorloc.mapping.pyramid import DEFAULT_BLURS, BlurPyramid
from factorloc.mapping.ray_statistics import RayStatistics
from factorloc.mapping.spatial_pyramid import SPATIAL_BLURS, SpatialPyramid
from factorloc.mapping.storage import MapInfo, read_map, read_map_info, write_map
from factorloc.mapping.top_view import top_view

__all__ = [
    "DEFAULT_BLURS",
    "SPATIAL_BLURS",
    "BlurPyramid",
    "BrickStatistics",
    "DecayRateMap",
    "DecayRatePosterior",
    "GammaPrior",
    "Grid",
    "MapInfo",
    "RayStatistics",
    "SpatialPyramid",
    "estimate_prior",
    "read_map",
    "read_map_info",
    "top_view",
    "write_map",
]
