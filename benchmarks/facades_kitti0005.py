"""Hybrid localization on real scans: KITTI raw drive 0005 among the buildings of OpenStreetMap, from a rough start.

The start is known to 5 m along each axis and 5 degrees; it is drawn uniformly in that box around the reference. The
motions are those of the reference, with errors drawn within the bounds that the odometry is declared to have. The
reference was registered to the same outlines of buildings: to agree with it is to be consistent with it, no error
against a truth. All frames were looked at when defaults were chosen; none is held out.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from pydantic import Field

from benchmarks.harness import Arguments, Benchmark, arguments, one_line_errors
from benchmarks.kitti_frames import KittiFrames, read_frames
from factorloc.cli.console import progress_bar
from factorloc.config import Block, read_config
from factorloc.datasets import read_buildings
from factorloc.errors import ConfigError, DataError
from factorloc.evaluation import ErrorStatistics
from factorloc.evaluation.bounds import bound_coverage
from factorloc.geometry import se2, wrap
from factorloc.localization.bounded_least_squares import estimate_in_bounds
from factorloc.localization.correspondences import find_correspondences
from factorloc.localization.facade_settings import FacadeSettings
from factorloc.localization.interval_tracking import FacadeTrack, track_facades
from factorloc.localization.line_cells import accumulator_of
from factorloc.localization.wall_lines import WallLines
from factorloc.mapping import FacadeMap, MapUncertainty
from factorloc.mapping.facade_points import FacadePoints, ReductionSettings, ScanErrors, facade_points
from factorloc.result import Bounds
from factorloc.viewer import save_figure
from factorloc.viewer.bounds_plot import plot_accumulator, plot_associated_points, plot_feasible_sets

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SETTINGS = Path(__file__).with_name("facades_kitti0005.json")
BUILDINGS = "kitti_raw_0005/2011_09_26_drive_0005_sync.osm"

Array = npt.NDArray[np.float64]


class HybridDriveSettings(Block):
    """What ``facades_kitti0005.json`` holds.

    Parameters
    ----------
    range_limits : (float, float)
        Minimum and maximum range to use, m.
    start_offset, start_turn : float
        Half sides of the box in which starts are drawn, and which is known, m and deg.
    starts : int
        Drives from so many starts.
    seed : int
        Of starts and motions.
    shift, vertex : float
        Declared errors of the map, m.
    errors : ScanErrors
        Of points.
    reduction : ReductionSettings
        Of scans.
    localization : FacadeSettings
        Everything else.
    goals : dict of str to float
        The most of figures.
    """

    range_limits: tuple[float, float]
    start_offset: float = Field(gt=0)
    start_turn: float = Field(gt=0)
    starts: int = Field(gt=0)
    seed: int = Field(ge=0)
    shift: float = Field(ge=0)
    vertex: float = Field(ge=0)
    errors: ScanErrors
    reduction: ReductionSettings
    localization: FacadeSettings
    goals: dict[str, float]


@dataclass(frozen=True)
class Street:
    """The drive in the frame of the map.

    Parameters
    ----------
    facade_map : FacadeMap
        Buildings.
    poses : ndarray, shape (S, 3)
        Reference.
    scans : list of FacadePoints
        Reduced.
    stamps : ndarray, shape (S,)
        s.
    """

    facade_map: FacadeMap
    poses: Array
    scans: list[FacadePoints]
    stamps: Array


@one_line_errors
def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; the exit code is 1 if a goal is missed."""
    given = arguments("facades_kitti0005", __doc__ or "", argv, settings=str(SETTINGS))
    settings = read_config(given.options["settings"], HybridDriveSettings)
    frames = read_frames(given.data, settings.range_limits)
    assert given.data is not None
    starts = min(2, settings.starts) if given.quick else settings.starts
    facts: dict[str, Any] = {"quick": given.quick, "starts taken": starts, "frames": len(frames)}
    facts["reference"] = "registered to the same outlines: consistency, no error against truth"
    bench = Benchmark("facades_kitti0005", {**facts, **settings.model_dump()})
    began = time.perf_counter()
    street = read_street(given.data, frames, settings)
    bench.figure("seconds a scan, reduction", (time.perf_counter() - began) / len(frames), "s")
    bench.figure("points of facades a scan", float(np.mean([len(scan) for scan in street.scans])), "1")
    walls = WallLines(street.facade_map.facades)
    with progress_bar("drives", starts) as progress:
        tracks = []
        for number in range(starts):
            tracks.append(tracked(street, walls, settings, number))
            progress(number + 1)
    add_figures(bench, street, walls, tracks, settings)
    for name, most in settings.goals.items():
        if name not in bench.figures:
            raise ConfigError(f"goals: there is no figure '{name}'")
        bench.goal(name, *bench.figures[name], most)
    save_pictures(given, street, walls, tracks[0], settings)
    return bench.finish(given, drive_picture(street, tracks[0]))


