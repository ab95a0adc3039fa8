"""Localize a lidar vehicle in a known map by smoothing a gtsam factor graph.

The public names stand below, by the room they come from; they are imported when first used, so that
``import factorloc`` costs next to nothing.

>>> import factorloc as fl
>>> fl.se2.compose([1.0, 0.0, 0.0], [1.0, 0.0, 0.0]).tolist()
[2.0, 0.0, 0.0]
"""

from __future__ import annotations

import importlib
import logging
from typing import TYPE_CHECKING, Any

from factorloc._version import __version__

if TYPE_CHECKING:
    from factorloc._jit import set_threads
    from factorloc.datasets import Drive, open_drive
    from factorloc.errors import FactorlocError
    from factorloc.evaluation import evaluate
    from factorloc.factors import (
        DecayRateTerm,
        DistanceFieldTerm,
        EndPointTerm,
        OdometryNoise,
        PosePrior,
        PosteriorTerm,
    )
    from factorloc.geometry import se2, se3
    from factorloc.localization import (
        AroundPose,
        FreeSpace,
        Localization,
        LocalizationSettings,
        MonteCarloSettings,
        NormalStart,
        ParticleFilter,
        Particles,
        PreparedMap,
        localize,
        localize_by_particles,
        register,
        smooth,
        track,
    )
    from factorloc.mapping import (
        BlurPyramid,
        BrickStatistics,
        DecayRateMap,
        DecayRatePosterior,
        EndPointModel,
        Grid,
        RayStatistics,
        ReflectionMap,
        ReflectionPosterior,
        SensorModel,
        make_sensor_model,
        read_map,
        write_map,
    )
    from factorloc.result import Result
    from factorloc.scan import RayStatus, Scan
    from factorloc.simulation import office_plan, office_routes, simulate_drive
    from factorloc.trajectory import Trajectory

_ROOMS = {
    "_jit": ["set_threads"],
    "datasets": ["Drive", "open_drive"],
    "errors": ["FactorlocError"],
    "evaluation": ["evaluate"],
    "factors": ["DecayRateTerm", "DistanceFieldTerm", "EndPointTerm", "OdometryNoise", "PosePrior", "PosteriorTerm"],
    "geometry": ["se2", "se3"],
    "localization": [
        "AroundPose",
        "FreeSpace",
        "Localization",
        "LocalizationSettings",
        "MonteCarloSettings",
        "NormalStart",
        "ParticleFilter",
        "Particles",
        "PreparedMap",
        "localize",
        "localize_by_particles",
        "register",
        "smooth",
        "track",
    ],
    "mapping": [
        "BlurPyramid",
        "BrickStatistics",
        "DecayRateMap",
        "DecayRatePosterior",
        "EndPointModel",
        "Grid",
        "RayStatistics",
        "ReflectionMap",
        "ReflectionPosterior",
        "SensorModel",
        "make_sensor_model",
        "read_map",
        "write_map",
    ],
    "result": ["Result"],
    "scan": ["RayStatus", "Scan"],
    "simulation": ["office_plan", "office_routes", "simulate_drive"],
    "trajectory": ["Trajectory"],
}
_ROOM_OF = {name: room for room, names in _ROOMS.items() for name in names}

__all__ = [
    "AroundPose",
    "BlurPyramid",
    "BrickStatistics",
    "DecayRateMap",
    "DecayRatePosterior",
    "DecayRateTerm",
    "DistanceFieldTerm",
    "Drive",
    "EndPointModel",
    "EndPointTerm",
    "FactorlocError",
    "FreeSpace",
    "Grid",
    "Localization",
    "LocalizationSettings",
    "MonteCarloSettings",
    "NormalStart",
    "OdometryNoise",
    "ParticleFilter",
    "Particles",
    "PosePrior",
    "PosteriorTerm",
    "PreparedMap",
    "RayStatistics",
    "RayStatus",
    "ReflectionMap",
    "ReflectionPosterior",
    "Result",
    "Scan",
    "SensorModel",
    "Trajectory",
    "__version__",
    "evaluate",
    "localize",
    "localize_by_particles",
    "make_sensor_model",
    "office_plan",
    "office_routes",
    "open_drive",
    "read_map",
    "register",
    "se2",
    "se3",
    "set_threads",
    "simulate_drive",
    "smooth",
    "track",
    "write_map",
]

logging.getLogger(__name__).addHandler(logging.NullHandler())


def __getattr__(name: str) -> Any:
    if name not in _ROOM_OF:
        raise AttributeError(f"module 'factorloc' has no attribute '{name}'")
    value = getattr(importlib.import_module(f"factorloc.{_ROOM_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
