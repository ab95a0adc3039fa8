"""The localizer: from a map and a drive to a smoothed trajectory, in one call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc.config import Block
from factorloc.errors import MapError
from factorloc.factors.distance_field import DistanceFieldTerm
from factorloc.factors.grid_scan_term import DecayRateTerm, GridScanTerm
from factorloc.factors.odometry import OdometryNoise
from factorloc.factors.prior import PosePrior
from factorloc.localization.optimizer import OptimizerSettings
from factorloc.localization.registration import RegistrationSettings
from factorloc.localization.smoother import smooth
from factorloc.localization.tracking import TrackingSettings, track
from factorloc.mapping.pyramid import DEFAULT_BLURS, BlurPyramid
from factorloc.mapping.ray_statistics import RayStatistics
from factorloc.result import Iteration, Result
from factorloc.scan import Scan

__all__ = ["Localization", "LocalizationSettings", "localize"]


class LocalizationSettings(Block):
    """Everything a localization may be told; the defaults run.

    Parameters
    ----------
    model : {"decay-rate", "distance-field"}
        Measurement model of the scans.
    information : float
        Weight of a scan's log-likelihood. Its rays are not independent: neighbours share a wall, its errors and the
        map's.
    blurs : tuple of float
        Blurs of the map pyramid, m, coarse to fine.
    smoothing_blur : float
        Coarsest level on which the whole graph is smoothed, m.
    start_position, start_heading : float
        Standard deviations of the start pose, m and rad.
    map_position, map_heading : float
        Standard deviations of what the map itself is wrong by at any one place, m and rad: its cells, and the poses it
        was built from. No number of rays averages that out, so it is added to every covariance reported.
    odometry : OdometryNoise
        Noise of the motions.
    tracking : TrackingSettings
    registration : RegistrationSettings
    optimizer : OptimizerSettings
    """

    model: Literal["decay-rate", "distance-field"] = "decay-rate"
    information: float = Field(0.2, gt=0, le=1)
    blurs: tuple[float, ...] = DEFAULT_BLURS
    smoothing_blur: float = Field(0.25, ge=0)
    start_position: float = Field(1.0, gt=0)
    start_heading: float = Field(float(np.radians(10.0)), gt=0)
    map_position: float = Field(0.02, ge=0)
    map_heading: float = Field(0.003, ge=0)
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
    statistics: RayStatistics,
    scans: Sequence[Scan],
    odometry: npt.ArrayLike,
    start: npt.ArrayLike | PosePrior,
    *,
    known: npt.ArrayLike | None = None,
    settings: LocalizationSettings | None = None,
    progress: Callable[[int], None] | None = None,
    on_iteration: Callable[[Iteration], None] | None = None,
) -> Localization:
    """Localize a drive in a map: track it scan by scan, then smooth the whole of it.

    Parameters
    ----------
    statistics : RayStatistics
        The map.
    scans : sequence of Scan
        N scans in order of driving.
    odometry : array_like, shape (N - 1, 3)
        Motions ``[dx, dy, dtheta]`` of the body between scans.
    start : array_like, shape (3,), or PosePrior
        Where the drive begins, about: a pose with the standard deviations of the settings, or a prior of its own.
    known : array_like of bool, shape (N - 1,), optional
        Which motions were measured.
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
    if not isinstance(start, PosePrior):
        start = PosePrior.from_sigmas(start, settings.start_position, settings.start_heading)
    if not statistics.grid.contains(start.pose[: statistics.grid.dimension]):
        raise MapError(f"start: ({start.pose[0]:.2f}, {start.pose[1]:.2f}) m lies outside the map; give a pose within")
    term = make_term(statistics, scans, settings)
    stamps = np.array([scan.stamp for scan in scans])
    frame = statistics.grid.frame
    tracked = track(
        term, odometry, start, known=known, stamps=stamps, frame=frame, noise=settings.odometry,
        settings=settings.tracking, registration=settings.registration, progress=progress,
    )  # fmt: skip
    levels = [i for i, blur in enumerate(term.blurs) if blur <= settings.smoothing_blur] or [len(term.blurs) - 1]
    smoothed = smooth(
        term, odometry, tracked.trajectory.poses, prior=start, known=known, stamps=stamps, frame=frame,
        noise=settings.odometry, levels=levels, settings=settings.optimizer, progress=on_iteration,
    )  # fmt: skip
    floor = np.diag(np.square([settings.map_position, settings.map_position, settings.map_heading]))
    return Localization(_widened(tracked, floor), _widened(smoothed, floor))


def _widened(result: Result, covariance: npt.NDArray[np.float64]) -> Result:
    """Add a covariance to that of every pose."""
    trajectory = result.trajectory
    if trajectory.covariances is None:
        return result
    return replace(result, trajectory=replace(trajectory, covariances=trajectory.covariances + covariance))


def make_term(statistics: RayStatistics, scans: Sequence[Scan], settings: LocalizationSettings) -> GridScanTerm:
    """Build the measurement model that the settings name."""
    if settings.model == "distance-field":
        return DistanceFieldTerm(statistics, scans, settings.information, blurs=settings.blurs)
    return DecayRateTerm(BlurPyramid.from_statistics(statistics, settings.blurs), scans, settings.information)
