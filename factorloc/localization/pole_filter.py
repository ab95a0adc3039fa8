"""Pole filter: Monte Carlo localization among poles as it was published (thesis, chapter 12)."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc.config import Block
from factorloc.factors.odometry import OdometryNoise
from factorloc.factors.pole_detections import PoleDetections, PoleLandmarks
from factorloc.factors.prior import PosePrior
from factorloc.geometry import se2
from factorloc.localization.initialization import AroundPose, Initialization
from factorloc.localization.kld import KldSettings
from factorloc.localization.monte_carlo import MonteCarloSettings, localize_by_particles
from factorloc.localization.pole_hypothesis import propagated
from factorloc.localization.pole_observations import PoleObservations
from factorloc.mapping.pole_likelihood import PoleLikelihood, pole_scan
from factorloc.mapping.poles import Poles
from factorloc.result import Result
from factorloc.trajectory import Trajectory

__all__ = ["PoleFilterSettings", "filter_poles"]

Array = npt.NDArray[np.float64]

_MOST_POLES = 1000  # of a local map; more are never found


class PoleFilterSettings(Block):
    """Settings of the filter; the defaults are the published ones.

    Parameters
    ----------
    particles : int
        How many, always.
    motion_noise : float
        Factor of the covariances of the motions.
    sigma, epsilon, gate : float
        As :class:`~factorloc.mapping.pole_likelihood.PoleLikelihood`.
    resolution : float, optional
        As there: cells of the table, m; None searches the nearest pole.
    resample_below : float
        Particles are drawn anew when a smaller share of them is effective.
    start_position, start_heading : float
        Radius (m) and largest turn (rad) around a start that is given as a pose.
    odometry : OdometryNoise
        Noise of motions that come without covariances.
    """

    particles: int = Field(5000, gt=0)
    motion_noise: float = Field(4.0, gt=0)
    sigma: float = Field(1.0, gt=0)
    epsilon: float = Field(0.1, gt=0)
    gate: float = Field(2.7, gt=0)
    resolution: float | None = Field(0.25, gt=0)
    resample_below: float = Field(0.5, gt=0, le=1)
    start_position: float = Field(2.5, ge=0)
    start_heading: float = Field(float(np.radians(5.0)), ge=0)
    odometry: OdometryNoise = OdometryNoise()

    @property
    def monte_carlo(self) -> MonteCarloSettings:
        """Settings of the particle filter: all detections as they are, no tempering, and no way back if it is lost."""
        return MonteCarloSettings(
            rays=_MOST_POLES, information=1.0, tempering=None, resampling="systematic",
            resample_below=self.resample_below, kld=KldSettings(least=self.particles, most=self.particles),
            recovery=None, estimate="best", map_position=0.0, map_heading=0.0,
        )  # fmt: skip


def filter_poles(
    landmarks: PoleLandmarks,
    local_maps: Sequence[Poles] | PoleDetections,
    odometry: npt.ArrayLike,
    start: npt.ArrayLike | PosePrior | Initialization,
    *,
    known: npt.ArrayLike | None = None,
    covariances: npt.ArrayLike | None = None,
    stamps: npt.ArrayLike | None = None,
    frame: str = "map",
    settings: PoleFilterSettings | None = None,
    model: PoleLikelihood | None = None,
    progress: Callable[[int], None] | None = None,
    seed: int = 0,
) -> Result:
    """Filter a drive: motion noise x 4, nearest pole, N(d; 0, 1 m^2) + 0.1, best tenth (section 12.4.3).

    Particles are weighed at the poses of the local maps; between them the estimate moves on by odometry. (Printed is
    ``X_t = transform(xi) X_t-1``; a motion that is measured in the body's frame is applied on the right.)

    Parameters
    ----------
    landmarks, local_maps, odometry, start, known, covariances, stamps, frame
        As :func:`~factorloc.localization.pole_smoother.smooth_poles`; trust is not used.
    settings : PoleFilterSettings, optional
        Settings.
    model : PoleLikelihood, optional
        The likelihood of the map with these settings, to be made only once for many drives.
    progress : callable, optional
        Called with the number of local maps done.
    seed : int
        Of all that is random.

    Returns
    -------
    Result
        Poses with covariances.

    Raises
    ------
    MapError
        If there are no landmarks, or the start lies far from all of them.
    GeometryError
        If numbers of local maps, motions and flags disagree.
    """
    began = time.perf_counter()
    settings = settings or PoleFilterSettings()
    given = PoleObservations.of(local_maps, odometry, known, covariances, settings.odometry, settings.motion_noise)
    detections, motions, measured, of_motions = given.detections, given.motions, given.measured, given.covariances
    n = len(detections)
    if model is None:
        model = PoleLikelihood(
            landmarks.poles.positions, settings.sigma, settings.epsilon, settings.gate, settings.resolution, frame
        )
    stops = np.flatnonzero(np.diff(detections.offsets) > 0)
    stops = np.unique(np.concatenate([[0], stops])).astype(np.int64)
    leaps, of_leaps = _joined(motions, of_motions, stops)
    if not isinstance(start, Initialization | PosePrior):
        start = AroundPose(np.asarray(start, np.float64), settings.start_position, settings.start_heading)
    times = np.arange(n, dtype=np.float64) if stamps is None else np.asarray(stamps, np.float64)
    scans = [pole_scan(detections.local_map(int(k)), float(times[k])) for k in stops]
    found = localize_by_particles(
        model, scans, leaps, start, covariances=of_leaps, settings=settings.monte_carlo, progress=progress, seed=seed
    )
    poses, spreads = np.empty((n, 3)), np.empty((n, 3, 3))
    assert found.trajectory.covariances is not None
    poses[stops], spreads[stops] = found.trajectory.poses, found.trajectory.covariances
    for k in np.setdiff1d(np.arange(n), stops):
        poses[k] = se2.compose(poses[k - 1], motions[k - 1])
        spreads[k] = propagated(spreads[k - 1], motions[k - 1], of_motions[k - 1])
    rejected = {**found.rejected, "local maps without poles": int((np.diff(detections.offsets) == 0).sum())}
    rejected["motions not measured"] = int((~measured).sum())
    return replace(
        found,
        trajectory=Trajectory(times, poses, spreads, world=frame),
        rejected=rejected,
        seconds=time.perf_counter() - began,
    )


def _joined(motions: Array, covariances: Array, stops: npt.NDArray[np.int64]) -> tuple[Array, Array]:
    """Motions from each stop to the next, with their covariances."""
    leaps, spreads = np.zeros((len(stops) - 1, 3)), np.zeros((len(stops) - 1, 3, 3))
    for row, (a, b) in enumerate(itertools.pairwise(stops.tolist())):
        leap, spread = motions[a], covariances[a]
        for k in range(a + 1, b):
            leap, spread = se2.compose(leap, motions[k]), propagated(spread, motions[k], covariances[k])
        leaps[row], spreads[row] = leap, spread
    return leaps, spreads
