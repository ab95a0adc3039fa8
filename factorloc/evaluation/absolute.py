"""Absolute pose error: each estimated pose against the true one of the same time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.evaluation.alignment import align as fit_alignment
from factorloc.evaluation.alignment import transform_trajectory
from factorloc.evaluation.association import MAX_STAMP_DIFFERENCE, check_associated
from factorloc.evaluation.pose_errors import PoseErrors
from factorloc.geometry import se2, se3
from factorloc.trajectory import Trajectory

__all__ = ["AbsoluteErrors", "absolute_errors"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class AbsoluteErrors(PoseErrors):
    """Absolute errors, one a pose.

    Parameters
    ----------
    stamps : ndarray, shape (N,)
        Times of the truth, s.
    T_truth_estimate : ndarray, shape (N, 3) or (N, 4, 4)
        Error poses.
    T_world_estimate : ndarray, shape (3,) or (4, 4), optional
        The alignment that was applied to the estimate; None without alignment.
    """

    T_world_estimate: Array | None = None


def absolute_errors(
    estimate: Trajectory,
    truth: Trajectory,
    align: bool = False,
    max_difference: float = MAX_STAMP_DIFFERENCE,
) -> AbsoluteErrors:
    """Compare associated trajectories pose by pose (APE; Sturm et al., IROS 2012).

    Parameters
    ----------
    estimate, truth : Trajectory
        Associated row by row, see :func:`factorloc.evaluation.association.associate`.
    align : bool
        Whether to lay the estimate onto the truth first, by a rigid motion without scale. Localization in a map is
        judged without; odometry, whose world frame is its own, with.
    max_difference : float
        Largest difference of the stamps of a row, s.

    Returns
    -------
    AbsoluteErrors
        Errors in the body frame of the truth.

    Raises
    ------
    EvaluationError
        If dimensions, frames, lengths or stamps disagree, or an alignment is not determined. World frames may differ
        where ``align`` is set.
    """
    check_associated(estimate, truth, max_difference, same_world=not align)
    T_world_estimate = None
    if align:
        T_world_estimate = fit_alignment(estimate, truth)
        estimate = transform_trajectory(T_world_estimate, estimate, truth.world)
    group = se2 if truth.dimension == 2 else se3
    return AbsoluteErrors(truth.stamps, group.between(truth.poses, estimate.poses), T_world_estimate)
