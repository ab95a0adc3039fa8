"""Hybrid localization in simulated districts: feasible sets of single scans and of drives, and the poses found in them.

(a) Single shots: every pose is known to 5 m along each axis and 5 degrees, drawn uniformly in that box. (b) Tracking
over drives of 500 m with odometry of bounded errors; the tables published by Ehambram, Jaulin and Wagner stand beside
it, as theirs come from tracking. Both with maps as OpenStreetMap has them and as cadastral LOD2 models do; the declared
uncertainty is exactly where the committed errors are cut. A set *encloses* a pose if the position is in one of its
polygons and the heading in its interval; an empty set encloses nothing, and counts as a failure. *Radii* are half sides
of the smallest rectangle around all polygons; empty sets have none and are left out of the means. A facade is *in
reach* within 40 m of the box, if it turns its outer side to some point of it and is seen from one of nine points spread
over it. The districts are in ``facades_districts.json``; what was chosen by hand was chosen on their tuning split.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt
from pydantic import Field

from benchmarks.bars import Bar, plot_bars
from benchmarks.facades_districts import SETTINGS as DISTRICTS
from benchmarks.facades_districts import District, DistrictSettings, districts, scan_cache
from benchmarks.harness import Benchmark, arguments, one_line_errors
from factorloc.cli.console import progress_bar
from factorloc.config import Block, read_config
from factorloc.errors import DataError
from factorloc.evaluation.bounds import bound_coverage
from factorloc.factors import PosePrior
from factorloc.geometry import wrap
from factorloc.localization import MonteCarloSettings, localize_by_particles
from factorloc.localization.bounded_least_squares import estimate_in_bounds
from factorloc.localization.interval_tracking import FacadeSettings, FacadeStep, localize_scan, track_facades
from factorloc.localization.wall_lines import WallLines
from factorloc.mapping.facade_likelihood import facade_likelihood
from factorloc.mapping.facade_points import FacadePoints, ReductionSettings, ScanErrors, facade_points
from factorloc.result import Bounds
from factorloc.scan import Scan

SETTINGS = Path(__file__).with_name("facades_simulated.json")

Array = npt.NDArray[np.float64]

PUBLISHED = {
    "I, LOD2": (0.998, 0.91, 4.2, 1.8, 0.237, 0.241, 0.81, 0.339, 0.343, 0.75, 0.0, 0.00725),
    "II, OSM": (0.998, 1.79, 5.23, 2.39, 0.615, 0.645, 0.85, 0.818, 0.843, 0.83, 0.0, 0.04178),
    "III, KITTI 0027, OSM": (1.0, 1.94, 3.48, 2.7, 1.12, 1.3, 1.18, 1.149, 1.78, 1.2, 0.0, 0.117),
}
"""Published tables: encloses, radii (m, m, deg), RMSE (m) and mean angle (deg) bounded, unbounded and of MCL, and
shares of results outside the feasible set, bounded and unbounded."""

PUBLISHED_ROWS = (
    ("encloses", "1"), ("smaller radius", "m"), ("larger radius", "m"), ("orientation radius", "deg"),
    ("bounded RMSE", "m"), ("unbounded RMSE", "m"), ("MCL RMSE", "m"), ("bounded angle", "deg"),
    ("unbounded angle", "deg"), ("MCL angle", "deg"), ("bounded outside", "1"), ("unbounded outside", "1"),
)  # fmt: skip


class KindSettings(Block):
    """What belongs to one kind of map.

    Parameters
    ----------
    likelihood_sigma : float
        Standard deviation of the facade likelihood of the particle filter, m.
    shots, tracking : dict of str to (float or None, float or None)
        Least and most of figures.
    """

    likelihood_sigma: float = Field(gt=0)
    shots: dict[str, tuple[float | None, float | None]]
    tracking: dict[str, tuple[float | None, float | None]]


class SimulatedSettings(Block):
    """What ``facades_simulated.json`` holds.

    Parameters
    ----------
    seed : int
        Of starts and particles.
    start_position, start_heading : float
        Half sides of the box a pose is known to be in, m and deg.
    errors : ScanErrors
        Bounds of the points.
    reduction : ReductionSettings
        Of scans.
    shots, tracking : FacadeSettings
        Of single scans, and of drives.
    particles : MonteCarloSettings
        Of the particle filter.
    one_direction : float
        A pose sees one direction only if all correspondences are within this of parallel, deg.
    well_conditioned : float
        Largest smaller and larger radius of a well-conditioned pose, m.
    kinds : dict of str to KindSettings
        By kind of map.
    """

    seed: int = Field(ge=0)
    start_position: float = Field(gt=0)
    start_heading: float = Field(gt=0)
    errors: ScanErrors
    reduction: ReductionSettings
    shots: FacadeSettings
    tracking: FacadeSettings
    particles: MonteCarloSettings
    one_direction: float = Field(gt=0)
    well_conditioned: float = Field(gt=0)
    kinds: dict[str, KindSettings]


@dataclass
class Outcomes:
    """What is collected over poses.

    Parameters
    ----------
    sets : list of Bounds
        Feasible sets, empty ones too.
    truth : list of ndarray
        True poses.
    bounded, unbounded, particles : list of ndarray
        Estimates; NaN where there is none.
    outside : list of (bool, bool)
        Whether the bounded and the unbounded estimate are outside of their set.
    violated, single : list of bool
        Whether assumptions were violated, and whether facades of one direction only were found.
    seconds : list of float
        A pose.
    """

    sets: list[Bounds] = field(default_factory=list)
    truth: list[Array] = field(default_factory=list)
    bounded: list[Array] = field(default_factory=list)
    unbounded: list[Array] = field(default_factory=list)
    particles: list[Array] = field(default_factory=list)
    outside: list[tuple[bool, bool]] = field(default_factory=list)
    violated: list[bool] = field(default_factory=list)
    single: list[bool] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)


@one_line_errors
def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; the exit code is 1 if a goal is missed."""
    given = arguments(
        "facades_simulated", __doc__ or "", argv, settings=str(SETTINGS), districts=str(DISTRICTS), split="reported",
        shots=0, drives=0, cache="", parts=("shots", "tracking"),
    )  # fmt: skip
    options = given.options
    settings = read_config(options["settings"], SimulatedSettings)
    places = read_config(options["districts"], DistrictSettings)
    cache = Path(options["cache"]) if options["cache"] else scan_cache()
    shots = options["shots"] or (40 if given.quick else 10**6)
    drives = options["drives"] or (1 if given.quick else 10**6)
    facts = {"quick": given.quick, "split": options["split"], "poses a district": shots, "drives a district": drives}
    bench = Benchmark("facades_simulated", {**facts, **settings.model_dump(), "districts": places.model_dump()})
    found: dict[str, dict[str, Outcomes]] = {part: {kind: Outcomes() for kind in settings.kinds} for part in PARTS}
    done = {"poses": 0, "drives": 0}
    for district in districts(places, options["split"], given.data):
        maps = {kind: district.facade_map(kind) for kind in settings.kinds}
        walls = {kind: WallLines(one.facades) for kind, one in maps.items()}
        if "shots" in options["parts"]:
            done["poses"] += run_shots(district, walls, settings, cache, shots, found["shots"])
        if "tracking" in options["parts"]:
            done["drives"] += run_drives(district, walls, settings, cache, drives, found["tracking"])
    for name, count in done.items():
        bench.figure(name, count, "1")
    for part in options["parts"]:
        for kind, outcomes in found[part].items():
            if not outcomes.sets:
                raise DataError(f"districts: no pose for {part}; ask for more")
            add_figures(bench, part, kind, outcomes, settings)
            add_goals(bench, part, kind, getattr(settings.kinds[kind], part))
    for table, values in PUBLISHED.items():
        for (row, unit), value in zip(PUBLISHED_ROWS, values, strict=True):
            bench.figure(f"published table {table}: {row}", value, unit)
    return bench.finish(given, plot_bars(_panels(bench, options["parts"]), "m or deg", share=False))


