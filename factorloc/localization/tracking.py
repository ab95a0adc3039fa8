"""Tracking: predict by odometry, register the next scan, go on."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc.config import Block
from factorloc.errors import GeometryError
from factorloc.factors.grid_scan_term import GridScanTerm
from factorloc.factors.odometry import OdometryNoise, known_motions, motion_covariances
from factorloc.factors.prior import PosePrior
from factorloc.factors.spatial_scan_term import SpatialScanTerm
from factorloc.geometry import group_of, position_heading
from factorloc.localization.registration import Registration, RegistrationSettings, register_many
from factorloc.result import Result, StopReason
from factorloc.trajectory import Trajectory

__all__ = ["TrackingSettings", "find_start", "track"]

Array = npt.NDArray[np.float64]


class TrackingSettings(Block):
    """How scans are followed.

    Parameters
    ----------
    start_grid : int
        Start poses a dimension, spread over two standard deviations of the prior, from which the first scan is
        registered on all levels.
    track_blur : float
        Coarsest level at which a predicted scan starts, m. Every finer level starts from the prediction as well, and
        the lowest cost is taken: a coarse start finds its way back, a fine one is not led astray.
    lost_position, lost_heading : float
        Standard deviations of a motion nobody measured, m and rad.
    """

    start_grid: int = Field(3, ge=1, le=9)
    track_blur: float = Field(0.5, gt=0)
    lost_position: float = Field(1.0, gt=0)
    lost_heading: float = Field(0.35, gt=0)


def find_start(
    term: GridScanTerm | SpatialScanTerm,
    prior: PosePrior,
    scan: int = 0,
    *,
    settings: TrackingSettings | None = None,
    registration: RegistrationSettings | None = None,
) -> Registration:
    """Register a scan from poses spread over its prior, on all levels.

    Parameters
    ----------
    term : GridScanTerm or SpatialScanTerm
        Measurement model.
    prior : PosePrior
        What is known of the pose.
    scan : int
        Which scan of the term.
    settings : TrackingSettings, optional
        How many starts.
    registration : RegistrationSettings, optional
        Steps and tolerances.

    Returns
    -------
    Registration
        One row a start; its :attr:`~Registration.best` is the answer.
    """
    settings = settings or TrackingSettings()
    offsets = np.linspace(-1, 1, settings.start_grid) if settings.start_grid > 1 else np.zeros(1)
    group = group_of(prior.dimension)
    spread = np.array(list(itertools.product(offsets, repeat=3)))
    if prior.dimension == 3:  # a vehicle stands on its wheels: starts are spread over x, y and heading
        planar, spread = spread, np.zeros((len(spread), 6))
        spread[:, [3, 4, 2]] = planar
    # Columns of the square root of the covariance are the prior's own axes.
    root = np.linalg.cholesky(prior.covariance)
    starts = group.compose(prior.pose, group.exp(spread @ root.T))
    return register_many(term, starts, np.full(len(starts), scan), prior=prior, settings=registration)


def track(
    term: GridScanTerm | SpatialScanTerm,
    odometry: npt.ArrayLike,
    prior: PosePrior,
    *,
    known: npt.ArrayLike | None = None,
    covariances: npt.ArrayLike | None = None,
    stamps: npt.ArrayLike | None = None,
    frame: str = "map",
    noise: OdometryNoise | None = None,
    settings: TrackingSettings | None = None,
    registration: RegistrationSettings | None = None,
    progress: Callable[[int], None] | None = None,
) -> Result:
    """Localize scans one after the other.

    Parameters
    ----------
    term : GridScanTerm or SpatialScanTerm
        Measurement model of all N scans.
    odometry : array_like, shape (N - 1, 3) or (N - 1, 4, 4)
        Motions of the body between scans.
    prior : PosePrior
        What is known of the first pose.
    known : array_like of bool, shape (N - 1,), optional
        Which motions were measured.
    covariances : array_like, shape (N - 1, 3, 3) or (N - 1, 6, 6), optional
        Of the motions; those of the noise model by default.
    stamps : array_like, shape (N,), optional
        Times; scan numbers by default.
    frame : str
        Name of the map's frame.
    noise : OdometryNoise, optional
        Noise of the motions.
    settings : TrackingSettings, optional
        Starts of each registration.
    registration : RegistrationSettings, optional
        Steps and tolerances.
    progress : callable, optional
        Called with the number of scans done.

    Returns
    -------
    Result
        Poses with filtered covariances; ``residuals["scan"]`` holds the cost of each registration.

    Raises
    ------
    GeometryError
        If there is not one motion, and one flag, between each pair of scans.
    """
    settings, noise = settings or TrackingSettings(), noise or OdometryNoise()
    group = group_of(prior.dimension)
    motions = group.as_poses(odometry, "odometry")
    n = term.scans
    if motions.shape != (n - 1, *prior.pose.shape):
        raise GeometryError(f"odometry: shape {motions.shape}; expected {n - 1} motions between {n} scans")
    measured = known_motions(known, n - 1)
    lost = np.diag(position_heading(prior.dimension, settings.lost_position, settings.lost_heading) ** 2)
    of_motions = np.where(measured[:, None, None], motion_covariances(motions, noise, covariances), lost)
    entries = [i for i, blur in enumerate(term.blurs) if blur <= settings.track_blur] or [len(term.blurs) - 1]

    began = time.perf_counter()
    poses, beliefs, costs = np.empty((n, *prior.pose.shape)), np.empty((n, *prior.covariance.shape)), np.empty(n)
    unconverged = 0
    for k in range(n):
        if k == 0 or not measured[k - 1]:
            found = find_start(term, prior, k, settings=settings, registration=registration)
        else:
            found = _enter(term, prior, k, entries, registration)
        best = found.best
        poses[k], costs[k] = found.poses[best], found.costs[best]
        beliefs[k] = np.linalg.inv(found.hessians[best] + prior.information)
        unconverged += not found.converged[best]
        if k < n - 1:
            carried = group.adjoint(group.inverse(motions[k]))
            covariance = carried @ beliefs[k] @ carried.T + of_motions[k]
            prior = PosePrior(group.compose(poses[k], motions[k]), (covariance + covariance.T) / 2)
        if progress:
            progress(k + 1)
    times = np.arange(n, dtype=np.float64) if stamps is None else np.asarray(stamps, np.float64)
    return Result(
        Trajectory(times, poses, beliefs, world=frame),
        float(costs.sum()),
        (),
        StopReason.SEQUENTIAL,
        {"scan": costs},
        {"registrations not converged": unconverged, "motions not measured": int((~measured).sum())},
        time.perf_counter() - began,
    )


def _enter(
    term: GridScanTerm | SpatialScanTerm,
    prior: PosePrior,
    scan: int,
    entries: list[int],
    settings: RegistrationSettings | None,
) -> Registration:
    """Register from the prediction, entering the pyramid at each of some levels."""
    last = len(term.blurs)
    found = [
        register_many(term, prior.pose[None], [scan], levels=range(entry, last), prior=prior, settings=settings)
        for entry in entries
    ]
    return Registration(
        *(np.concatenate([getattr(r, name) for r in found]) for name in Registration.__dataclass_fields__)
    )
