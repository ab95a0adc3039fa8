"""Poles of KITTI raw drive 0005, 71 m of a street: a demonstration, and the detection rates of real scans.

Even frames of the 52 full ones make a map of poles at the reference poses. Odd frames make local maps, which are
registered by odometry alone: the yaw *increments* and speeds of OXTS, with noise added. What they find is compared
with the map, localized in it by the smoother and by the published filter, and shown over the reflections. Map and
drive are the same 71 m of one day: a demonstration, no proof of anything else. A local map has two or three of the
thinned-out frames, 0.6 s apart, where a vehicle would have fifteen: rates are those of such sparse scans.

With ``--freeze FILE`` the miss rate, the rate of false poles and the noise of positions are written, for experiments
that simulate detections.
"""

from __future__ import annotations

import itertools
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from pydantic import Field

from benchmarks.harness import Benchmark, arguments, one_line_errors
from benchmarks.kitti_frames import KittiFrames, read_frames
from benchmarks.poles_detection import DetectionRates
from benchmarks.poles_kitti_localization import PoleLocalizationSettings, add_localization
from factorloc.config import Block, read_config
from factorloc.errors import DataError
from factorloc.files import write_text
from factorloc.geometry import se2, se3
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.local_maps import LocalMap, local_maps
from factorloc.mapping.pole_map import PoleMap
from factorloc.mapping.pole_mapping import PoleMapper, PoleMappingSettings
from factorloc.mapping.poles import Poles
from factorloc.mapping.top_view import top_view
from factorloc.trajectory import Trajectory
from factorloc.viewer import plot_pole_map

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = npt.NDArray[np.float64]

SETTINGS = Path(__file__).with_name("poles_kitti.json")

_EDGE = 0.2  # m; cells of the picture
_RIM = 5.0  # m around the poles that the picture shows


class OdometryNoise(Block):
    """Noise added to OXTS.

    Parameters
    ----------
    speed_sigma : float
        Of the speed over each interval between frames, m/s.
    yaw_rate_sigma : float
        Of the yaw increment, deg for the root of each second.
    seed : int
        Of the noise.
    """

    speed_sigma: float = Field(ge=0)
    yaw_rate_sigma: float = Field(ge=0)
    seed: int


class PolesKittiSettings(Block):
    """What ``poles_kitti.json`` holds.

    Parameters
    ----------
    range_limits : (float, float)
        Minimum and maximum range to use, m.
    mapping : PoleMappingSettings
        Of the map, and of the local maps.
    reach : float
        Farthest a detection is from its pole, m.
    margin : float
        Poles nearer to the rim of a local map do not count as missed, m.
    odometry : OdometryNoise
        What is added to OXTS.
    localization : PoleLocalizationSettings
        How odd frames are localized.
    """

    range_limits: tuple[float, float]
    mapping: PoleMappingSettings
    reach: float = Field(gt=0)
    margin: float = Field(ge=0)
    odometry: OdometryNoise
    localization: PoleLocalizationSettings