PARTS = ("shots", "tracking")


def run_shots(
    district: District, walls: dict[str, WallLines], settings: SimulatedSettings, cache: Path, most: int,
    found: dict[str, Outcomes],
) -> int:  # fmt: skip
    """Localize single scans; returns how many."""
    shots = district.shots(cache)
    count = min(most, len(shots))
    rng = np.random.default_rng((settings.seed, district.seed, 0))
    with progress_bar(f"{district.name}: poses", count) as progress:
        for k in range(count):
            points = facade_points(shots.scans[k], settings.errors, settings.reduction)
            start = _start(shots.poses[k], settings, rng)
            for kind, lines in walls.items():
                began = time.perf_counter()
                step = localize_scan(points, lines, start, settings=settings.shots)
                _add(found[kind], step, points, lines, shots.poses[k], step.feasible.bounds, settings.shots)
                found[kind].seconds.append(time.perf_counter() - began)
            progress(k + 1)
    return count


def run_drives(
    district: District, walls: dict[str, WallLines], settings: SimulatedSettings, cache: Path, most: int,
    found: dict[str, Outcomes],
) -> int:  # fmt: skip
    """Track drives, by intervals and by particles; returns how many."""
    count = min(most, district.drive_count)
    with progress_bar(f"{district.name}: drives", count) as progress:
        for number in range(count):
            drive = district.drive(number, cache)
            scans = [facade_points(scan, settings.errors, settings.reduction) for scan in drive.scans]
            stamps = np.arange(len(scans), dtype=np.float64)
            start = _start(drive.poses[0], settings, np.random.default_rng((settings.seed, district.seed, 1, number)))
            middle = np.array([*start.polygons[0].mean(0), np.mean(start.orientation)])
            for kind, lines in walls.items():
                track = track_facades(
                    scans, stamps, drive.odometry, lines, start, guess=middle, motion_errors=drive.odometry_bounds,
                    settings=settings.tracking,
                )  # fmt: skip
                assert track.result.bounds is not None
                for k, (step, bounds) in enumerate(zip(track.steps, track.result.bounds, strict=True)):
                    _add(found[kind], step, scans[k], lines, drive.poses[k], bounds, settings.tracking)
                found[kind].seconds += [track.result.seconds / len(scans)] * len(scans)
                found[kind].bounded[-len(scans) :] = list(track.result.trajectory.poses)
                found[kind].particles += list(_by_particles(scans, drive.odometry, lines, middle, settings, kind))
            progress(number + 1)
    return count


