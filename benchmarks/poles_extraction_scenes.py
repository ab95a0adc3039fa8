"""Stretches of simulated streets, with the exact truth of the poles a lidar has seen there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from factorloc.geometry import se3
from factorloc.mapping.local_maps import segments
from factorloc.mapping.poles import Poles
from factorloc.scan import Scan
from factorloc.simulation import Scene, SpatialLidar, StreetSettings, simulate_drive, street_route, street_scene

__all__ = ["Stretch", "street_stretches", "true_poles"]

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]

_NEAR = 0.05  # m; a return so near to the shaft of a pole is one from it, unless noise says otherwise


@dataclass(frozen=True)
class Stretch:
    """Scans of one local map.

    Parameters
    ----------
    scans : sequence of Scan
        De-skewed.
    poses : ndarray, shape (S, 4, 4)
        True poses ``T_world_body``.
    truth : Poles
        All upright shafts of the world, trunks included; spans are those of the free shaft.
    returns : ndarray of int64, shape (N,)
        Rays of these scans that came back from each shaft.
    """

    scans: Sequence[Scan]
    poses: Array
    truth: Poles
    returns: Index

    @property
    def centre(self) -> Array:
        """Mean of where the lidar was, m, (3,)."""
        sensors = [se3.compose(pose, scan.T_body_sensor) for pose, scan in zip(self.poses, self.scans, strict=True)]
        return np.asarray(np.mean([sensor[:3, 3] for sensor in sensors], axis=0))

    def begin(self, length: float) -> Stretch:
        """Return as many of the first scans as were taken over a distance, m; at least one."""
        steps = np.linalg.norm(np.diff(self.poses[:, :2, 3], axis=0), axis=1)
        count = 1 + int((np.cumsum(steps) <= length + 1e-9).sum())
        if count == len(self.scans):
            return self
        scans, poses = self.scans[:count], self.poses[:count]
        return Stretch(scans, poses, self.truth, _returns(scans, poses, self.truth))

    @property
    def rays(self) -> int:
        """Rays of all scans."""
        return sum(map(len, self.scans))


def true_poles(scene: Scene) -> Poles:
    """Exact truth of a scene; all scores are 1."""
    poles = scene.true_poles
    table = np.array([[p.x, p.y, p.width, p.bottom, p.top] for p in poles]).reshape(-1, 5)
    return Poles(table[:, :2], table[:, 2], table[:, 3:], np.ones(len(table)))


def street_stretches(
    street: StreetSettings, lidar: SpatialLidar, seed: int, length: float, count: int, speed: float = 8.0
) -> Iterator[Stretch]:
    """Drive along a street, and cut out stretches spread evenly over it.

    Parameters
    ----------
    street : StreetSettings
        The street, at its real size.
    lidar : SpatialLidar
        At ten turns a second.
    seed : int
        Of the street and of the noise.
    length : float
        Of each stretch, m.
    count : int
        How many stretches.
    speed : float
        m/s.
    """
    scene = street_scene(street, seed)
    route = street_route(street, speed)
    period = lidar.rotation_period
    drive = simulate_drive(scene.world, route, lidar, seed=seed, period=period, keep_scans=False)
    assert drive.truth is not None
    truth = true_poles(scene)
    rows = segments(drive.truth, length, drive.truth.length / (count + 1))
    for chosen in rows[:count]:
        scans = [drive.scans[int(row)] for row in chosen]
        poses = drive.truth.poses[chosen]
        yield Stretch(scans, poses, truth, _returns(scans, poses, truth))


def _returns(scans: Sequence[Scan], poses: Array, truth: Poles) -> Index:
    tree, counts = cKDTree(truth.positions), np.zeros(len(truth), np.int64)
    reach = float(truth.widths.max()) / 2 + _NEAR
    for scan, pose in zip(scans, poses, strict=True):
        points = se3.transform(se3.compose(pose, scan.T_body_sensor), scan.points())
        distances, owner = map(np.asarray, tree.query(points[:, :2], 1, distance_upper_bound=reach))
        found = np.isfinite(distances)
        owner, distances, height = owner[found], distances[found], points[found, 2]
        on_shaft = np.abs(distances - truth.widths[owner] / 2) < _NEAR
        on_shaft &= (height > truth.spans[owner, 0]) & (height < truth.spans[owner, 1])
        counts += np.bincount(owner[on_shaft], minlength=len(truth))
    return counts