def read_street(data: Path, frames: KittiFrames, settings: HybridDriveSettings) -> Street:
    """Buildings, and the reference in their frame.

    Raises
    ------
    DataError
        If the poses cannot be read.
    """
    import pyproj

    path = data / "kitti_raw_0005" / "reference_poses.npz"
    try:
        with np.load(path) as packed:
            T, zero, epsg = packed["T_utm_velo"], packed["utm_origin"], int(packed["epsg"])
        with np.load(data / "kitti_raw_0005" / "frames_every3_full.npz") as packed:
            T = T[packed["frame"]]
    except (OSError, ValueError, KeyError) as error:
        raise DataError(f"{path}: cannot be read ({error})") from error
    to_degrees = pyproj.Transformer.from_crs(epsg, 4326, always_xy=True)
    longitude, latitude = to_degrees.transform(*zero)
    outlines = read_buildings(data / BUILDINGS, origin=(longitude, latitude))
    facade_map = FacadeMap.from_outlines(outlines, MapUncertainty(settings.shift, settings.vertex))
    assert facade_map.frame is not None
    # A metre ahead is converted too, as grid north is not the north of the frame.
    ends = [T[:, :2, 3] + zero, T[:, :2, 3] + T[:, :2, 0] + zero]
    here, ahead = (facade_map.frame.from_geographic(np.column_stack(to_degrees.transform(*end.T))) for end in ends)
    heading = np.arctan2(*(ahead - here).T[::-1])
    scans = [facade_points(scan, settings.errors, settings.reduction) for scan in frames.scans]
    stamps = np.array([scan.stamp for scan in frames.scans])
    return Street(facade_map, np.column_stack([here, heading]), scans, stamps)


def tracked(street: Street, walls: WallLines, settings: HybridDriveSettings, number: int) -> FacadeTrack:
    """One drive from a start drawn in its box, with motions drawn within their bounds."""
    rng = np.random.default_rng((settings.seed, number))
    turn, odometry = np.radians(settings.start_turn), settings.localization.odometry
    start = street.poses[0] + rng.uniform(-1, 1, 3) * [settings.start_offset, settings.start_offset, turn]
    motions = se2.between(street.poses[:-1], street.poses[1:])
    # Errors are drawn within the bounds of what was measured, which are not wider than those of what was driven.
    motions = np.array([motion + 0.95 * rng.uniform(-1, 1, 3) * odometry.errors(motion) for motion in motions])
    box = Bounds.around(start, settings.start_offset, turn)
    return track_facades(street.scans, street.stamps, motions, walls, box, guess=start, settings=settings.localization)