def _start(pose: Array, settings: SimulatedSettings, rng: np.random.Generator) -> Bounds:
    turn = np.radians(settings.start_heading)
    size = np.array([settings.start_position, settings.start_position, turn])
    return Bounds.around(pose + rng.uniform(-1, 1, 3) * size, settings.start_position, turn)


def _add(
    found: Outcomes,
    step: FacadeStep,
    points: FacadePoints,
    lines: WallLines,
    pose: Array,
    bounds: Bounds,
    settings: FacadeSettings,
) -> None:
    found.sets.append(bounds)
    found.truth.append(pose)
    found.violated.append(step.feasible.violated)
    normals = lines.normals[[one.facade for one in step.correspondences.found]]
    found.single.append(len(normals) == 0 or float(np.abs(normals @ normals[0]).min()) > np.cos(np.radians(20.0)))
    if step.estimate is None or step.guess is None:
        found.bounded.append(np.full(3, np.nan))
        found.unbounded.append(np.full(3, np.nan))
        return
    free = estimate_in_bounds(
        points, step.correspondences, lines, step.guess, None, conflicts=step.feasible.conflicts, prior=step.prior,
        settings=settings.least_squares,
    )  # fmt: skip
    found.bounded.append(step.estimate.pose)
    found.unbounded.append(free.pose)
    found.outside.append(
        (not step.feasible.bounds.contains(step.estimate.pose), not step.feasible.bounds.contains(free.pose))
    )


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


