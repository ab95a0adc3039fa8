"""Association: which pose of the estimate belongs to which pose of the truth."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.errors import EvaluationError
from factorloc.trajectory import Trajectory

__all__ = ["MAX_STAMP_DIFFERENCE", "Association", "associate", "check_associated"]

MAX_STAMP_DIFFERENCE = 0.01
"""Stamps of the same instant differ by at most this, s (evo's default)."""

_log = logging.getLogger(__name__)

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Association:
    """Two trajectories brought into step: row k of one was at the same time as row k of the other.

    Parameters
    ----------
    estimate, truth : Trajectory
        The poses that found a partner, in the order of the estimate.
    unmatched_estimate, unmatched_truth : int
        How many poses of each found none and are left out.
    """

    estimate: Trajectory
    truth: Trajectory
    unmatched_estimate: int
    unmatched_truth: int

    def __len__(self) -> int:
        return len(self.estimate)


def associate(estimate: Trajectory, truth: Trajectory, max_difference: float = MAX_STAMP_DIFFERENCE) -> Association:
    """Pair poses that are each other's nearest in time; every pose is used once at most.

    Stamps need not be sorted. Where both trajectories repeat a stamp, the repetitions are paired in order.

    Parameters
    ----------
    estimate, truth : Trajectory
        What to match; either may be longer.
    max_difference : float
        Largest difference of stamps in a pair, s.

    Returns
    -------
    Association
        The matched rows, and the counts of those left out.

    Raises
    ------
    EvaluationError
        If nothing matches.
    """
    if not max_difference >= 0:
        raise EvaluationError(f"max_difference: {max_difference}; expected a time in seconds, zero or more")
    rows = _mutually_nearest(estimate.stamps, truth.stamps, max_difference)
    if rows.size == 0:
        raise EvaluationError(
            f"no overlap: no stamp of the estimate ({_span(estimate)}) is within {max_difference:g} s "
            f"of one of the truth ({_span(truth)}); are the clocks the same?"
        )
    result = Association(
        estimate=estimate.select(rows[:, 0]),
        truth=truth.select(rows[:, 1]),
        unmatched_estimate=len(estimate) - len(rows),
        unmatched_truth=len(truth) - len(rows),
    )
    _log.info(
        "associated %d poses; without partner: %d of the estimate, %d of the truth",
        len(result),
        result.unmatched_estimate,
        result.unmatched_truth,
    )
    return result


def check_associated(
    estimate: Trajectory,
    truth: Trajectory,
    max_difference: float = MAX_STAMP_DIFFERENCE,
    *,
    same_world: bool = True,
) -> None:
    """Make sure that two trajectories can be compared row by row.

    Parameters
    ----------
    estimate, truth : Trajectory
        What is to be compared.
    max_difference : float
        Largest difference of the stamps of a row, s.
    same_world : bool
        Whether their poses have to be in the same world frame.

    Raises
    ------
    EvaluationError
        If dimension, frames, number or stamps of the poses disagree, or there are none.
    """
    if estimate.dimension != truth.dimension:
        raise EvaluationError(
            f"dimension: the estimate is {estimate.dimension}-D and the truth {truth.dimension}-D; "
            "bring both to the same with to_2d() or to_3d()"
        )
    if estimate.body != truth.body:
        raise EvaluationError(
            f"body: the estimate tracks '{estimate.body}' and the truth '{truth.body}'; "
            "compose one with the transform between them"
        )
    if same_world and estimate.world != truth.world:
        raise EvaluationError(
            f"world: the estimate is in frame '{estimate.world}' and the truth in '{truth.world}'; "
            "transform one or align them"
        )
    if len(estimate) != len(truth):
        raise EvaluationError(f"length: {len(estimate)} poses against {len(truth)} true ones; associate() them first")
    if len(estimate) == 0:
        raise EvaluationError("length: both trajectories are empty; nothing can be compared")
    apart = np.abs(estimate.stamps - truth.stamps)
    # Stamps of large epochs are rounded: accept a difference that is only larger by rounding.
    if apart.max() > max_difference + 2 * np.spacing(np.abs(truth.stamps).max()):
        row = int(apart.argmax())
        raise EvaluationError(
            f"stamps: row {row} of estimate and truth are {apart[row]:.3g} s apart (limit {max_difference:g} s); "
            "associate() them first"
        )


def _span(trajectory: Trajectory) -> str:
    if len(trajectory) == 0:
        return "empty"
    return f"{trajectory.stamps.min():.3f} to {trajectory.stamps.max():.3f} s"


def _mutually_nearest(a: Array, b: Array, max_difference: float) -> Rows:
    """Rows ``(i, j)``, sorted by i, where a[i] and b[j] are nearest to each other; shape (M, 2)."""
    if a.size == 0 or b.size == 0:
        return np.zeros((0, 2), np.int64)
    forth, back = _nearest(a, b), _nearest(b, a)
    i = np.arange(a.size)
    keep = (back[forth] == i) & (np.abs(a - b[forth]) <= max_difference)
    return np.column_stack([i[keep], forth[keep]])


def _nearest(wanted: Array, offered: Array) -> Rows:
    """Index of the offered stamp nearest to each wanted one; the n-th of equal ones to the n-th of equal ones."""
    order = np.argsort(offered, kind="stable")
    values, first, count = np.unique(offered[order], return_index=True, return_counts=True)
    right = np.clip(np.searchsorted(values, wanted), 1, max(values.size - 1, 1))
    right = np.minimum(right, values.size - 1)
    left = np.maximum(right - 1, 0)
    nearest = np.where(wanted - values[left] <= values[right] - wanted, left, right)
    return np.asarray(order[first[nearest] + np.minimum(_repetition(wanted), count[nearest] - 1)])


def _repetition(stamps: Array) -> Rows:
    """How many equal stamps come before each one."""
    order = np.argsort(stamps, kind="stable")
    _, first, count = np.unique(stamps[order], return_index=True, return_counts=True)
    result = np.empty(stamps.size, np.int64)
    result[order] = np.arange(stamps.size) - np.repeat(first, count)
    return result
