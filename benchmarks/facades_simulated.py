"""Hybrid localization in simulated districts: feasible sets of single scans and of drives, and the poses found in them.

(a) Single shots: every pose is known to 5 m along each axis and 5 degrees, drawn uniformly in that box. (b) Tracking
over drives of 500 m with odometry of bounded errors; the tables published by Ehambram, Jaulin and Wagner stand beside
it, as theirs come from tracking. Both with maps as OpenStreetMap has them and as cadastral LOD2 models do; the declared
uncertainty is exactly where the committed errors are cut. A set *encloses* a pose if the position is in one of its
polygons and the heading in its interval; an empty set encloses nothing, and counts as a failure. *Radii* are half sides
of the smallest rectangle around all polygons; empty sets have none and are left out of the means. A facade is *in
reach* within 40 m of the box, if it turns its outer side to some point of it and is seen from one of nine points spread
over it. With ``--lines true``, lines that are false are left out of drives, as only the truth can tell: what no better
association could go beyond, and no goal. The districts are in ``facades_districts.json``; what was chosen by hand was
chosen on their tuning split.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from benchmarks.bars import Bar, plot_columns
from benchmarks.facade_outcomes import PUBLISHED, PUBLISHED_ROWS, Outcomes, add_figures, kept
from benchmarks.facades_districts import SETTINGS as DISTRICTS
from benchmarks.facades_districts import District, DistrictSettings, districts, scan_cache
from benchmarks.facades_settings import SETTINGS, SimulatedSettings
from benchmarks.harness import Benchmark, arguments, one_line_errors
from benchmarks.machine import commit
from benchmarks.true_lines import true_lines
from factorloc.cli.console import progress_bar
from factorloc.config import read_config
from factorloc.errors import ConfigError, DataError
from factorloc.factors import PosePrior
from factorloc.localization import localize_by_particles
from factorloc.localization.facade_scan import localize_scan
from factorloc.localization.interval_tracking import track_facades
from factorloc.localization.wall_lines import WallLines
from factorloc.mapping.facade_likelihood import facade_likelihood
from factorloc.mapping.facade_points import FacadePoints, facade_points
from factorloc.result import Bounds
from factorloc.scan import Scan

PARTS = ("shots", "tracking")
LINES = ("found", "true")
AT_ONCE = {"shots": 50, "tracking": 1}
"""Poses and drives that are kept together."""
SAME = 1e-6
"""Steps the solver stops at, m and rad: nearer to each other, two of its estimates are one."""

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = npt.NDArray[np.float64]


@one_line_errors
def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; the exit code is 1 if a goal is missed."""
    given = arguments(
        "facades_simulated", __doc__ or "", argv, settings=str(SETTINGS), districts=str(DISTRICTS), split="reported",
        shots=0, drives=0, cache="", outcomes="", parts=PARTS, lines="found",
    )  # fmt: skip
    options = given.options
    if options["lines"] not in LINES:
        raise ConfigError(f"lines: '{options['lines']}' is none of {', '.join(LINES)}")
    if options["lines"] == "true":
        options["parts"] = ("tracking",)
    settings = read_config(options["settings"], SimulatedSettings)
    places = read_config(options["districts"], DistrictSettings)
    cache = Path(options["cache"]) if options["cache"] else scan_cache()
    shots = options["shots"] or (40 if given.quick else 10**6)
    drives = options["drives"] or (1 if given.quick else 10**6)
    facts = {
        "quick": given.quick,
        "lines": options["lines"],
        "split": options["split"],
        "poses a district": shots,
        "drives a district": drives,
    }
    bench = Benchmark("facades_simulated", {**facts, **settings.model_dump(), "districts": places.model_dump()})
    found: dict[str, dict[str, Outcomes]] = {part: {kind: Outcomes() for kind in settings.kinds} for part in PARTS}
    done = {"poses": 0, "drives": 0}
    folder = Path(options["outcomes"]) if options["outcomes"] else None
    for district in districts(places, options["split"], given.data):
        walls = {kind: WallLines(district.facade_map(kind).facades) for kind in settings.kinds}
        what = (
            commit(),
            settings.model_dump_json(),
            places.model_dump_json(),
            options["split"],
            options["lines"],
            district.name,
        )
        counts = {"shots": min(shots, district.shot_count), "tracking": min(drives, district.drive_count)}
        for part in options["parts"]:
            with progress_bar(f"{district.name}: {part}", counts[part]) as progress:
                for first in range(0, counts[part], AT_ONCE[part]):
                    rows = range(first, min(first + AT_ONCE[part], counts[part]))
                    new = kept(
                        folder, (*what, part, str(rows)),
                        partial(run_shots, district, walls, settings, cache, rows) if part == "shots"
                        else partial(run_drive, district, walls, settings, cache, first, options["lines"]),
                    )  # fmt: skip
                    for kind, outcomes in new.items():
                        found[part][kind].join(outcomes)
                    progress(rows.stop)
        done["poses"] += counts["shots"] if "shots" in options["parts"] else 0
        done["drives"] += counts["tracking"] if "tracking" in options["parts"] else 0
    for name, count in done.items():
        bench.figure(name, count, "1")
    for part in options["parts"]:
        for kind, outcomes in found[part].items():
            if not outcomes.sets:
                raise DataError(f"districts: no pose for {part}; ask for more")
            add_figures(bench, part, kind, outcomes, settings.well_conditioned)
            if options["lines"] == "found":
                add_goals(bench, part, kind, getattr(settings.kinds[kind], part))
    for table, values in PUBLISHED.items():
        for (row, unit), value in zip(PUBLISHED_ROWS, values, strict=True):
            bench.figure(f"published table {table}: {row}", value, unit)
    return bench.finish(given, _picture(bench, list(settings.kinds), options["parts"]))


