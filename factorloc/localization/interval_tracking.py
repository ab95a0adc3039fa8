"""Interval tracking: feasible sets carried along by odometry with bounded errors, and intersected scan by scan."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc.config import Block
from factorloc.errors import GeometryError
from factorloc.factors.prior import PosePrior
from factorloc.geometry import se2
from factorloc.localization.bounded_least_squares import BoundedEstimate, LeastSquaresSettings, estimate_in_bounds
from factorloc.localization.bounded_motion import OdometryBounds, propagate, widen
from factorloc.localization.correspondence import Correspondences
from factorloc.localization.correspondences import WIDEST_START, CorrespondenceSettings, find_correspondences
from factorloc.localization.feasible_set import (
    FeasibleSet,
    FeasibleSettings,
    hull_of,
    intersect_correspondences,
)
from factorloc.localization.wall_lines import WallLines
from factorloc.mapping.facade_points import FacadePoints, ReductionSettings, ScanErrors
from factorloc.result import Bounds, Result, StopReason
from factorloc.trajectory import Trajectory

__all__ = ["FacadeDriveSettings", "FacadeSettings", "FacadeStep", "FacadeTrack", "localize_scan", "track_facades"]

Array = npt.NDArray[np.float64]


class FacadeSettings(Block):
    """Everything a localization among facades may be told; the defaults run.

    Parameters
    ----------
    correspondences : CorrespondenceSettings
        Which lines are believed.
    feasible : FeasibleSettings
        How they are intersected.
    least_squares : LeastSquaresSettings
        What is likely within the bounds.
    odometry : OdometryBounds
        Greatest errors of motions.
    margin_position, margin_heading : float
        A tracked set is widened by so much before facades are associated (m, rad): lines at its border are to be seen
        whole. The result is intersected with the set itself.
    forgetting_position, forgetting_heading : float
        A tracked set is widened by so much before every scan (m, rad): bounds of a scan that broke the assumptions
        unnoticed wear off. Zero trusts every scan for good.
    recovery_position, recovery_heading : float
        After a scan that violates the assumptions it is widened by so much (m, rad): what violates them may be the set.
    prior_position, prior_heading : float
        Standard deviations of the last estimate carried along, m and rad; they hold what facades do not, and average
        the shifts of the buildings passed. About those of a motion between two scans.
    """

    correspondences: CorrespondenceSettings = CorrespondenceSettings()
    feasible: FeasibleSettings = FeasibleSettings()
    least_squares: LeastSquaresSettings = LeastSquaresSettings()
    odometry: OdometryBounds = OdometryBounds()
    margin_position: float = Field(0.5, ge=0)
    margin_heading: float = Field(math.radians(0.5), ge=0)
    forgetting_position: float = Field(0.05, ge=0)
    forgetting_heading: float = Field(math.radians(0.05), ge=0)
    recovery_position: float = Field(2.0, ge=0)
    recovery_heading: float = Field(math.radians(1.0), ge=0)
    prior_position: float = Field(0.08, gt=0)
    prior_heading: float = Field(0.005, gt=0)


class FacadeDriveSettings(Block):
    """From raw scans to poses among facades.

    Parameters
    ----------
    errors : ScanErrors
        Bounds of the points.
    reduction : ReductionSettings
        What of a scan is taken for a facade.
    localization : FacadeSettings
        Everything else.
    """

    errors: ScanErrors = ScanErrors()
    reduction: ReductionSettings = ReductionSettings()
    localization: FacadeSettings = FacadeSettings()


@dataclass(frozen=True, eq=False)
class FacadeStep:
    """What one scan gave.

    Parameters
    ----------
    correspondences : Correspondences
        Lines and their facades.
    feasible : FeasibleSet
        What they leave of the start; empty where assumptions are violated.
    estimate : BoundedEstimate or None
        The most likely pose in it; None if it is empty.
    guess : ndarray, shape (3,), or None
        Where the search for it began; None if the set is empty.
    prior : PosePrior or None
        What else was known.
    """

    correspondences: Correspondences
    feasible: FeasibleSet
    estimate: BoundedEstimate | None
    guess: Array | None = None
    prior: PosePrior | None = None


@dataclass(frozen=True, eq=False)
class FacadeTrack:
    """A tracked drive.

    Parameters
    ----------
    result : Result
        Poses with covariances and bounds. Where a scan violates the assumptions, its pose and its bounds are those
        carried along by odometry.
    steps : tuple of FacadeStep
        One a scan.
    """

    result: Result
    steps: tuple[FacadeStep, ...]

    @property
    def violated(self) -> npt.NDArray[np.bool_]:
        """Scans that violate the assumptions, shape (N,)."""
        return np.array([step.feasible.violated for step in self.steps], np.bool_)


def localize_scan(
    points: FacadePoints,
    walls: WallLines,
    start: Bounds,
    guess: npt.ArrayLike | None = None,
    *,
    within: Bounds | Sequence[Bounds] | None = None,
    prior: PosePrior | None = None,
    settings: FacadeSettings | None = None,
) -> FacadeStep:
    """Localize one scan among facades: feasible set, and the most likely pose in it.

    Parameters
    ----------
    points : FacadePoints
        The scan.
    walls : WallLines
        The map.
    start : Bounds
        Where the body may be when facades are associated.
    guess : array_like, shape (3,), optional
        Where the search for the most likely pose begins; the middle of the feasible set by default.
    within : Bounds or sequence of Bounds, optional
        Where the body may be, as a set or as slices of one; the start by default.
    prior : PosePrior, optional
        What else is known.
    settings : FacadeSettings, optional
        All settings.
    """
    settings = settings or FacadeSettings()
    correspondences = find_correspondences(points, walls, start, settings.correspondences)
    feasible = intersect_correspondences(correspondences.found, walls, within or start, settings.feasible)
    if feasible.violated:
        return FacadeStep(correspondences, feasible, None, None, prior)
    begin = middle_of(feasible.bounds) if guess is None else np.asarray(guess, np.float64)
    estimate = estimate_in_bounds(
        points, correspondences, walls, begin, feasible.bounds,
        conflicts=feasible.conflicts, prior=prior, settings=settings.least_squares,
    )  # fmt: skip
    return FacadeStep(correspondences, feasible, estimate, begin, prior)


def middle_of(bounds: Bounds) -> Array:
    """Pose in the middle of a feasible set: of its largest polygon, and of the headings."""
    polygon = max(bounds.polygons, key=lambda corners: float(np.ptp(corners, axis=0).prod()))
    return np.array([*polygon.mean(0), 0.5 * (bounds.orientation[0] + bounds.orientation[1])])


def track_facades(
    scans: Sequence[FacadePoints],
    stamps: npt.ArrayLike,
    motions: npt.ArrayLike,
    walls: WallLines,
    start: Bounds,
    *,
    guess: npt.ArrayLike | None = None,
    motion_errors: npt.ArrayLike | None = None,
    settings: FacadeSettings | None = None,
    progress: Callable[[int], None] | None = None,
) -> FacadeTrack:
    """Track a drive among facades.

    Where headings span more than 60 degrees, no facade is asked for any more, and the set is only carried along.

    Parameters
    ----------
    scans : sequence of FacadePoints
        N scans in order of driving.
    stamps : array_like, shape (N,)
        Their times, s.
    motions : array_like, shape (N - 1, 3)
        Motions ``T_before_after`` of the body between them, with errors below the settings' odometry bounds.
    walls : WallLines
        The map.
    start : Bounds
        Where the drive begins.
    guess : array_like, shape (3,), optional
        And where the search for the first pose does.
    motion_errors : array_like, shape (N - 1, 3), optional
        Greatest errors of the motions, m and rad; those of the settings by default.
    settings : FacadeSettings, optional
        All settings.
    progress : callable, optional
        Called with the number of scans done.

    Raises
    ------
    GeometryError
        If there is no scan, or not one motion between each two.
    """
    settings, began = settings or FacadeSettings(), time.perf_counter()
    count = len(scans)
    moves = np.asarray(motions, np.float64).reshape(-1, 3)
    if count == 0 or len(moves) != count - 1:
        raise GeometryError(f"motions: {len(moves)} for {count} scans; give one between each two")
    errors = np.reshape([settings.odometry.errors(move) for move in moves], (-1, 3))
    if motion_errors is not None:
        errors = np.asarray(motion_errors, np.float64)
        if errors.shape != moves.shape:
            raise GeometryError(f"motion_errors: shape {errors.shape}; expected {moves.shape}, as the motions")
    slices: tuple[Bounds, ...] = (start,)
    known, pose = start, None if guess is None else np.asarray(guess, np.float64)
    covariance = np.diag([settings.prior_position**2] * 2 + [settings.prior_heading**2])
    steps, poses, covariances, sets = [], [], [], []
    for k, points in enumerate(scans):
        prior = None
        if k:
            slices = tuple(
                widen(
                    propagate(one, moves[k - 1], errors[k - 1]),
                    settings.forgetting_position,
                    settings.forgetting_heading,
                )
                for one in slices
            )
            known = hull_of(slices)
            if pose is not None:
                pose = se2.compose(pose, moves[k - 1])
                prior = PosePrior(pose, covariance)
        around = widen(known, settings.margin_position, settings.margin_heading) if k else known
        if around.orientation[1] - around.orientation[0] > WIDEST_START:
            nothing = Correspondences((), np.empty(0, np.int64), np.empty((0, len(points)), np.bool_), {})
            step = FacadeStep(nothing, FeasibleSet(known, slices, (), 0), None, None, prior)
        else:
            step = localize_scan(points, walls, around, pose, within=slices, prior=prior, settings=settings)
        if step.estimate is not None:
            slices, known, pose = step.feasible.slices, step.feasible.bounds, step.estimate.pose
        elif step.feasible.violated:
            slices = tuple(widen(one, settings.recovery_position, settings.recovery_heading) for one in slices)
            known = hull_of(slices)
        pose = known.nearest(middle_of(known) if pose is None else pose)
        steps.append(step)
        poses.append(pose)
        covariances.append(covariance if step.estimate is None else _limited(step.estimate.covariance))
        sets.append(known)
        if progress:
            progress(k + 1)
    violated = sum(step.feasible.violated for step in steps)
    rejected = {"scans whose assumptions are violated": violated}
    for step in steps:
        for reason, number in step.correspondences.rejected.items():
            name = f"facades {reason}"
            rejected[name] = rejected.get(name, 0) + number
    trajectory = Trajectory(np.asarray(stamps, np.float64), np.array(poses), np.array(covariances))
    costs = np.array([0.0 if step.estimate is None else step.estimate.cost for step in steps])
    result = Result(
        trajectory, float(costs.sum()), (), StopReason.INTERSECTED, {"scan": costs}, rejected,
        time.perf_counter() - began, tuple(sets),
    )  # fmt: skip
    return FacadeTrack(result, tuple(steps))


def _limited(covariance: Array) -> Array:
    """Covariances of poses that nothing determines are large, not infinite: formats and plots want numbers."""
    return np.asarray(0.5 * (covariance + covariance.T))
