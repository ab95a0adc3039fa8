"""KITTI raw drive 0005 localized in the map of its own even frames: how far it ends from the reference.

The odd frames are localized with the odometry small_gicp finds between them, tracked and then smoothed, from starts off
in several directions and turned to either side in turn. All poses count, from the first on. The reference is the
scan-to-map GICP of the same drive, at whose poses the map was made as well: what agrees with it is consistent with it,
which is no proof of being right. Deviations are called so, not errors.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from pydantic import Field

from benchmarks.harness import Benchmark, arguments, one_line_errors
from benchmarks.kitti0005_picture import drive_picture
from benchmarks.kitti_frames import KittiFrames, read_frames
from benchmarks.starts import displaced
from factorloc.config import Block, read_config
from factorloc.errors import ConfigError
from factorloc.evaluation import ErrorStatistics, absolute_errors, nees
from factorloc.factors.level_tables import LevelTables
from factorloc.geometry import se3
from factorloc.localization import (
    LidarOdometry,
    Localization,
    LocalizationSettings,
    PreparedMap,
    lidar_odometry,
    localize,
)
from factorloc.mapping import BrickStatistics
from factorloc.result import Result
from factorloc.trajectory import Trajectory

Array = npt.NDArray[np.float64]

SETTINGS = Path(__file__).with_name("kitti0005.json")


class DriveSettings(Block):
    """What ``kitti0005.json`` holds.

    Parameters
    ----------
    range_limits : (float, float)
        Minimum and maximum range to use, m.
    resolution : float
        Edge length of a cell, m.
    start_offset, start_turn : float
        How far off starts are: horizontally, m, and in yaw, deg.
    directions : int
        How many starts there are, evenly spread.
    goals : dict of str to float
        The most of figures, in their units.
    nees : (float, float)
        Bounds of the smoothed NEES per degree of freedom.
    """

    range_limits: tuple[float, float]
    resolution: float = Field(gt=0)
    start_offset: float = Field(ge=0)
    start_turn: float = Field(ge=0)
    directions: int = Field(gt=0)
    goals: dict[str, float]
    nees: tuple[float, float]


@dataclass(frozen=True)
class Deviations:
    """How far poses of several runs are from the reference.

    Parameters
    ----------
    position, rotation : ErrorStatistics
        m and deg.
    nees : float
        Normalized squared deviation per degree of freedom; NaN without covariances.
    """

    position: ErrorStatistics
    rotation: ErrorStatistics
    nees: float

    @classmethod
    def of(cls, trajectories: Sequence[Trajectory], reference: Trajectory) -> Deviations:
        """Pool runs over the same scans."""
        found = [absolute_errors(trajectory, reference) for trajectory in trajectories]
        parts = [trajectory.covariances for trajectory in trajectories]
        known = [part for part in parts if part is not None]
        weighed = np.nan
        if len(known) == len(parts):
            weighed = nees(np.concatenate([one.tangent for one in found]), np.concatenate(known)).mean
        return cls(
            ErrorStatistics.of(np.concatenate([one.translation for one in found]), "m", "position"),
            ErrorStatistics.of(np.degrees(np.concatenate([one.rotation for one in found])), "deg", "rotation"),
            weighed,
        )


@one_line_errors
def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; the exit code is 1 if a goal is missed."""
    given = arguments("kitti0005", __doc__ or "", argv, frames=0, settings=str(SETTINGS))
    settings = read_config(given.options["settings"], DriveSettings)
    frames = read_frames(given.data, settings.range_limits).select(slice(given.options["frames"] or None))
    directions = min(2, settings.directions) if given.quick else settings.directions
    mapping, driving = frames.select(slice(0, None, 2)), frames.select(slice(1, None, 2))
    facts: dict[str, Any] = {"quick": given.quick, "directions taken": directions, "threads": given.threads}
    facts |= {"scans in the map": len(mapping), "scans localized": len(driving)}
    facts["reference"] = "scan-to-map GICP of the same drive: consistency, no error against truth"
    localization = LocalizationSettings()
    bench = Benchmark("kitti0005", {**facts, **settings.model_dump(), "localization": localization.model_dump()})
    began = time.perf_counter()
    statistics = BrickStatistics.from_scans(mapping.scans, mapping.poses, resolution=settings.resolution)
    mapped = time.perf_counter()
    prepared = PreparedMap.of(statistics, localization)
    ready = time.perf_counter()
    odometry = lidar_odometry(driving.scans)
    measured = time.perf_counter()
    runs = localize_from_around(prepared, driving, odometry, settings, directions, localization)
    reference, alone = driving.reference, dead_reckoning(driving, odometry)
    add_deviations(bench, "odometry alone", [alone], reference)
    add_deviations(bench, "tracked", [run.tracked.trajectory for run in runs], reference)
    add_deviations(bench, "smoothed", [run.smoothed.trajectory for run in runs], reference)
    bench.figure("odometry: motions not known", odometry.failed, "1")
    bench.figure("seconds to build the map", mapped - began, "s")
    bench.figure("seconds to prepare it", ready - mapped, "s")
    bench.figure("seconds a scan, odometry", (measured - ready) / len(driving), "s")
    for kind, results in (("tracked", [run.tracked for run in runs]), ("smoothed", [run.smoothed for run in runs])):
        bench.figure(f"seconds a scan, {kind}", median_seconds(results) / len(driving), "s")
    bench.figure("memory of the map", statistics.nbytes / 2**20, "MiB")
    assert isinstance(prepared.levels, LevelTables)
    bench.figure("memory of the tables", prepared.levels.nbytes / 2**20, "MiB")
    for name, most in settings.goals.items():
        if name not in bench.figures:
            raise ConfigError(f"goals: there is no figure '{name}'")
        bench.goal(name, *bench.figures[name], most)
    low, high = settings.nees
    bench.goal(name := "smoothed NEES per degree of freedom", *bench.figures[name], high, low)
    paths = {"smoothed": runs[0].smoothed.trajectory, "tracked": runs[0].tracked.trajectory, "odometry alone": alone}
    return bench.finish(given, drive_picture(statistics, paths, reference))


