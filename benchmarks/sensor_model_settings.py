"""Settings of the comparison of sensor models."""

from __future__ import annotations

from pydantic import Field

from benchmarks.filter_study import FilterSettings, Sigmas
from benchmarks.pose_divergence import DivergenceSettings
from benchmarks.sensor_model_choices import TrainingGrid
from benchmarks.sensor_model_scenes import SCENES, PlanarScenes, SpatialScenes
from factorloc.config import Block

__all__ = ["FigureSettings", "Settings", "Sizes", "SmootherSettings"]


class Sizes(Block):
    """How much is done.

    Parameters
    ----------
    scenes : tuple of str
        Of all scenes by default.
    training_scans, held_out, divergence_scans : int
        Scans of a scene, at most; 0 for all.
    runs : int
        Of each filter.
    filter_scans, smoothed_scans : int
        Of a run of a filter and of the smoother, at most; 0 for all.
    directions : int
        Starts of the smoother.
    """

    scenes: tuple[str, ...] = SCENES
    training_scans: int = Field(gt=0)
    held_out: int = Field(ge=0)
    divergence_scans: int = Field(gt=0)
    runs: int = Field(gt=1)
    filter_scans: int = Field(0, ge=0)
    smoothed_scans: int = Field(0, ge=0)
    directions: int = Field(gt=0)


class FigureSettings(Block):
    """Error over time, the form of figure 8.3.

    Parameters
    ----------
    scenes : tuple of str
    particles, scans : int
    start : (float, float, float)
        As in :class:`FilterSettings`.
    """

    scenes: tuple[str, ...]
    particles: int = Field(gt=0)
    scans: int = Field(gt=1)
    start: Sigmas


class SmootherSettings(Block):
    """Smoothing.

    Parameters
    ----------
    scenes, models : tuple of str
        Which models smooth which scenes.
    """

    scenes: tuple[str, ...]
    models: tuple[str, ...]


class Settings(Block):
    """What ``sensor_models.json`` holds.

    Parameters
    ----------
    seed : int
    planar, spatial, training, divergence, filters, figure, smoother
        Scenes and experiments.
    block : int
        Consecutive held-out scans that count as one where a test should not take neighbours for independent.
    full, quick : Sizes
    gain : float
        Least mean gain of FMP over MLM at its best floor, on every scene and for both models, nats per ray.
    """

    seed: int = Field(ge=0)
    planar: PlanarScenes
    spatial: SpatialScenes
    training: TrainingGrid
    divergence: DivergenceSettings
    filters: FilterSettings
    figure: FigureSettings
    smoother: SmootherSettings
    block: int = Field(gt=0)
    full: Sizes
    quick: Sizes
    gain: float
