"""Consensus with odometry: whether landmarks that agree with each other agree with the way that was driven.

A row of poles that was moved as a whole fits the map as well as it did before, at a wrong pose: no loss that looks at
single detections, however robust, sees it. Odometry does. Between a pose before the row and one behind it, odometry
alone knows the way to some decimetres, because both of its ends are held. This *bridge* is compared with the estimate:
where they are farther apart than the bridge may err, and the bridge itself meets its far end, the landmarks are wrong,
not the wheels. Landmarks that do not fit the bridge are distrusted, and the graph is solved without them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pydantic import Field
from scipy.stats import chi2

from factorloc.config import Block
from factorloc.factors.pole_detections import PoleDetections
from factorloc.geometry import se2

__all__ = ["Bridge", "Conflict", "ConsensusSettings", "bridge", "find_conflicts"]

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]


class ConsensusSettings(Block):
    """When landmarks are distrusted.

    Parameters
    ----------
    lengths : tuple of float
        Lengths of the bridges, m, short to long: the longest is longer than the longest row that may have been moved.
    overlap : float
        Share of a bridge that the next one covers too.
    chance : float
        Probability with which a bridge is in conflict with landmarks that are right.
    closure : float
        Probability with which odometry that is right does not meet the far end of a bridge.
    held : (float, float)
        Standard deviations of the ends of a bridge, m and rad.
    least : float
        An estimate nearer to the bridge than this is never in conflict, m.
    fits : float
        A landmark is distrusted from this distance between what was seen of it, from the bridge, and the map, in
        standard deviations of the bridge and the detections.
    rounds : int
        How often the graph is solved again without the landmarks that are distrusted, at most.
    pardoned : float
        A landmark that was found where the map has it, in this share of the local maps that had it in view, once others
        were left out, is trusted again.
    """

    lengths: tuple[float, ...] = (60.0, 120.0, 180.0, 260.0)
    overlap: float = Field(0.75, ge=0, lt=1)
    chance: float = Field(1e-5, gt=0, lt=1)
    closure: float = Field(1e-3, gt=0, lt=1)
    held: tuple[float, float] = (0.1, 0.01)
    least: float = Field(0.25, ge=0)
    fits: float = Field(3.0, gt=0)
    rounds: int = Field(6, ge=0)
    pardoned: float = Field(0.3, gt=0, le=1)

    @property
    def held_covariance(self) -> Array:
        """Covariance of either end of a bridge."""
        return np.diag(np.array([self.held[0], self.held[0], self.held[1]]) ** 2)


@dataclass(frozen=True)
class Bridge:
    """The way between two poses as odometry has it, bent so that it meets both.

    Parameters
    ----------
    poses : ndarray, shape (M, 3)
        From the first to the last pose.
    covariances : ndarray, shape (M, 3, 3)
        In the tangent space of the body.
    closure : float
        Squared Mahalanobis distance by which odometry, unbent, misses the last pose; of three degrees of freedom.
    """

    poses: Array
    covariances: Array
    closure: float


@dataclass(frozen=True)
class Conflict:
    """Where an estimate does not agree with the bridge over it.

    Parameters
    ----------
    first, last : int
        Ends of the bridge, numbers of poses.
    distance : float
        Farthest that the estimate is from the bridge, m.
    landmarks : ndarray of int64, shape (D,)
        Those the estimate used that do not fit the bridge.
    """

    first: int
    last: int
    distance: float
    landmarks: Index


def bridge(first: Array, last: Array, motions: Array, covariances: Array, held: Array) -> Bridge:
    """Lead odometry from a pose to another.

    Errors of all motions are carried into the frame of the last body by adjoints, where they add up; what the sum of
    them is off by is shared out as Kalman would, ``error_k = S_k (S + P)^-1 closure`` with S_k the sum of the
    covariances up to pose k.

    Parameters
    ----------
    first, last : ndarray, shape (3,)
        Ends.
    motions : ndarray, shape (M - 1, 3)
        Odometry between them.
    covariances : ndarray, shape (M - 1, 3, 3)
        Of the motions.
    held : ndarray, shape (3, 3)
        Covariance of either end.
    """
    n = len(motions) + 1
    free = np.empty((n, 3))
    free[0] = first
    for k in range(n - 1):
        free[k + 1] = se2.compose(free[k], motions[k])
    to_last = se2.adjoint(se2.between(free[-1], free))  # of tangent vectors at pose k, in the frame of the last
    at_last = np.concatenate([held[None], covariances])
    sums = np.cumsum(to_last @ at_last @ np.swapaxes(to_last, 1, 2), axis=0)
    missed = se2.log(se2.between(free[-1], last))
    total = sums[-1] + held
    gain = np.linalg.solve(total, missed)
    back = np.linalg.inv(to_last)
    shares = (back @ (sums @ gain)[:, :, None])[:, :, 0]
    left = sums - sums @ np.linalg.solve(total, sums)
    spread = back @ left @ np.swapaxes(back, 1, 2)
    return Bridge(se2.compose(free, se2.exp(shares)), (spread + np.swapaxes(spread, 1, 2)) / 2, float(missed @ gain))


def find_conflicts(
    poses: Array,
    motions: Array,
    covariances: Array,
    detections: PoleDetections,
    matches: Index,
    landmarks: Array,
    sigma: float,
    settings: ConsensusSettings,
    known: npt.NDArray[np.bool_],
) -> tuple[list[Conflict], int]:
    """Compare an estimate with bridges of all lengths, all along it.

    Parameters
    ----------
    poses : ndarray, shape (N, 3)
        The estimate.
    motions, covariances : ndarray, shapes (N - 1, 3), (N - 1, 3, 3)
        Odometry.
    detections : PoleDetections
        Of N local maps.
    matches : ndarray of int64, shape (K,)
        Landmark of each detection, or -1.
    landmarks : ndarray, shape (L, 2)
        Poles of the map, m.
    sigma : float
        Standard deviation of a detection against its landmark, m.
    settings : ConsensusSettings
        When they disagree.
    known : ndarray of bool, shape (N - 1,)
        Which motions were measured; no bridge leads over one that was not.

    Returns
    -------
    conflicts : list of Conflict
        Of the shortest length that has any: there the ends of the bridges are right most surely.
    broken : int
        Bridges that do not meet their far end: odometry is wrong there, or an end.
    """
    way = se2.way(motions)
    held = settings.held_covariance
    limits = chi2.ppf(1 - settings.chance, 3), chi2.ppf(1 - settings.closure, 3)
    broken = 0
    for length in settings.lengths:
        found: list[Conflict] = []
        starts = np.arange(0.0, max(way[-1] - length, 0.0) + 1e-9, length * (1 - settings.overlap))
        for start in starts:
            a, b = int(np.searchsorted(way, start)), min(int(np.searchsorted(way, start + length)), len(poses) - 1)
            if b - a < 2 or not known[a:b].all():
                continue
            over = bridge(poses[a], poses[b], motions[a:b], covariances[a:b], held)
            if over.closure > limits[1]:
                broken += 1
                continue
            apart = se2.log(se2.between(over.poses, poses[a : b + 1]))
            squared = np.einsum("ni,nij,nj->n", apart, np.linalg.inv(over.covariances), apart)
            distance = np.hypot(apart[:, 0], apart[:, 1])
            if not ((squared > limits[0]) & (distance > settings.least)).any():
                continue
            wrong = _misfits(over, a, b, detections, matches, landmarks, sigma, settings)
            if len(wrong):
                found.append(Conflict(a, b, float(distance.max()), wrong))
        if found:
            return found, broken
    return [], broken


def _misfits(
    over: Bridge,
    a: int,
    b: int,
    detections: PoleDetections,
    matches: Index,
    landmarks: Array,
    sigma: float,
    settings: ConsensusSettings,
) -> Index:
    """Landmarks whose detections, seen from the bridge, are not where the map has them."""
    low, high = int(detections.offsets[a]), int(detections.offsets[b + 1])
    used = np.arange(low, high)[matches[low:high] >= 0]
    if len(used) == 0:
        return np.zeros(0, np.int64)
    here = detections.pose_of[used] - a
    points, which = detections.poles.positions[used], matches[used]
    offsets = se2.transform(over.poses[here], points) - landmarks[which]
    R = se2.rotation(over.poses[here, 2])
    J = np.concatenate([R, (R @ np.stack([-points[:, 1], points[:, 0]], -1)[:, :, None])], axis=2)
    spread = J @ over.covariances[here] @ np.swapaxes(J, 1, 2) + sigma**2 * np.eye(2)
    squared = np.einsum("ni,nij,nj->n", offsets, np.linalg.inv(spread), offsets)
    names, rows = np.unique(which, return_inverse=True)
    # A landmark has one error, however often it was seen: its median detection speaks for it.
    median = np.array([np.median(squared[rows == n]) for n in range(len(names))])
    distance = np.array([np.hypot(*np.median(offsets[rows == n], axis=0)) for n in range(len(names))])
    return np.asarray(names[(median > settings.fits**2) & (distance > settings.least)], np.int64)