def localize_from_around(
    prepared: PreparedMap,
    driving: KittiFrames,
    odometry: LidarOdometry,
    settings: DriveSettings,
    directions: int,
    localization: LocalizationSettings,
) -> list[Localization]:
    """Localize from starts off in evenly spread directions, turned to either side in turn."""
    runs = []
    for k in range(directions):
        bearing, turn = 2 * np.pi * k / directions, np.radians(settings.start_turn) * (-1) ** k
        offset = settings.start_offset * np.array([np.cos(bearing), np.sin(bearing), 0.0])
        start = displaced(driving.poses[0], offset, [0.0, 0.0, turn])
        runs.append(
            localize(
                prepared, driving.scans, odometry.motions, start,
                known=odometry.known, covariances=odometry.covariances, settings=localization,
            )
        )  # fmt: skip
    return runs


def dead_reckoning(driving: KittiFrames, odometry: LidarOdometry) -> Trajectory:
    """Chain motions from the first reference pose on; where one is not known, the one before goes on."""
    poses, last = [driving.poses[0]], se3.identity()
    for motion, known in zip(odometry.motions, odometry.known, strict=True):
        last = motion if known else last
        poses.append(se3.compose(poses[-1], last))
    return Trajectory(driving.reference.stamps, np.array(poses))


def add_deviations(bench: Benchmark, kind: str, trajectories: Sequence[Trajectory], reference: Trajectory) -> None:
    """Add the deviations of several runs from the reference."""
    found = Deviations.of(trajectories, reference)
    for name, statistics in (("position", found.position), ("rotation", found.rotation)):
        bench.figure(f"{kind} {name} RMSE", statistics.rmse, statistics.unit)
        bench.figure(f"{kind} {name} median", statistics.median, statistics.unit)
        bench.figure(f"{kind} {name} max", statistics.max, statistics.unit)
    if np.isfinite(found.nees):
        bench.figure(f"{kind} NEES per degree of freedom", found.nees, "1")


def median_seconds(results: Sequence[Result]) -> float:
    """Time of a run; the first one may include compilation."""
    return float(np.median([result.seconds for result in results]))


if __name__ == "__main__":
    sys.exit(main())
