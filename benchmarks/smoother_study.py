"""Tracking and smoothing with each model that has a factor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks import carmen_study, kitti0005
from benchmarks.kitti_frames import read_frames
from benchmarks.sensor_model_scenes import DRIVE
from factorloc.config import read_config
from factorloc.localization import LocalizationSettings, PreparedMap, lidar_odometry
from factorloc.mapping import BrickStatistics

__all__ = ["SmootherErrors", "smooth_scene"]


@dataclass(frozen=True)
class SmootherErrors:
    """Root mean squares over all poses of all runs.

    Parameters
    ----------
    tracked, smoothed : float
        Of the position error, m.
    rotation : float
        Of the smoothed rotation error, deg.
    seconds : float
        A scan, tracked and smoothed.
    """

    tracked: float
    smoothed: float
    rotation: float
    seconds: float


def smooth_scene(
    name: str, data: Path, resolution: float, models: Sequence[str], directions: int, scans: int = 0
) -> dict[str, dict[str, float]]:
    """Localize held-out scans from starts around the first pose, as ``carmen`` and ``kitti0005`` do.

    Parameters
    ----------
    name : str
        A log, mapped at the resolution given, or the drive, by the settings of ``kitti0005``.
    data : Path
        Folder of real data.
    resolution : float
        m.
    models : sequence of str
        Of :class:`~factorloc.localization.LocalizationSettings`.
    directions : int
        Starts.
    scans : int
        Held-out scans, the first so many; 0 for all.
    """
    some = slice(scans or None)
    found = (
        _drive(data, models, directions, some)
        if name == DRIVE
        else _log(name, data, resolution, models, directions, some)
    )
    return {model: asdict(errors) for model, errors in found.items()}


def _log(
    name: str, data: Path, resolution: float, models: Sequence[str], directions: int, some: slice
) -> dict[str, SmootherErrors]:
    log = carmen_study.open_log(data, name, resolution)
    log = replace(log, localizing=log.localizing.select(some))
    truth = carmen_study.truth_of(log.localizing)
    out = {}
    for model in models:
        runs = carmen_study.localize_from_around(log, LocalizationSettings().replaced(model=model), directions)
        tracked = carmen_study.errors_of([run.tracked.trajectory for run in runs], truth)
        smoothed = carmen_study.errors_of([run.smoothed.trajectory for run in runs], truth)
        seconds = sum(run.tracked.seconds + run.smoothed.seconds for run in runs) / (len(runs) * len(truth))
        out[model] = SmootherErrors(
            tracked.position.rmse, smoothed.position.rmse, float(np.degrees(smoothed.heading.rmse)), seconds
        )
    return out


def _drive(data: Path, models: Sequence[str], directions: int, some: slice) -> dict[str, SmootherErrors]:
    settings = read_config(kitti0005.SETTINGS, kitti0005.DriveSettings)
    frames = read_frames(data, settings.range_limits)
    mapping, driving = frames.select(slice(0, None, 2)), frames.select(slice(1, None, 2)).select(some)
    statistics = BrickStatistics.from_scans(mapping.scans, mapping.poses, resolution=settings.resolution)
    odometry = lidar_odometry(driving.scans)
    out = {}
    for model in models:
        localization = LocalizationSettings().replaced(model=model)
        prepared = PreparedMap.of(statistics, localization)
        runs = kitti0005.localize_from_around(prepared, driving, odometry, settings, directions, localization)
        tracked = kitti0005.Deviations.of([run.tracked.trajectory for run in runs], driving.reference)
        smoothed = kitti0005.Deviations.of([run.smoothed.trajectory for run in runs], driving.reference)
        seconds = sum(run.tracked.seconds + run.smoothed.seconds for run in runs) / (len(runs) * len(driving))
        out[model] = SmootherErrors(tracked.position.rmse, smoothed.position.rmse, smoothed.rotation.rmse, seconds)
    return out
