"""Alignment: the rigid motion that lays an estimated path onto the true one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from factorloc.errors import EvaluationError
from factorloc.evaluation.association import check_associated
from factorloc.geometry import se2, se3
from factorloc.trajectory import Trajectory

__all__ = ["align", "transform_trajectory"]

Array = npt.NDArray[np.float64]

_DEGENERATE = 1e-12  # relative spread below which a cross-covariance says nothing about the rotation


def align(estimate: Trajectory, truth: Trajectory) -> Array:
    """Fit the rigid motion, without scale, that minimizes the squared distances of the positions.

    The closed form of Umeyama (PAMI 1991, eq. 40 to 42, with c = 1): SE(2) for planar trajectories, SE(3) for spatial.

    Parameters
    ----------
    estimate, truth : Trajectory
        Associated row by row; headings do not count. Their world frames may differ.

    Returns
    -------
    ndarray, shape (3,) or (4, 4)
        Pose of the estimate's world in the truth's world: ``compose(T, estimate.poses)`` lies in the truth's.

    Raises
    ------
    EvaluationError
        If lengths, dimensions or body frames disagree, or the positions do not determine a rotation: all of them on
        one spot, or in space on one line.
    """
    check_associated(estimate, truth, np.inf, same_world=False)
    source, target = estimate.positions, truth.positions
    source_mean, target_mean = source.mean(0), target.mean(0)
    a, b = source - source_mean, target - target_mean
    cross = b.T @ a
    # What the cross-covariance of similar paths amounts to: the yardstick for what is numerically zero.
    spread = float(np.linalg.norm(a) * np.linalg.norm(b))
    if (
        min(np.linalg.norm(a) / (1 + np.abs(source).max()), np.linalg.norm(b) / (1 + np.abs(target).max()))
        < _DEGENERATE
    ):
        raise EvaluationError("alignment: all positions are on one spot; the vehicle has to move")
    return (
        _planar(cross, spread, source_mean, target_mean)
        if estimate.dimension == 2
        else _spatial(cross, spread, source_mean, target_mean)
    )


def transform_trajectory(T_new_old: Array, trajectory: Trajectory, world: str) -> Trajectory:
    """Express a trajectory in another world frame.

    Parameters
    ----------
    T_new_old : ndarray, shape (3,) or (4, 4)
        Pose of the trajectory's world in the new one.
    trajectory : Trajectory
        What to move. Covariances belong to the body's tangent space and stay as they are.
    world : str
        Name of the new world frame.

    Returns
    -------
    Trajectory
        Poses ``T_new_old * T_old_body``.
    """
    group = se2 if trajectory.dimension == 2 else se3
    return replace(trajectory, poses=group.compose(T_new_old, trajectory.poses), world=world)


def _planar(cross: Array, spread: float, source_mean: Array, target_mean: Array) -> Array:
    sine, cosine = cross[1, 0] - cross[0, 1], cross[0, 0] + cross[1, 1]
    if np.hypot(sine, cosine) <= _DEGENERATE * spread:
        raise EvaluationError("alignment: the two paths are unrelated; no rotation fits better than another")
    theta = np.arctan2(sine, cosine)
    return np.append(target_mean - se2.rotate(theta, source_mean), theta)


def _spatial(cross: Array, spread: float, source_mean: Array, target_mean: Array) -> Array:
    u, singular, vt = np.linalg.svd(cross)
    if singular[1] <= _DEGENERATE * spread:
        raise EvaluationError("alignment: the positions lie on one line; the rotation about it is not determined")
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    result = se3.identity()
    result[:3, :3] = u @ flip @ vt
    result[:3, 3] = target_mean - result[:3, :3] @ source_mean
    return result