def add_figures(
    bench: Benchmark, street: Street, walls: WallLines, tracks: list[FacadeTrack], settings: HybridDriveSettings
) -> None:
    """Consistency of feasible sets and estimates, bounded beside unbounded, over all drives."""
    covered, bounded, unbounded, outside, beyond, radii = [], [], [], [], [], []
    for track in tracks:
        assert track.result.bounds is not None
        coverage = bound_coverage(track.result.bounds, street.poses)
        covered.append(coverage.encloses)
        radii.append(coverage.radii)
        bounded.append(_away(track.result.trajectory.poses, street.poses))
        for k, step in enumerate(track.steps):
            if step.estimate is None or step.guess is None:
                continue
            free = estimate_in_bounds(
                street.scans[k], step.correspondences, walls, step.guess, None, conflicts=step.feasible.conflicts,
                prior=step.prior, settings=settings.localization.least_squares,
            )  # fmt: skip
            unbounded.append(_away(free.pose[None], street.poses[k : k + 1]))
            beyond.append(not step.feasible.bounds.contains(free.pose))
            outside.append(not step.feasible.bounds.contains(step.estimate.pose))
    steps = [step for track in tracks for step in track.steps]
    small, large, turn = np.nanmean(np.concatenate(radii), 0)
    bench.figure("feasible sets that hold the reference", float(np.concatenate(covered).mean()), "1")
    bench.figure("feasible sets without a pose", float(np.mean([step.feasible.violated for step in steps])), "1")
    bench.figure("mean smaller radius", small, "m")
    bench.figure("mean larger radius", large, "m")
    bench.figure("mean orientation radius", np.degrees(turn), "deg")
    bench.figure("correspondences a scan", float(np.mean([len(step.correspondences.found) for step in steps])), "1")
    bench.figure("of them failing at best", float(np.mean([step.feasible.failed for step in steps])), "1")
    for name, found in (("bounded", np.concatenate(bounded)), ("unbounded", np.concatenate(unbounded))):
        place, angle = ErrorStatistics.of(found[:, 0], "m", name), ErrorStatistics.of(found[:, 1], "deg", name)
        bench.figure(f"{name}: deviation of position, RMSE", place.rmse, "m")
        bench.figure(f"{name}: deviation of position, median", place.median, "m")
        bench.figure(f"{name}: deviation of position, largest", place.max, "m")
        bench.figure(f"{name}: deviation of heading, mean", float(found[:, 1].mean()), "deg")
        bench.figure(f"{name}: deviation of heading, largest", angle.max, "deg")
    bench.figure("bounded estimates outside their feasible set", float(np.mean(outside)), "1")
    bench.figure("unbounded estimates outside their feasible set", float(np.mean(beyond)), "1")
    seconds = float(np.median([track.result.seconds for track in tracks]))
    bench.figure("seconds a scan, localization", seconds / len(street.scans), "s")


def _away(poses: Array, reference: Array) -> Array:
    """Distances (m) and angles (deg), shape (N, 2)."""
    away = poses - reference
    return np.column_stack([np.hypot(away[:, 0], away[:, 1]), np.degrees(np.abs(wrap(away[:, 2])))])


def save_pictures(
    given: Arguments, street: Street, walls: WallLines, track: FacadeTrack, settings: HybridDriveSettings
) -> None:
    """Accumulator and associated points of the first scan, beside the picture of the drive."""
    turn = np.radians(settings.start_turn)
    start = Bounds.around(track.result.trajectory.poses[0], settings.start_offset, turn)
    found = find_correspondences(street.scans[0], walls, start, settings.localization.correspondences)
    strongest = max(found.found, key=lambda one: one.votes, default=None)
    if strongest is None:
        return
    row = int(np.flatnonzero(found.asked == strongest.facade)[0])
    accumulator = accumulator_of(street.scans[0], found.associated[row], walls, strongest.facade, start)
    of = np.full(len(street.scans[0]), -1)
    for one in found.found:
        of[found.associated[np.flatnonzero(found.asked == one.facade)[0]]] = one.facade
    assert track.result.bounds is not None
    points = se2.transform(track.result.trajectory.poses[0], street.scans[0].points)
    facade_map = street.facade_map
    pictures = {
        "accumulator": plot_accumulator(accumulator, accumulator.peak(settings.localization.correspondences.threshold)),
        "points": plot_associated_points(
            facade_map.facades.segments, points, of, bounds=track.result.bounds[0], attribution=facade_map.attribution
        ),
    }
    for name, picture in pictures.items():
        save_figure(picture, given.plot.with_stem(f"{given.plot.stem}_{name}"))


def drive_picture(street: Street, track: FacadeTrack) -> Figure:
    """Feasible sets and paths over the map."""
    assert track.result.bounds is not None
    return plot_feasible_sets(
        street.facade_map.facades.segments, track.result.bounds,
        {"bounded estimate": track.result.trajectory.poses, "reference": street.poses},
        every=5, attribution=street.facade_map.attribution,
    )  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
