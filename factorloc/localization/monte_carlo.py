"""Monte Carlo localization: a drive in a map by a particle filter, scan by scan."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc.errors import GeometryError, MapError
from factorloc.factors.odometry import known_motions
from factorloc.factors.prior import PosePrior
from factorloc.geometry import group_of, position_heading
from factorloc.localization.initialization import Initialization, NormalStart
from factorloc.localization.motion_model import MotionModel
from factorloc.localization.particle_estimates import PoseEstimate
from factorloc.localization.particle_filter import ParticleFilter, ParticleFilterSettings
from factorloc.localization.particles import Particles
from factorloc.localization.reweighting import Reweighting
from factorloc.mapping.sensor_model import SensorModel
from factorloc.result import Result, StopReason
from factorloc.scan import Scan
from factorloc.trajectory import Trajectory

__all__ = ["MonteCarloSettings", "localize_by_particles"]

Array = npt.NDArray[np.float64]

_MAP_HEADING = {2: 0.003, 3: 0.001}  # rad


class MonteCarloSettings(ParticleFilterSettings):
    """Everything a Monte Carlo localization may be told; the defaults run.

    Those of :class:`~factorloc.localization.particle_filter.ParticleFilterSettings`, and:

    Parameters
    ----------
    estimate : {"mean", "best", "mode"}
        What becomes the trajectory (:class:`~factorloc.localization.particle_estimates.ParticleEstimates`).
    start_position, start_heading : float
        Standard deviations of a start pose, m and rad; in space height, roll and pitch have a tenth of them.
    map_position, map_heading : float, optional
        Standard deviations of what the map itself is wrong by at any one place, m and rad (by default 0.02; 0.003 in
        the plane, 0.001 in space), added to every covariance reported.
    """

    estimate: Literal["mean", "best", "mode"] = "mode"
    start_position: float = Field(1.0, gt=0)
    start_heading: float = Field(float(np.radians(10.0)), gt=0)
    map_position: float = Field(0.02, ge=0)
    map_heading: float | None = Field(None, ge=0)


def localize_by_particles(
    model: SensorModel,
    scans: Sequence[Scan],
    odometry: npt.ArrayLike,
    start: npt.ArrayLike | PosePrior | Initialization,
    *,
    known: npt.ArrayLike | None = None,
    covariances: npt.ArrayLike | None = None,
    settings: MonteCarloSettings | None = None,
    motion_model: MotionModel | None = None,
    free_space: Initialization | None = None,
    progress: Callable[[int], None] | None = None,
    on_particles: Callable[[Particles], None] | None = None,
    seed: int = 0,
) -> Result:
    """Localize scans one after the other by weighted particles.

    Parameters
    ----------
    model : SensorModel
        Likelihood of scans in the map.
    scans : sequence of Scan
        N scans in order of driving.
    odometry : array_like, shape (N - 1, 3) or (N - 1, 4, 4)
        Motions of the body between scans.
    start : array_like, shape (3,) or (4, 4), PosePrior or Initialization
        Where the drive begins: a pose with the standard deviations of the settings, a prior of its own, or anything to
        draw poses from, :class:`~factorloc.localization.initialization.FreeSpace` if nobody knows.
    known : array_like of bool, shape (N - 1,), optional
        Which motions were measured.
    covariances : array_like, shape (N - 1, 3, 3) or (N - 1, 6, 6), optional
        Of the motions, in the tangent space of the body after each; those of the noise model by default.
    settings : MonteCarloSettings, optional
        All settings.
    motion_model : MotionModel, optional
        Of measured motions.
    free_space : Initialization, optional
        Where else the vehicle may be, if the belief does not explain its scans; without, it does not recover.
    progress : callable, optional
        Called with the number of scans done.
    on_particles : callable, optional
        Called with the weighted particles of each scan, for instance ``list.append``.
    seed : int
        Of all that is random.

    Returns
    -------
    Result
        Poses with covariances. The cost is the sum of ``-log`` mean weights, one for each scan in
        ``residuals["scan"]`` (0 for scans that were not used); ``residuals["particles"]`` holds their number.
        ``rejected`` counts what was left out and what was done about it.

    Raises
    ------
    MapError
        If scans, start and map differ in dimension, the start lies outside the map, or a likelihood is NaN.
    GeometryError
        If there is no scan, or not one motion, flag and covariance between each two.
    """
    settings = settings or MonteCarloSettings()
    dimension, n = model.grid.dimension, len(scans)
    if n == 0:
        raise GeometryError("scans: none given")
    for k, scan in enumerate(scans):
        if scan.dimension != dimension:
            raise MapError(f"scans: number {k} has {scan.dimension} dimensions, the map {dimension}; keep them apart")
    motions = group_of(dimension).as_poses(odometry, "odometry")
    if motions.shape != (n - 1, *((3,) if dimension == 2 else (4, 4))):
        raise GeometryError(f"odometry: shape {motions.shape}; expected {n - 1} motions between {n} scans")
    measured, of_motions = known_motions(known, n - 1), _checked(covariances, motions)
    began = time.perf_counter()
    particle_filter = ParticleFilter(
        model, _as_initialization(start, model, settings), settings=settings, motion_model=motion_model,
        free_space=free_space, seed=seed,
    )  # fmt: skip
    estimates: list[PoseEstimate] = []
    costs, sizes, account = np.zeros(n), np.zeros(n), Counter[str]()
    for k, scan in enumerate(scans):
        if k > 0:
            particle_filter.resample()
            of_motion = None if of_motions is None else of_motions[k - 1]
            particle_filter.propagate(motions[k - 1], covariance=of_motion, known=bool(measured[k - 1]))
        done = particle_filter.reweight(scan)
        estimates.append(getattr(particle_filter.estimate(), settings.estimate))
        costs[k], sizes[k] = 0.0 if done.excluded else -done.log_likelihood, len(particle_filter.particles)
        account.update(_left_out(scan, done))
        if on_particles:
            on_particles(particle_filter.particles)
        if progress:
            progress(k + 1)
    heading = _MAP_HEADING[dimension] if settings.map_heading is None else settings.map_heading
    floor = np.diag(position_heading(dimension, settings.map_position, heading) ** 2)
    trajectory = Trajectory(
        np.array([scan.stamp for scan in scans]),
        np.array([estimate.pose for estimate in estimates]),
        np.array([estimate.covariance for estimate in estimates]) + floor,
        world=model.grid.frame,
    )
    account["motions not measured"] = int((~measured).sum())
    account["resamplings"], account["recoveries"] = particle_filter.resamplings, particle_filter.recoveries
    return Result(
        trajectory,
        float(costs.sum()),
        (),
        StopReason.FILTERED,
        {"scan": costs, "particles": sizes},
        dict(account),
        time.perf_counter() - began,
    )


def _left_out(scan: Scan, done: Reweighting) -> dict[str, int]:
    return {
        "rays unused": len(scan) - done.rays,
        "scans without information": int(not done.informative),
        "scans no particle explains": int(done.excluded),
        "scans tempered": int(done.tempered),
    }


def _as_initialization(
    start: npt.ArrayLike | PosePrior | Initialization, model: SensorModel, settings: MonteCarloSettings
) -> Initialization:
    if isinstance(start, Initialization):
        return start
    if not isinstance(start, PosePrior):
        start = NormalStart.standing(start, settings.start_position, settings.start_heading).prior
    if start.dimension != model.grid.dimension or not model.grid.contains(start.position):
        where = ", ".join(f"{value:.2f}" for value in start.position)
        raise MapError(f"start: ({where}) m lies outside the map; give a pose within")
    return NormalStart(start)


def _checked(covariances: npt.ArrayLike | None, motions: Array) -> Array | None:
    """Covariances of motions, if there are any and they fit."""
    if covariances is None:
        return None
    array = np.asarray(covariances, np.float64)
    size = 3 if motions.ndim == 2 else 6
    if array.shape != (len(motions), size, size):
        raise GeometryError(f"covariances: shape {array.shape}; expected a {size} x {size} matrix for each motion")
    return array
