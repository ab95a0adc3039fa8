"""The localizer: from a map and a drive to a smoothed trajectory, in one call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc.errors import MapError
from factorloc.factors.odometry import OdometryNoise
from factorloc.factors.prior import PosePrior
from factorloc.localization.optimizer import OptimizerSettings
from factorloc.localization.prepared_map import MeasurementSettings, PreparedMap
from factorloc.localization.registration import RegistrationSettings
from factorloc.localization.smoother import smooth
from factorloc.localization.tracking import TrackingSettings, track
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.ray_statistics import RayStatistics
from factorloc.result import Iteration, Result
from factorloc.scan import Scan

__all__ = ["Localization", "LocalizationSettings", "localize"]


class LocalizationSettings(MeasurementSettings):
    """Everything a localization may be told; the defaults run.

    Those of :class:`~factorloc.localization.prepared_map.MeasurementSettings`, and:

    Parameters
    ----------
    smoothing_blur : float
        Coarsest level on which the whole graph is smoothed, m.
    start_position, start_heading : float
        Standard deviations of the start pose, m and rad; in space the heading's is that of roll and pitch as well.
    odometry : OdometryNoise
        Noise of motions that come without covariances.
    tracking : TrackingSettings
    registration : RegistrationSettings
    optimizer : OptimizerSettings
    """

    smoothing_blur: float = Field(0.25, ge=0)
    start_position: float = Field(1.0, gt=0)
    start_heading: float = Field(float(np.radians(10.0)), gt=0)
    odometry: OdometryNoise = OdometryNoise()
    tracking: TrackingSettings = TrackingSettings()
    registration: RegistrationSettings = RegistrationSettings()
    optimizer: OptimizerSettings = OptimizerSettings()


@dataclass(frozen=True)
class Localization:
    """Both passes over a drive.

    Parameters
    ----------
    tracked : Result
        The sequential pass: what a vehicle would know at each moment.
    smoothed : Result
        The batch pass: every pose in the light of all scans.
    """

    tracked: Result
    smoothed: Result


def localize(
    statistics: RayStatistics | BrickStatistics | PreparedMap,
    scans: Sequence[Scan],
    odometry: npt.ArrayLike,
    start: npt.ArrayLike | PosePrior,
    *,
    known: npt.ArrayLike | None = None,
    covariances: npt.ArrayLike | None = None,
    settings: LocalizationSettings | None = None,
    progress: Callable[[int], None] | None = None,
    on_iteration: Callable[[Iteration], None] | None = None,
) -> Localization:
    """Localize a drive in a map: track it scan by scan, then smooth the whole of it.

    Parameters
    ----------
    statistics : RayStatistics, BrickStatistics or PreparedMap
        The map; one that is prepared keeps its own measurement settings.
    scans : sequence of Scan
        N scans in order of driving.
    odometry : array_like, shape (N - 1, 3) or (N - 1, 4, 4)
        Motions of the body between scans.
    start : array_like, shape (3,) or (4, 4), or PosePrior
        Where the drive begins, about: a pose with the standard deviations of the settings, or a prior of its own.
    known : array_like of bool, shape (N - 1,), optional
        Which motions were measured.
    covariances : array_like, shape (N - 1, 3, 3) or (N - 1, 6, 6), optional
        Of the motions, in the tangent space of the body after each; those of the noise model by default.
    settings : LocalizationSettings, optional
        All settings.
    progress : callable, optional
        Called with the number of scans tracked.
    on_iteration : callable, optional
        Called after every smoothing step.

    Returns
    -------
    Localization
        Tracked and smoothed results in the frame of the map.

    Raises
    ------
    MapError
        If scans and map do not fit.
    GeometryError
        If scans and motions do not fit.
    """
    settings = settings or LocalizationSettings()
    prepared = statistics if isinstance(statistics, PreparedMap) else PreparedMap.of(statistics, settings)
    if not isinstance(start, PosePrior):
        start = PosePrior.from_sigmas(start, settings.start_position, settings.start_heading)
    if start.dimension != prepared.dimension:
        raise MapError(
            f"start: it has {start.dimension} dimensions, the map {prepared.dimension}; give a pose of the map's"
        )
    if not prepared.grid.contains(start.position):
        where = ", ".join(f"{value:.2f}" for value in start.position)
        raise MapError(f"start: ({where}) m lies outside the map; give a pose within")
    term = prepared.term(scans)
    stamps = np.array([scan.stamp for scan in scans])
    about: dict[str, Any] = {"known": known, "covariances": covariances, "stamps": stamps, "frame": prepared.grid.frame}
    tracked = track(
        term, odometry, start, **about, noise=settings.odometry, settings=settings.tracking,
        registration=settings.registration, progress=progress,
    )  # fmt: skip
    levels = [i for i, blur in enumerate(term.blurs) if blur <= settings.smoothing_blur] or [len(term.blurs) - 1]
    smoothed = smooth(
        term, odometry, tracked.trajectory.poses, prior=start, **about, noise=settings.odometry, levels=levels,
        settings=settings.optimizer, progress=on_iteration,
    )  # fmt: skip
    return Localization(_widened(tracked, prepared.floor), _widened(smoothed, prepared.floor))


def _widened(result: Result, covariance: npt.NDArray[np.float64]) -> Result:
    """Add a covariance to that of every pose."""
    trajectory = result.trajectory
    if trajectory.covariances is None:
        return result
    return replace(result, trajectory=replace(trajectory, covariances=trajectory.covariances + covariance))
