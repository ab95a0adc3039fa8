"""Interval tracking: feasible sets carried along by odometry with bounded errors, and intersected scan by scan."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.errors import GeometryError
from factorloc.localization.facade_scan import FacadeStep
from factorloc.localization.facade_settings import FacadeSettings
from factorloc.localization.facade_tracker import FacadeTracker, Finder
from factorloc.localization.wall_lines import WallLines
from factorloc.mapping.facade_points import FacadePoints
from factorloc.result import Bounds, Result, StopReason
from factorloc.trajectory import Trajectory

__all__ = ["FacadeTrack", "track_facades"]

Array = npt.NDArray[np.float64]


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
    find: Finder | None = None,
    progress: Callable[[int], None] | None = None,
) -> FacadeTrack:
    """Track a drive among facades.

    A set that is wider than one scan can be associated in is asked piece by piece. Carried along are the poses that are
    less probable too, in layers by what speaks against them; reported are those that hold nearly all the odds.

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
    find : callable, optional
        Finds the correspondences of a scan with the map from a start; :func:`find_correspondences` by default.
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
    tracker = FacadeTracker(walls, start, guess, settings, find)
    steps, poses, covariances, sets = [], [], [], []
    for k, points in enumerate(scans):
        if k:
            tracker.move(moves[k - 1], errors[k - 1])
        steps.append(tracker.localize(points))
        poses.append(tracker.belief.pose)
        covariances.append(tracker.belief.pose_covariance)
        sets.append(tracker.known)
        if progress:
            progress(k + 1)
    rejected = {"scans whose assumptions are violated": sum(step.feasible.violated for step in steps)}
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
