"""Relative pose error: estimated motions against true motions over a fixed step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from factorloc.errors import EvaluationError
from factorloc.evaluation.association import MAX_STAMP_DIFFERENCE, check_associated
from factorloc.evaluation.pose_errors import PoseErrors
from factorloc.geometry import se2, se3
from factorloc.trajectory import Trajectory

__all__ = ["RelativeErrors", "StepUnit", "relative_errors", "step_pairs"]

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]
StepUnit = Literal["frames", "m"]

_ROUNDING = 1e-9  # steps of exactly delta are met although sums of distances are rounded


@dataclass(frozen=True)
class RelativeErrors(PoseErrors):
    """Relative errors, one a pair of poses.

    Parameters
    ----------
    stamps : ndarray, shape (M,)
        True times of the second pose of each pair, s.
    T_truth_estimate : ndarray, shape (M, 3) or (M, 4, 4)
        Error of the motion: what is left after the true motion, in the true body frame of the second pose.
    pairs : ndarray of int, shape (M, 2)
        Rows of the two poses of each pair.
    delta : float
        Length of a step.
    unit : {"frames", "m"}
        What the step is measured in.
    """

    pairs: Rows
    delta: float
    unit: StepUnit


def relative_errors(
    estimate: Trajectory,
    truth: Trajectory,
    delta: float = 1,
    unit: StepUnit = "frames",
    *,
    all_pairs: bool = False,
    tolerance: float = 0.1,
    max_difference: float = MAX_STAMP_DIFFERENCE,
) -> RelativeErrors:
    """Compare the motions of associated trajectories (RPE; Sturm et al., IROS 2012).

    Parameters
    ----------
    estimate, truth : Trajectory
        Associated row by row. Their world frames may differ: a motion does not depend on them.
    delta, unit, all_pairs, tolerance
        Which poses make a pair, see :func:`step_pairs`; metres are measured along the true path.
    max_difference : float
        Largest difference of the stamps of a row, s.

    Returns
    -------
    RelativeErrors
        Error of each motion, ``inverse(T_i_j true) * T_i_j estimated``.

    Raises
    ------
    EvaluationError
        If dimensions, body frames, lengths or stamps disagree, or no pair is that far apart.
    """
    check_associated(estimate, truth, max_difference, same_world=False)
    pairs = step_pairs(truth, delta, unit, all_pairs=all_pairs, tolerance=tolerance)
    group = se2 if truth.dimension == 2 else se3
    i, j = pairs.T
    motion, true_motion = (group.between(run.poses[i], run.poses[j]) for run in (estimate, truth))
    return RelativeErrors(truth.stamps[j], group.between(true_motion, motion), pairs, delta, unit)


def step_pairs(
    trajectory: Trajectory,
    delta: float = 1,
    unit: StepUnit = "frames",
    *,
    all_pairs: bool = False,
    tolerance: float = 0.1,
) -> Rows:
    """Pairs of poses that are one step apart.

    Parameters
    ----------
    trajectory : Trajectory
        The path, in the order of its rows.
    delta : float
        Length of a step; a whole number of frames, or metres along the path.
    unit : {"frames", "m"}
        What the step is measured in.
    all_pairs : bool
        False: steps follow each other, each begins where the last one ended; one in metres ends at the first pose at
        least ``delta`` farther. True: a step begins at every pose; one in metres ends at the pose nearest to
        ``delta`` farther.
    tolerance : float
        With ``all_pairs`` in metres: largest deviation from ``delta``, as a fraction of it; other pairs are left out.

    Returns
    -------
    ndarray of int, shape (M, 2)
        First and second row of each pair.

    Raises
    ------
    EvaluationError
        If delta or unit is invalid or no pair is that far apart.
    """
    if not delta > 0 or (unit == "frames" and delta != int(delta)):
        raise EvaluationError(f"delta: {delta} {unit}; expected a positive step, and a whole number of frames")
    if unit == "frames":
        step = int(delta)
        first = np.arange(0, len(trajectory) - step, 1 if all_pairs else step)
        pairs = np.column_stack([first, first + step])
    elif unit == "m":
        steps = np.linalg.norm(np.diff(trajectory.positions, axis=0), axis=1)
        path = np.concatenate([[0.0], np.cumsum(steps)])
        pairs = _every_step(path, delta, tolerance) if all_pairs else _steps_in_turn(path, delta)
    else:
        raise EvaluationError(f"unit: '{unit}'; expected 'frames' or 'm'")
    if len(pairs) == 0:
        raise EvaluationError(
            f"delta: no two poses are {delta:g} {unit} apart; the trajectory has {len(trajectory)} poses "
            f"and is {trajectory.length:.3g} m long"
        )
    return pairs.astype(np.int64)


def _steps_in_turn(path: Array, delta: float) -> Rows:
    ends = [0]
    while (row := int(np.searchsorted(path, path[ends[-1]] + delta * (1 - _ROUNDING)))) < path.size:
        ends.append(row)
    return np.column_stack([ends[:-1], ends[1:]])


def _every_step(path: Array, delta: float, tolerance: float) -> Rows:
    first = np.arange(path.size - 1)
    target = path[:-1] + delta
    beyond = np.minimum(np.searchsorted(path, target), path.size - 1)
    # The first of several poses at the same place; a vehicle that waits does not lengthen the step.
    before = np.maximum(np.searchsorted(path, path[np.maximum(beyond - 1, 0)]), first + 1)
    nearer = np.abs(path[before] - target) <= np.abs(path[beyond] - target)
    second = np.where(nearer, before, beyond)
    keep = np.abs(path[second] - target) <= tolerance * delta * (1 + _ROUNDING)
    return np.column_stack([first[keep], second[keep]])