def run_shots(
    district: District, walls: dict[str, WallLines], settings: SimulatedSettings, cache: Path, rows: range
) -> dict[str, Outcomes]:
    """Localize some single scans."""
    shots = district.shots(cache)
    found = {kind: Outcomes() for kind in walls}
    for k in rows:
        points = facade_points(shots.scans[k], settings.errors, settings.reduction)
        start = _start(shots.poses[k], settings, np.random.default_rng((settings.seed, district.seed, 0, k)))
        for kind, lines in walls.items():
            began = time.perf_counter()
            step = localize_scan(points, lines, start, settings=settings.shots)
            found[kind].seconds.append(time.perf_counter() - began)
            found[kind].add(
                step, points, lines, shots.poses[k], step.feasible.bounds, settings.shots, settings.one_direction
            )
    return found


def run_drive(
    district: District,
    walls: dict[str, WallLines],
    settings: SimulatedSettings,
    cache: Path,
    number: int,
    which: str = "found",
) -> dict[str, Outcomes]:
    """Track one drive, by intervals, by the lines that are found or the true ones of them, and by particles."""
    drive = district.drive(number, cache)
    found = {kind: Outcomes() for kind in walls}
    scans = [facade_points(scan, settings.errors, settings.reduction) for scan in drive.scans]
    stamps = np.arange(len(scans), dtype=np.float64)
    start = _start(drive.poses[0], settings, np.random.default_rng((settings.seed, district.seed, 1, number)))
    middle = np.array([*start.polygons[0].mean(0), np.mean(start.orientation)])
    for kind, lines in walls.items():
        chosen = settings.of_drives(kind)
        find = None if which == "found" else true_lines(scans, drive.poses, chosen.correspondences)
        track = track_facades(
            scans, stamps, drive.odometry, lines, start, guess=middle, motion_errors=drive.odometry_bounds,
            settings=chosen, find=find,
        )  # fmt: skip
        assert track.result.bounds is not None
        for k, (step, bounds) in enumerate(zip(track.steps, track.result.bounds, strict=True)):
            found[kind].add(step, scans[k], lines, drive.poses[k], bounds, chosen, settings.one_direction)
        found[kind].seconds += [track.result.seconds / len(scans)] * len(scans)
        reported = list(track.result.trajectory.poses)
        # Where a scan gave no estimate, the pose carried along by odometry is all there is, for both.
        free = found[kind].unbounded[-len(scans) :]
        found[kind].unbounded[-len(scans) :] = [
            pose if gone else one for pose, one, gone in zip(reported, free, track.violated, strict=True)
        ]
        found[kind].bounded[-len(scans) :] = reported
        found[kind].particles += list(_by_particles(scans, drive.odometry, lines, middle, settings, kind))
    return found


def _start(pose: Array, settings: SimulatedSettings, rng: np.random.Generator) -> Bounds:
    turn = np.radians(settings.start_heading)
    size = np.array([settings.start_position, settings.start_position, turn])
    return Bounds.around(pose + rng.uniform(-1, 1, 3) * size, settings.start_position, turn)


def _by_particles(
    scans: list[FacadePoints], odometry: Array, lines: WallLines, start: Array, settings: SimulatedSettings, kind: str
) -> Iterator[Array]:
    model = facade_likelihood(lines.facades, settings.kinds[kind].likelihood_sigma)
    planar = [Scan.from_points(scan.points, (0.1, 90.0), stamp=float(k)) for k, scan in enumerate(scans)]
    prior = PosePrior.from_sigmas(
        start, settings.start_position / np.sqrt(3.0), np.radians(settings.start_heading) / np.sqrt(3.0)
    )
    result = localize_by_particles(model, planar, odometry, prior, settings=settings.particles, seed=settings.seed)
    return iter(result.trajectory.poses)


def add_goals(bench: Benchmark, part: str, kind: str, goals: dict[str, tuple[float | None, float | None]]) -> None:
    """Judge figures, and bounded beside unbounded and particles."""
    where = f"{part}, {kind}"
    for name, (least, most) in goals.items():
        value, unit = bench.figures[f"{where}: {name}"]
        bench.goal(f"{where}: {name}", value, unit, np.inf if most is None else most, least)
    if part == "tracking":
        for name, unit in (("RMSE", "m"), ("angle", "deg")):
            bounded, free, particles = (
                bench.figures[f"{where}: {kind_of} {name}"][0] for kind_of in ("bounded", "unbounded", "MCL")
            )
            bench.goal(f"{where}: bounded {name} less unbounded", bounded - free, unit, SAME)
            bench.goal(f"{where}: bounded {name} less MCL's", bounded - particles, unit, 0.0)


def _picture(bench: Benchmark, kinds: list[str], parts: tuple[str, ...]) -> Figure:
    """Sizes of sets and errors of estimates, means over all poses, with their goals."""
    goals = {goal.name: goal.most for goal in bench.goals}

    def bar(where: str, name: str) -> Bar:
        value, unit = bench.figures[f"{where}: {name}"]
        return Bar(f"{name}, {unit}", value, (value, value), goals.get(f"{where}: {name}"))

    columns: dict[str, dict[str, list[Bar]]] = {kind: {} for kind in kinds}
    for kind, panels in columns.items():
        for part in parts:
            where = f"{part}, {kind}"
            panels[f"{part}: sets"] = [bar(where, f"{side} radius") for side in ("smaller", "larger", "orientation")]
            who = ("bounded", "unbounded", "MCL") if part == "tracking" else ("bounded",)
            panels[f"{part}: errors"] = [bar(where, f"{one} {of}") for of in ("RMSE", "angle") for one in who]
    return plot_columns(columns, "", "means; dashed: goal")


if __name__ == "__main__":
    sys.exit(main())