def add_figures(bench: Benchmark, part: str, kind: str, found: Outcomes, settings: SimulatedSettings) -> None:
    """Add coverage, radii and errors of one kind of map."""
    truth = np.array(found.truth)
    coverage = bound_coverage(found.sets, truth)
    violated = np.array(found.violated)
    where = f"{part}, {kind}"
    # A violated scan has no set of its own; what odometry carries along does not count for it.
    bench.figure(f"{where}: encloses", float((coverage.encloses & ~violated).mean()), "1")
    if part == "tracking":
        bench.figure(f"{where}: encloses, sets carried along counted", coverage.share, "1")
    bench.figure(f"{where}: assumptions violated", float(violated.mean()), "1")
    for name, values, unit in zip(
        ("smaller radius", "larger radius", "orientation radius"),
        (coverage.radii * [1.0, 1.0, np.degrees(1.0)]).T, ("m", "m", "deg"), strict=True,
    ):  # fmt: skip
        bench.figure(f"{where}: {name}", float(np.nanmean(values)), unit)
        bench.figure(f"{where}: {name}, median", float(np.nanmedian(values)), unit)
    bench.figure(f"{where}: one direction only", float(np.mean(found.single)), "1")
    good = coverage.radii[:, 1] <= settings.well_conditioned
    bench.figure(f"{where}: well conditioned", float(good.mean()), "1")
    estimates = {"bounded": found.bounded, "unbounded": found.unbounded, "MCL": found.particles}
    for name, poses in estimates.items():
        if len(poses) != len(truth):
            continue
        away = np.array(poses) - truth
        place, angle = np.hypot(away[:, 0], away[:, 1]), np.degrees(np.abs(wrap(away[:, 2])))
        there = np.isfinite(place)
        bench.figure(f"{where}: {name} RMSE", float(np.sqrt(np.mean(place[there] ** 2))), "m")
        bench.figure(f"{where}: {name} median", float(np.median(place[there])), "m")
        bench.figure(f"{where}: {name} RMSE, well conditioned", _rms(place[there & good]), "m")
        bench.figure(f"{where}: {name} largest", float(place[there].max()), "m")
        bench.figure(f"{where}: {name} angle", float(angle[there].mean()), "deg")
        bench.figure(f"{where}: {name} largest angle", float(angle[there].max()), "deg")
    outside = np.array(found.outside, np.float64).reshape(-1, 2)
    bench.figure(f"{where}: bounded outside", float(outside[:, 0].mean()) if len(outside) else np.nan, "1")
    bench.figure(f"{where}: unbounded outside", float(outside[:, 1].mean()) if len(outside) else np.nan, "1")
    bench.figure(f"{where}: seconds a pose", float(np.median(found.seconds)), "s")


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else np.nan


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
            bench.goal(f"{where}: bounded {name} less unbounded", bounded - free, unit, 0.0)
            bench.goal(f"{where}: bounded {name} less MCL's", bounded - particles, unit, 0.0)


def _panels(bench: Benchmark, parts: tuple[str, ...]) -> dict[str, list[Bar]]:
    panels = {}
    for part in parts:
        names = [name for name in bench.figures if name.startswith(part) and name.endswith("radius")]
        panels[f"{part}: radii"] = [
            Bar(name.removeprefix(f"{part}, "), bench.figures[name][0], (bench.figures[name][0],) * 2) for name in names
        ]
    return panels


if __name__ == "__main__":
    sys.exit(main())
