"""Candidates: the jointly best choice among a few poses per scan.

The cost of a scan on the finest map has many small minima, and one step of a whole graph moves all poses or none. So a
smoothed graph can end with single poses in poorer minima than the ones they were tracked to. Along a chain the best
combination of the alternatives is found exactly, by dynamic programming (Viterbi).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from factorloc.factors.odometry import OdometryNoise, motion_covariances
from factorloc.factors.prior import PosePrior
from factorloc.factors.scan_term import ScanTerm
from factorloc.geometry import group_of

__all__ = ["best_sequence", "choose_poses"]

Array = npt.NDArray[np.float64]


def best_sequence(unary: npt.ArrayLike, pairwise: npt.ArrayLike) -> npt.NDArray[np.int64]:
    """Find the sequence of states with the least sum of costs.

    Parameters
    ----------
    unary : array_like, shape (N, C)
        Cost of each of C states at each of N places.
    pairwise : array_like, shape (N - 1, C, C)
        Cost of going from a state at one place to a state at the next.

    Returns
    -------
    ndarray of int64, shape (N,)
        State at each place.
    """
    states, moves = np.asarray(unary, np.float64), np.asarray(pairwise, np.float64)
    n = len(states)
    best, came_from = states[0], np.zeros(states.shape, np.int64)
    for k in range(1, n):
        totals = best[:, None] + moves[k - 1]
        came_from[k] = totals.argmin(0)
        best = totals.min(0) + states[k]
    path = np.empty(n, np.int64)
    path[-1] = best.argmin()
    for k in range(n - 1, 0, -1):
        path[k - 1] = came_from[k, path[k]]
    return path


def choose_poses(
    candidates: Sequence[Array],
    term: ScanTerm,
    motions: Array,
    noise: OdometryNoise,
    known: npt.NDArray[np.bool_],
    prior: PosePrior | None,
    covariances: Array | None = None,
) -> Array:
    """Take for each scan one of its candidate poses, so that the cost of the whole graph is least.

    Parameters
    ----------
    candidates : sequence of ndarray, each of shape (N, 3) or (N, 4, 4)
        Alternatives for all scans.
    term : ScanTerm
        Measurement model; its finest level counts.
    motions : ndarray, shape (N - 1, 3) or (N - 1, 4, 4)
        Odometry.
    noise : OdometryNoise
        Its model.
    known : ndarray of bool, shape (N - 1,)
        Which motions were measured.
    prior : PosePrior or None
        What is known of the first pose.
    covariances : ndarray, optional
        Of the motions; those of the noise model by default.

    Returns
    -------
    ndarray, shape (N, 3) or (N, 4, 4)
        The chosen poses.
    """
    group = group_of(2 if motions.ndim == 2 else 3)
    poses = np.stack(candidates, 1)
    unary = np.stack([term.cost(candidate, -1) for candidate in candidates], 1)
    if prior is not None:
        offset = group.log(group.between(prior.pose, poses[0]))
        unary[0] += 0.5 * np.einsum("ci,ij,cj->c", offset, prior.information, offset)
    steps = group.between(poses[:-1, :, None], poses[1:, None, :])
    errors = group.log(group.between(motions[:, None, None], steps))
    information = np.zeros((len(motions), errors.shape[-1], errors.shape[-1]))
    information[known] = np.linalg.inv(motion_covariances(motions, noise, covariances)[known])
    whitened = np.sqrt(np.einsum("nabi,nij,nabj->nab", errors, information, errors))
    huber = np.where(whitened <= noise.huber, 0.5 * whitened**2, noise.huber * (whitened - 0.5 * noise.huber))
    chosen = best_sequence(unary, np.where(known[:, None, None], huber, 0.0))
    return np.asarray(poses[np.arange(len(poses)), chosen])
