"""Plain arrays into gtsam's native values and factors, and back, in the plane and in space."""

from __future__ import annotations

from collections.abc import Sequence

import gtsam
import numpy as np
import numpy.typing as npt

__all__ = ["between_factor", "native_pose", "pose_array", "pose_values", "prior_factor"]

Array = npt.NDArray[np.float64]


def native_pose(pose: Array) -> gtsam.Pose2 | gtsam.Pose3:
    """Return the pose of a row [x, y, theta] or of a 4 x 4 matrix."""
    return gtsam.Pose2(*pose) if pose.ndim == 1 else gtsam.Pose3(pose)


def pose_values(keys: Sequence[int], poses: Array) -> gtsam.Values:
    """Make values of poses (N, 3) or (N, 4, 4)."""
    values = gtsam.Values()
    for key, pose in zip(keys, poses, strict=True):
        values.insert(key, native_pose(pose))
    return values


def pose_array(values: gtsam.Values, keys: Sequence[int] | None = None) -> Array:
    """Poses of all values in order of their keys, or of some of them; shape (N, 3) or (N, 4, 4)."""
    poses = np.asarray(gtsam.utilities.extractPose2(values))
    if len(poses) == 0 and values.size():
        flat = np.asarray(gtsam.utilities.extractPose3(values))
        poses = np.zeros((len(flat), 4, 4))
        poses[:, :3, :3], poses[:, :3, 3], poses[:, 3, 3] = flat[:, :9].reshape(-1, 3, 3), flat[:, 9:], 1
    if keys is None or len(keys) == len(poses):
        return np.ascontiguousarray(poses)
    rows = np.searchsorted(np.asarray(values.keys(), dtype=np.uint64), np.asarray(keys, dtype=np.uint64))
    return np.ascontiguousarray(poses[rows])


def prior_factor(key: int, pose: Array, noise: gtsam.noiseModel.Base) -> gtsam.NonlinearFactor:
    """Make the native prior of a pose."""
    if pose.ndim == 1:
        return gtsam.PriorFactorPose2(key, gtsam.Pose2(*pose), noise)
    return gtsam.PriorFactorPose3(key, gtsam.Pose3(pose), noise)


def between_factor(first: int, second: int, motion: Array, noise: gtsam.noiseModel.Base) -> gtsam.NonlinearFactor:
    """Make the native factor of a relative pose."""
    if motion.ndim == 1:
        return gtsam.BetweenFactorPose2(first, second, gtsam.Pose2(*motion), noise)
    return gtsam.BetweenFactorPose3(first, second, gtsam.Pose3(motion), noise)
