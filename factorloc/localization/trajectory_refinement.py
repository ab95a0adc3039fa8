"""Trajectory refinement: given poses of scans, smoothed by registering the scans with each other (figure 12.2).

A map is as sharp as the trajectory it is made from. Poses of a GNSS are right on average and sway by decimetres; scans
that overlap know their relative pose to centimetres. Both are factors of one graph: motions between consecutive scans
from lidar odometry, relative poses of scans at places that were visited again, and the given poses.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import gtsam
import numpy as np
import numpy.typing as npt
from gtsam.symbol_shorthand import X
from pydantic import Field
from scipy.spatial import cKDTree

from factorloc.config import Block
from factorloc.errors import GeometryError
from factorloc.factors.native import between_factor, pose_array, pose_values
from factorloc.factors.prior import PosePrior
from factorloc.geometry import se3
from factorloc.localization.lidar_odometry import lidar_odometry
from factorloc.localization.local_map import LidarOdometrySettings, LocalMap, thin
from factorloc.localization.optimizer import OptimizerSettings, optimize
from factorloc.scan import Scan
from factorloc.trajectory import Trajectory

__all__ = ["RefinedTrajectory", "TrajectoryRefinementSettings", "refine_trajectory"]

Array = npt.NDArray[np.float64]
Pairs = npt.NDArray[np.int64]


class TrajectoryRefinementSettings(Block):
    """What is believed of given poses and of registrations.

    Parameters
    ----------
    position, heading : float
        Standard deviations of the given poses, m and rad; what they are wrong by is much alike in neighbours.
    correlation : float
        Way over which it is, m: poses nearer to each other count less, together as one.
    revisit_distance : float
        Scans at most so far apart are registered with each other, m, ...
    revisit_way : float
        ... if the way between them is at least so long, m.
    revisits : int
        At most so many, spread over the drive.
    huber : float
        Threshold of the loss of registrations, in standard deviations.
    odometry : LidarOdometrySettings
        How scans are registered.
    """

    position: float = Field(0.3, gt=0)
    heading: float = Field(0.01, gt=0)
    correlation: float = Field(20.0, gt=0)
    revisit_distance: float = Field(5.0, ge=0)
    revisit_way: float = Field(30.0, gt=0)
    revisits: int = Field(500, ge=0)
    huber: float = Field(2.0, gt=0)
    odometry: LidarOdometrySettings = LidarOdometrySettings()


@dataclass(frozen=True)
class RefinedTrajectory:
    """Poses after refinement, and what they were made from.

    Parameters
    ----------
    trajectory : Trajectory
        Stamps and frame as given.
    motions : int
        Consecutive scans that were registered with each other.
    failed : int
        Those that were not.
    revisits : int
        Scans registered with others at the same place.
    moved : float
        Root mean square of what positions were moved by, m.
    """

    trajectory: Trajectory
    motions: int
    failed: int
    revisits: int
    moved: float

    def __str__(self) -> str:
        """Return one line."""
        return (
            f"trajectory refined by {self.motions} motions between scans ({self.failed} failed) and {self.revisits} "
            f"revisits: moved by {self.moved:.3f} m (RMS)"
        )


def refine_trajectory(
    scans: Sequence[Scan],
    trajectory: Trajectory,
    settings: TrajectoryRefinementSettings | None = None,
    progress: Callable[[int], None] | None = None,
) -> RefinedTrajectory:
    """Refine the poses of spatial scans.

    Parameters
    ----------
    scans : sequence of Scan
        N spatial scans.
    trajectory : Trajectory
        Pose ``T_map_body`` of each, good enough to say which scans overlap.
    settings : TrajectoryRefinementSettings, optional
        What is believed of them.
    progress : callable, optional
        Called with the number of scans registered.

    Raises
    ------
    GeometryError
        If there is not one pose a scan, there are none, or scans are planar.
    """
    chosen = settings or TrajectoryRefinementSettings()
    given = trajectory.to_3d()
    if len(scans) != len(given) or len(scans) == 0:
        raise GeometryError(f"refinement: {len(scans)} scans, but {len(given)} poses; give one pose a scan")
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(given.positions, axis=0), axis=1))])
    keys = [X(k) for k in range(len(scans))]
    graph = gtsam.NonlinearFactorGraph()
    for prior, key in zip(_priors(given, way, chosen), keys, strict=True):
        graph.push_back(prior.factor(key))
    loss = gtsam.noiseModel.mEstimator.Huber.Create(chosen.huber)

    def tie(first: int, second: int, motion: Array, covariance: Array) -> None:
        noise = gtsam.noiseModel.Robust.Create(loss, gtsam.noiseModel.Gaussian.Covariance(covariance))
        graph.push_back(between_factor(keys[first], keys[second], motion, noise))

    found = lidar_odometry(scans, chosen.odometry, progress)
    for k in np.flatnonzero(found.known).tolist():
        tie(k, k + 1, found.motions[k], found.covariances[k])
    revisits = 0
    for first, second in _revisited(given.positions, way, chosen).tolist():
        local = LocalMap(chosen.odometry, thin(scans[first], chosen.odometry))
        # Where they should be after lidar odometry is not known yet; where they are given is near enough.
        guess = se3.between(given.poses[first], given.poses[second])
        aligned = local.aligned(thin(scans[second], chosen.odometry), guess)
        if aligned is not None:
            tie(first, second, *aligned)
            revisits += 1
    solved = optimize(graph, pose_values(keys, given.poses), settings=OptimizerSettings())
    poses = pose_array(solved.values, keys)
    moved = np.linalg.norm(poses[:, :3, 3] - given.positions, axis=1)
    return RefinedTrajectory(
        replace(given, poses=poses, covariances=None), int(found.known.sum()), found.failed, revisits,
        float(np.sqrt((moved**2).mean())),
    )  # fmt: skip


def _priors(given: Trajectory, way: Array, settings: TrajectoryRefinementSettings) -> list[PosePrior]:
    """Priors of all poses: so many as lie within the correlation weigh as much as one."""
    half = settings.correlation / 2
    together = np.searchsorted(way, way + half, "right") - np.searchsorted(way, way - half, "left")
    return [
        PosePrior.from_sigmas(pose, settings.position * root, settings.heading * root)
        for pose, root in zip(given.poses, np.sqrt(together), strict=True)
    ]


def _revisited(positions: Array, way: Array, settings: TrajectoryRefinementSettings) -> Pairs:
    """Pairs of scans (P, 2) at one place, the earlier first; of each scan the nearest."""
    pairs = []
    tree = cKDTree(positions)
    for k, position in enumerate(positions):
        near = np.asarray(tree.query_ball_point(position, settings.revisit_distance), np.int64)
        earlier = near[way[k] - way[near] >= settings.revisit_way]
        if len(earlier):
            nearest = earlier[np.argmin(np.linalg.norm(positions[earlier] - positions[k], axis=1))]
            pairs.append((int(nearest), k))
    rows = np.unique(np.linspace(0, len(pairs) - 1, min(len(pairs), settings.revisits)).round().astype(np.int64))
    return np.array(pairs, np.int64).reshape(-1, 2)[rows] if len(rows) else np.zeros((0, 2), np.int64)