@one_line_errors
def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; the exit code is 1 if a goal is missed."""
    given = arguments("poles_kitti", __doc__ or "", argv, settings=str(SETTINGS), freeze="")
    settings = read_config(given.options["settings"], PolesKittiSettings)
    frames = read_frames(given.data, settings.range_limits)
    even, odd = frames.select(slice(0, None, 2)), frames.select(slice(1, None, 2))
    path = noisy_odometry(given.data, odd, settings.odometry)
    pole_map = map_of(even, settings)
    maps = list(local_maps(odd.scans, path, settings.mapping.poles))
    rates = compared(maps, odd, pole_map, settings)
    facts: dict[str, Any] = {
        "frames in the map": len(even),
        "frames compared": len(odd),
        "length m": round(odd.reference.length, 1),
    }
    facts["reference"] = "scan-to-map GICP of the same drive: consistency, no error against truth"
    bench = Benchmark("poles_kitti", {**facts, **settings.model_dump()})
    add_figures(bench, rates, pole_map, len(maps))
    if given.options["freeze"]:
        write_text(given.options["freeze"], json.dumps(frozen(rates, settings, len(maps)), indent=2) + "\n")
    smoothed = add_localization(bench, odd, path, maps, pole_map, settings.localization, given.quick)
    placed = [at_reference(each, odd) for each in maps]
    return bench.finish(given, picture(even, smoothed, pole_map, placed))


def picture(even: KittiFrames, drive: Trajectory, pole_map: PoleMap, maps: list[LocalMap]) -> Figure:
    """Draw the map over what the even frames reflect, and all detections in the odd ones."""
    below = BrickStatistics.from_scans(even.scans, even.poses, resolution=_EDGE)
    found = Poles.joined([each.in_world for each in maps])
    low, high = pole_map.positions.min(0) - _RIM, pole_map.positions.max(0) + _RIM
    cut = below.crop(below.grid.crop((*low, below.grid.origin[2]), (*high, below.grid.upper[2])))
    return plot_pole_map(pole_map, top_view(cut), cut.grid.extent, trajectory=drive, detections=found)


def map_of(frames: KittiFrames, settings: PolesKittiSettings) -> PoleMap:
    """Map the poles at the reference poses."""
    mapper = PoleMapper(settings.mapping)
    mapper.add("even frames", frames.scans, frames.reference)
    return mapper.finish("velo0")


def noisy_odometry(data: Path | None, frames: KittiFrames, noise: OdometryNoise) -> Trajectory:
    """Dead reckoning in the plane by yaw increments and speeds of OXTS with noise; begins at the first reference pose.

    Raises
    ------
    DataError
        If OXTS cannot be read.
    """
    if data is None:
        raise DataError("drive 0005: no real data; set FACTORLOC_DATA or give --data")
    path = data / "kitti_raw_0005" / "oxts_2d_gt.txt"
    try:
        table = np.loadtxt(path, comments="#")
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: cannot be read ({error})") from error
    times, speeds, yaws = table[:, 0], table[:, 7], np.unwrap(table[:, 8])
    stamps = frames.reference.stamps
    rng = np.random.default_rng(noise.seed)
    pose = se3.to_se2(frames.poses[0])
    poses = [pose]
    for begin, end in itertools.pairwise(stamps.tolist()):
        fine = np.linspace(begin, end, 10)
        speed = float(np.interp(fine, times, speeds).mean() + noise.speed_sigma * rng.standard_normal())
        turn = float(np.diff(np.interp([begin, end], times, yaws))[0])
        turn += np.radians(noise.yaw_rate_sigma) * np.sqrt(end - begin) * rng.standard_normal()
        pose = se2.compose(pose, se2.exp([speed * (end - begin), 0.0, turn]))
        poses.append(pose)
    return Trajectory(stamps, np.array(poses))


def compared(
    maps: Sequence[LocalMap], frames: KittiFrames, pole_map: PoleMap, settings: PolesKittiSettings
) -> DetectionRates:
    """What local maps find of the map, each placed at the reference."""
    placed = [at_reference(each, frames) for each in maps]
    return DetectionRates.of(placed, pole_map, settings.reach, settings.margin)


def at_reference(found: LocalMap, frames: KittiFrames) -> LocalMap:
    """Place a local map at the reference pose of its newest scan: what is off is the detection, not the odometry."""
    reference = se3.to_se2(frames.poses[found.scans[-1]])
    return LocalMap(found.scans, found.stamp, reference, found.poles, found.corners, found.T_reference_axes)


def add_figures(bench: Benchmark, rates: DetectionRates, pole_map: PoleMap, count: int) -> None:
    """Add all figures."""
    bench.figure("poles in the map", len(pole_map), "1")
    bench.figure("local maps compared", count, "1")
    bench.figure("poles in view, all local maps", rates.in_view, "1")
    bench.figure("miss rate", rates.miss_rate, "1")
    bench.figure("detections a local map", rates.detections / count, "1")
    bench.figure("share of detections not in the map", rates.unmatched / rates.detections, "1")
    bench.figure("false poles", rates.false_rate, "1/m^2")
    bench.figure("position noise along an axis", rates.position_sigma, "m")
    bench.figure("position noise along an axis, median rule", rates.robust_sigma, "m")


def frozen(rates: DetectionRates, settings: PolesKittiSettings, count: int) -> dict[str, Any]:
    """What experiments with simulated detections take from here."""
    return {
        "miss_rate": round(rates.miss_rate, 4),
        "false_rate": round(rates.false_rate, 6),
        "false_share": round(rates.unmatched / rates.detections, 4),
        "position_sigma": round(rates.position_sigma, 4),
        "position_sigma_robust": round(rates.robust_sigma, 4),
        "units": {
            "miss_rate": "fraction of the mapped poles within the square of a local map, rim left out, not found in it",
            "false_rate": "detections that are not in the map, per m^2 of a local map",
            "false_share": "the same as a share of all detections",
            "position_sigma": "m along one axis; root mean square, the error of the map included",
            "position_sigma_robust": "m along one axis; 1.4826 times the median of absolute offsets",
        },
        "local_map": {
            "side_m": settings.mapping.poles.size[0],
            "spacing_m": settings.mapping.poles.segment_spacing,
            "count": count,
            "poles_in_view": rates.in_view,
            "detections": rates.detections,
        },
        "measured": (
            "KITTI raw drive 0005, 71 m: map of poles from even frames of every third at reference poses, local maps "
            "of odd frames by noisy OXTS odometry, each placed at the reference pose of its newest frame; occluded "
            "poles count as missed; two or three frames in a local map"
        ),
    }


if __name__ == "__main__":
    sys.exit(main())
