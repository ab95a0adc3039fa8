"""Where sensor models are compared: a map of the even scans of a recording, and the odd ones with their poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from pydantic import Field

from benchmarks.carmen_study import truth_of
from benchmarks.kitti_frames import read_frames
from factorloc.config import Block
from factorloc.datasets import read_carmen
from factorloc.errors import DataError
from factorloc.geometry import group_of
from factorloc.mapping import BrickStatistics, RayStatistics
from factorloc.scan import Scan

__all__ = ["LOGS", "SCENES", "Motions", "PlanarScenes", "Scene", "SpatialScenes", "evenly", "open_scene", "thinned"]

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]

DRIVE = "0005"
LOGS = ("aces", "belgioioso", "edmonton", "fhw", "freiburg-campus", "infinite-corridor", "intel", "seattle")
"""The CARMEN logs."""
SCENES = (*LOGS, DRIVE)
"""All scenes: the logs, and KITTI raw drive 0005."""


class PlanarScenes(Block):
    """How logs are mapped.

    Parameters
    ----------
    resolution : float
        Edge length of a cell, m.
    range_limits : (float, float or None)
        Minimum and maximum range, m; None for the log's own. The minimum is what failed rays are set to.
    """

    resolution: float = Field(gt=0)
    range_limits: tuple[float, float | None]


class SpatialScenes(Block):
    """How the drive is mapped.

    Parameters
    ----------
    resolution : float
        Edge length of a cell, m.
    range_limits : (float, float)
        m.
    rays : int
        Of a scan, at most, evenly spread, where it is weighed at many poses or in many maps.
    odometry_translation, odometry_rotation : float
        Standard deviations of the noise added to each axis of the reference's motions, m and rad.
    """

    resolution: float = Field(gt=0)
    range_limits: tuple[float, float]
    rays: int = Field(gt=0)
    odometry_translation: float = Field(gt=0)
    odometry_rotation: float = Field(gt=0)


@dataclass(frozen=True)
class Motions:
    """Odometry between scans.

    Parameters
    ----------
    motions : ndarray, shape (N - 1, 3) or (N - 1, 4, 4)
    known : ndarray of bool, shape (N - 1,)
    covariances : ndarray, shape (N - 1, 6, 6), or None
    """

    motions: Array
    known: npt.NDArray[np.bool_]
    covariances: Array | None = None


@dataclass(frozen=True)
class Scene:
    """A map and scans that did not make it.

    Parameters
    ----------
    name : str
    statistics : RayStatistics or BrickStatistics
        Map of the training scans.
    training, held_out : sequence of Scan
    training_poses, poses : ndarray, shape (N, 3) or (N, 4, 4)
        Where they were taken.
    odometry : Motions or None
        Between held-out scans; None if it is to be simulated.
    noise : ndarray, shape (6,)
        Standard deviations of what is added to the motions of the poses then.
    """

    name: str
    statistics: RayStatistics | BrickStatistics
    training: Sequence[Scan]
    training_poses: Array
    held_out: Sequence[Scan]
    poses: Array
    odometry: Motions | None
    noise: Array | None = None

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return self.statistics.grid.dimension

    def motions(self, first: int, last: int, rng: np.random.Generator) -> Motions:
        """Odometry between the held-out scans ``first`` to ``last - 1``; noise, if any, is drawn anew."""
        rows = slice(first, last - 1)
        if self.odometry is not None:
            return Motions(self.odometry.motions[rows], self.odometry.known[rows])
        assert self.noise is not None
        group = group_of(self.dimension)
        motions = group.between(self.poses[first : last - 1], self.poses[first + 1 : last])
        drawn = rng.standard_normal((len(motions), len(self.noise))) * self.noise
        covariances = np.tile(np.diag(self.noise**2), (len(motions), 1, 1))
        return Motions(group.compose(motions, group.exp(drawn)), np.ones(len(motions), np.bool_), covariances)


def open_scene(name: str, data: Path | None, planar: PlanarScenes, spatial: SpatialScenes) -> Scene:
    """Read a recording and map its even scans.

    The odometry of a log is that of its raw log where there is one, else of the ODOM lines between scans; the drive has
    none, so its reference poses get noise.

    Raises
    ------
    DataError
        If there is no data, or no scene of that name.
    """
    if name not in SCENES:
        raise DataError(f"scene {name}: unknown; take some of {', '.join(SCENES)}")
    if data is None:
        raise DataError("no real data: set FACTORLOC_DATA or give --data")
    if name == DRIVE:
        frames = read_frames(data, spatial.range_limits)
        mapping, driving = frames.select(slice(0, None, 2)), frames.select(slice(1, None, 2))
        bricks = BrickStatistics.from_scans(mapping.scans, mapping.poses, resolution=spatial.resolution)
        noise = np.repeat([spatial.odometry_rotation, spatial.odometry_translation], 3)
        return Scene(name, bricks, mapping.scans, mapping.poses, driving.scans, driving.poses, None, noise)
    corrected, raw = data / "carmen" / f"{name}-corrected.log.gz", data / "carmen_raw" / f"{name}.clf.bz2"
    limits = planar.range_limits
    drive = (
        read_carmen(raw, truth=corrected, range_limits=limits)
        if raw.exists()
        else read_carmen(corrected, range_limits=limits)
    )
    even, odd = drive.select(slice(0, None, 2)), drive.select(slice(1, None, 2))
    poses = truth_of(even).poses
    statistics = RayStatistics.from_scans(even.scans, poses, resolution=planar.resolution)
    odometry = Motions(odd.odometry, odd.odometry_known)
    return Scene(name, statistics, even.scans, poses, odd.scans, truth_of(odd).poses, odometry)


def evenly(count: int, most: int) -> Index:
    """At most so many of ``count`` rows, evenly spread; all of them if 0 are asked for."""
    if most <= 0 or most >= count:
        return np.arange(count)
    return np.floor((np.arange(most) + 0.5) * count / most).astype(np.int64)


def thinned(scan: Scan, most: int) -> Scan:
    """The scan of at most so many of its rays, evenly spread; all of them of a planar one."""
    return scan if scan.dimension == 2 or len(scan) <= most else scan.select(evenly(len(scan), most))
