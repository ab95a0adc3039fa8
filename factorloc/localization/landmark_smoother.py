"""Landmark smoother: poses and landmarks as variables of one graph, mapping and localization at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import gtsam
import numpy as np
import numpy.typing as npt
from gtsam.symbol_shorthand import L, X

from factorloc.errors import GeometryError, OptimizationError
from factorloc.factors.native import pose_array
from factorloc.factors.odometry import OdometryNoise, motion_covariances, odometry_factors
from factorloc.factors.pole_factors import landmark_factors, landmark_priors
from factorloc.factors.prior import PosePrior
from factorloc.geometry import se2
from factorloc.localization.pole_search import dead_reckoned

__all__ = ["LandmarkSolution", "smooth_landmarks"]

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]


@dataclass(frozen=True)
class LandmarkSolution:
    """Poses and landmarks that were estimated together.

    Parameters
    ----------
    poses : ndarray, shape (N, 3)
        ``T_map_body``.
    landmarks : ndarray, shape (L, 2)
        m; NaN for those that were not seen.
    counts : ndarray of int64, shape (L,)
        How often each was seen.
    cost : float
        Of the graph in the end.
    """

    poses: Array
    landmarks: Array
    counts: Index
    cost: float


def smooth_landmarks(
    odometry: npt.ArrayLike,
    pose_of: npt.ArrayLike,
    landmark_of: npt.ArrayLike,
    points: npt.ArrayLike,
    start: PosePrior,
    *,
    sigma: float | npt.ArrayLike = 0.15,
    noise: OdometryNoise | None = None,
    covariances: npt.ArrayLike | None = None,
    known_landmarks: npt.ArrayLike | None = None,
    landmark_sigma: float = 0.1,
    progress: Callable[[int], None] | None = None,
) -> LandmarkSolution:
    """Estimate poses and landmarks of a drive whose associations are known.

    From dead reckoning a batch solver falls into the wrong valley; so poses are added one after the other to an
    incremental smoother (iSAM2), and what it found is polished in one batch. All factors are gtsam's own.

    Parameters
    ----------
    odometry : array_like, shape (N - 1, 3)
        Motions.
    pose_of, landmark_of : array_like of int, shape (K,)
        Which pose saw which landmark, by numbers from 0 on; poses in order.
    points : array_like, shape (K, 2)
        Detections in the frame of the body, m.
    start : PosePrior
        Of the first pose.
    sigma : float, or (float, float)
        Standard deviation of a detection, m, or of its bearing (rad) and range (m).
    noise : OdometryNoise, optional
        Noise and loss of the motions.
    covariances : array_like, shape (N - 1, 3, 3), optional
        Of the motions.
    known_landmarks : array_like, shape (L, 2), optional
        What a map says of the landmarks; NaN where it says nothing. Without any, only the start fixes the frame.
    landmark_sigma : float
        How sure it is, m.
    progress : callable, optional
        Called with the number of poses added.

    Raises
    ------
    GeometryError
        If numbers disagree.
    OptimizationError
        If the graph cannot be solved.
    """
    motions = se2.as_poses(np.asarray(odometry, np.float64).reshape(-1, 3), "odometry")
    poses, marks = np.asarray(pose_of, np.int64), np.asarray(landmark_of, np.int64)
    z, n = np.asarray(points, np.float64).reshape(-1, 2), len(motions) + 1
    if not len(poses) == len(marks) == len(z) or (np.diff(poses) < 0).any():
        raise GeometryError(
            f"landmarks: {len(poses)} poses, {len(marks)} landmarks, {len(z)} points; one each, in order"
        )
    if len(poses) and not (poses.min() >= 0 and poses.max() < n and marks.min() >= 0):
        raise GeometryError(f"landmarks: numbers of poses up to {poses.max()}, there are {n}")
    noise = noise or OdometryNoise()
    keys = [X(k) for k in range(n)]
    between = list(odometry_factors(keys, motions, noise, None, motion_covariances(motions, noise, covariances)))
    given = np.asarray(sigma, np.float64)
    sigmas = float(given) if given.ndim == 0 else np.broadcast_to(given, z.shape)
    seen = list(landmark_factors([X(k) for k in poses.tolist()], [L(m) for m in marks.tolist()], z, sigmas))
    map_of = np.full((int(marks.max(initial=-1)) + 1, 2), np.nan)
    if known_landmarks is not None:
        there = np.asarray(known_landmarks, np.float64).reshape(-1, 2)[: len(map_of)]
        map_of[: len(there)] = there
    smoother = gtsam.ISAM2(gtsam.ISAM2Params())
    whole = gtsam.NonlinearFactorGraph()
    met: set[int] = set()
    pose, row = start.pose, 0
    try:
        for k in range(n):
            graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
            if k == 0:
                graph.push_back(start.factor(keys[0]))
            else:
                graph.push_back(between[k - 1])
                pose = dead_reckoned(_pose_of(smoother, keys[k - 1]), motions[k - 1 : k])[1]
            values.insert(keys[k], gtsam.Pose2(*pose))
            while row < len(poses) and poses[row] == k:
                mark = int(marks[row])
                graph.push_back(seen[row])
                if mark not in met:
                    met.add(mark)
                    known = bool(np.isfinite(map_of[mark]).all())
                    values.insert(L(mark), map_of[mark] if known else se2.transform(pose, z[row]))
                    if known:
                        for factor in landmark_priors([L(mark)], map_of[mark][None], landmark_sigma):
                            graph.push_back(factor)
                row += 1
            smoother.update(graph, values)
            whole.push_back(graph)
            if progress:
                progress(k + 1)
        found = gtsam.LevenbergMarquardtOptimizer(whole, smoother.calculateBestEstimate()).optimize()
    except RuntimeError as error:  # gtsam's name for an indeterminate system
        raise OptimizationError(
            f"landmarks: the graph cannot be solved ({' '.join(str(error).split())[:120]})"
        ) from error
    landmarks = np.full((len(map_of), 2), np.nan)
    for mark in met:
        landmarks[mark] = found.atPoint2(L(mark))
    counts = np.bincount(marks, minlength=len(map_of)).astype(np.int64)
    return LandmarkSolution(pose_array(found), landmarks, counts, float(whole.error(found)))


def _pose_of(smoother: gtsam.ISAM2, key: int) -> Array:
    pose = smoother.calculateEstimatePose2(key)
    return np.array([pose.x(), pose.y(), pose.theta()])
