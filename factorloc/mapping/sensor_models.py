"""Sensor models by name, as configurations choose them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from factorloc.errors import MapError
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.decay_rate import DecayRateMap, DecayRatePosterior
from factorloc.mapping.end_point import EndPointModel
from factorloc.mapping.noisy_decay_rate import NoisyDecayRateMap
from factorloc.mapping.normalized_end_point import NormalizedEndPointModel
from factorloc.mapping.ray_statistics import RayStatistics
from factorloc.mapping.reflection import ReflectionMap, ReflectionPosterior
from factorloc.mapping.sensor_model import SensorModel

__all__ = ["SENSOR_MODELS", "make_sensor_model"]


def _noisy(statistics: RayStatistics | BrickStatistics, **options: Any) -> SensorModel:
    return NoisyDecayRateMap.from_posterior(DecayRatePosterior.from_statistics(statistics), **options)


_MAKERS: Mapping[str, Callable[..., SensorModel]] = {
    "decay-rate": DecayRateMap.from_statistics,
    "decay-rate-posterior": DecayRatePosterior.from_statistics,
    "reflection": ReflectionMap.from_statistics,
    "reflection-posterior": ReflectionPosterior.from_statistics,
    "decay-rate-noisy": _noisy,
    "end-point": EndPointModel.from_statistics,
    "end-point-normalized": NormalizedEndPointModel.from_statistics,
}

SENSOR_MODELS = tuple(_MAKERS)
"""Names of the sensor models."""


def make_sensor_model(statistics: RayStatistics | BrickStatistics, name: str, **options: Any) -> SensorModel:
    """Make a sensor model of a map.

    Parameters
    ----------
    statistics : RayStatistics or BrickStatistics
        What the mapping rays left behind.
    name : str
        One of :data:`SENSOR_MODELS`: maximum-likelihood maps ``"decay-rate"`` and ``"reflection"``, their posteriors,
        mean decay rates seen through range noise and false detections, and the end point model, as it is used and as
        a density.
    **options
        Of the model's ``from_statistics``, as ``prior`` or ``floor``.

    Raises
    ------
    MapError
        If there is no model of that name, or the map holds nothing to make it of.
    """
    if name not in _MAKERS:
        raise MapError(f"sensor model: none is named '{name}'; choose one of {', '.join(SENSOR_MODELS)}")
    return _MAKERS[name](statistics, **options)
