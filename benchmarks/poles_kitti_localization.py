"""Drive 0005 localized among its poles: odd frames in the map of the even ones, by the smoother and by the filter."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from pydantic import Field

from benchmarks.harness import Benchmark
from benchmarks.kitti_frames import KittiFrames
from factorloc.config import Block
from factorloc.evaluation import absolute_errors
from factorloc.factors.pole_detections import PoleLandmarks
from factorloc.geometry import se2
from factorloc.localization.pole_filter import PoleFilterSettings, filter_poles
from factorloc.localization.pole_smoother import smooth_poles
from factorloc.mapping import LocalMap, PoleMap, Poles
from factorloc.trajectory import Trajectory

__all__ = ["PoleLocalizationSettings", "add_localization"]

Array = npt.NDArray[np.float64]


class PoleLocalizationSettings(Block):
    """How the drive is localized.

    Parameters
    ----------
    start_offset, start_turn : float
        How far off starts of the smoother are: horizontally, m, and in yaw, deg, to either side in turn.
    directions : int
        How many starts there are, evenly spread.
    particles : int
        Of the filter.
    start_position, start_heading : float
        Radius (m) and largest turn (deg) of the first particles around the first reference pose.
    runs : int
        How often the filter runs.
    speed_sigma, slip_sigma, yaw_rate_sigma : float
        What both are told of the odometry: standard deviations of the speed, m/s, of a motion to the side, m, and of
        the yaw, deg for the root of each second.
    """

    start_offset: float = Field(ge=0)
    start_turn: float = Field(ge=0)
    directions: int = Field(gt=0)
    particles: int = Field(gt=0)
    start_position: float = Field(ge=0)
    start_heading: float = Field(ge=0)
    runs: int = Field(gt=0)
    speed_sigma: float = Field(gt=0)
    slip_sigma: float = Field(gt=0)
    yaw_rate_sigma: float = Field(gt=0)


def add_localization(
    bench: Benchmark,
    frames: KittiFrames,
    odometry: Trajectory,
    maps: Sequence[LocalMap],
    pole_map: PoleMap,
    settings: PoleLocalizationSettings,
    quick: bool = False,
) -> Trajectory:
    """Add how far odometry, filter and smoother end from the reference.

    Parameters
    ----------
    bench : Benchmark
        What to add figures to.
    frames : KittiFrames
        What is localized.
    odometry : Trajectory
        Dead reckoning through all of them.
    maps : sequence of LocalMap
        Local maps along the odometry.
    pole_map : PoleMap
        The map.
    settings : PoleLocalizationSettings
    quick : bool
        Whether to make do with two runs of each.

    Returns
    -------
    Trajectory
        The first smoothed run.
    """
    reference = frames.reference.to_2d()
    found = {int(each.scans[-1]): each.poles for each in maps}
    local = [found.get(k, Poles.none()) for k in range(len(frames))]
    motions = se2.between(odometry.poses[:-1], odometry.poses[1:])
    seconds = np.diff(reference.stamps)
    covariances = np.zeros((len(motions), 3, 3))
    covariances[:, 0, 0] = (settings.speed_sigma * seconds) ** 2
    covariances[:, 1, 1] = settings.slip_sigma**2
    covariances[:, 2, 2] = np.radians(settings.yaw_rate_sigma) ** 2 * seconds
    landmarks, stamps = PoleLandmarks(pole_map.poles), reference.stamps
    smoothed = []
    for k in range(min(2, settings.directions) if quick else settings.directions):
        bearing = 2 * np.pi * k / settings.directions
        offset = settings.start_offset * np.array([np.cos(bearing), np.sin(bearing)])
        start = reference.poses[0] + [*offset, np.radians(settings.start_turn) * (-1) ** k]
        run = smooth_poles(
            landmarks, local, motions, start, covariances=covariances, stamps=stamps, frame=reference.world, seed=k
        )
        smoothed.append(run.result.trajectory)
    chosen = PoleFilterSettings(
        particles=settings.particles,
        start_position=settings.start_position,
        start_heading=float(np.radians(settings.start_heading)),
    )
    filtered = [
        filter_poles(
            landmarks, local, motions, reference.poses[0], covariances=covariances, stamps=stamps,
            frame=reference.world, settings=chosen, seed=seed,
        ).trajectory
        for seed in range(min(2, settings.runs) if quick else settings.runs)
    ]  # fmt: skip
    alone = Trajectory(stamps, odometry.poses, world=reference.world)
    for name, runs in (("odometry alone", [alone]), ("filtered as published", filtered), ("smoothed", smoothed)):
        _add(bench, name, runs, reference)
    return smoothed[0]


def _add(bench: Benchmark, name: str, runs: Sequence[Trajectory], reference: Trajectory) -> None:
    errors = [absolute_errors(run, reference) for run in runs]
    position = np.concatenate([one.translation for one in errors])
    heading = np.degrees(np.concatenate([one.rotation for one in errors]))
    bench.figure(f"{name}: mean deviation of positions", position.mean(), "m")
    bench.figure(f"{name}: RMS deviation of positions", np.sqrt((position**2).mean()), "m")
    bench.figure(f"{name}: largest deviation of a position", position.max(), "m")
    bench.figure(f"{name}: mean deviation of headings", heading.mean(), "deg")
    bench.figure(f"{name}: RMS deviation of headings", np.sqrt((heading**2).mean()), "deg")
