"""A real drive localized in an offline map: position and heading errors beside their floor and beside other methods.

The map is built from the even scans at their corrected poses; the odd ones are localized with raw odometry, tracked and
then smoothed, from starts 1 m off in eight directions and turned by 10 degrees. All runs count, from the first pose on.
The corrected poses are the truth only up to their own error, which the floor shows.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.carmen_study import (
    DIRECTIONS,
    Errors,
    Log,
    errors_of,
    localize_from_around,
    open_log,
    relation_errors,
    truth_floor,
    truth_of,
)
from benchmarks.harness import Arguments, Benchmark, arguments
from factorloc.evaluation import nees
from factorloc.localization import Localization, LocalizationSettings
from factorloc.result import Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GOALS = Path(__file__).with_name("carmen_goals.json")
NEES_RANGE = (0.5, 2.0)


def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; the exit code is 1 if a goal is missed."""
    given = arguments("carmen", __doc__ or "", argv, log="intel", calibrate_on="", resolution=0.1)
    if given.data is None:
        print("no real data: set FACTORLOC_DATA or give --data")
        return 2
    name, resolution = given.options["log"], given.options["resolution"]
    settings = LocalizationSettings()
    directions = 2 if given.quick else DIRECTIONS
    log = open_log(given.data, name, resolution)
    # The covariance factor is chosen on a log that is not reported on.
    other = given.options["calibrate_on"] or ("aces" if name != "aces" else "intel")
    bench = Benchmark(
        f"carmen {name}",
        {"log": name, "scans": len(log.localizing), "directions": directions, "quick": given.quick}
        | {"covariance factor from": other, "localization": settings.model_dump()},
    )
    runs = localize_from_around(log, settings, directions)
    smoothed = _add_errors(bench, "smoothed", [run.smoothed for run in runs], log)
    _add_errors(bench, "tracked", [run.tracked for run in runs], log)
    scans = directions * len(log.localizing)
    bench.figure("seconds a scan, tracked", sum(run.tracked.seconds for run in runs) / scans, "s")
    bench.figure("seconds a scan, smoothed", sum(run.smoothed.seconds for run in runs) / scans, "s")
    _add_floor(bench, log, resolution, settings)
    _add_consistency(bench, smoothed, open_log(given.data, other, resolution), settings)
    _add_rivals(bench, given, log, settings)
    relations = relation_errors(given.data, log, settings)
    if relations is not None:
        for unit, values, kind in (("m", relations[0], "position"), ("deg", np.degrees(relations[1]), "heading")):
            bench.figure(f"relations {kind} mean", values.mean(), unit)
            bench.figure(f"relations {kind} std", values.std(), unit)
    for goal, bound in json.loads(GOALS.read_text()).get(name, {}).items():
        figure = goal if goal in bench.figures else f"smoothed {goal}"
        value, unit = bench.figures[figure]
        bench.goal(figure, value, unit, bound)
    value, unit = bench.figures["NEES per degree of freedom, with covariance factor"]
    bench.goal("NEES per degree of freedom", value, unit, NEES_RANGE[1], NEES_RANGE[0])
    return bench.finish(given, _picture(log, runs))


def _add_errors(bench: Benchmark, kind: str, results: list[Result], log: Log) -> Errors:
    errors = errors_of([result.trajectory for result in results], truth_of(log.localizing))
    position, heading = errors.position, errors.heading
    bench.figure(f"{kind} position RMSE", position.rmse, "m")
    bench.figure(f"{kind} position median", position.median, "m")
    bench.figure(f"{kind} position 95 %", position.percentile_95, "m")
    bench.figure(f"{kind} position max", position.max, "m")
    bench.figure(f"{kind} heading RMSE", np.degrees(heading.rmse), "deg")
    return errors


def _add_floor(bench: Benchmark, log: Log, resolution: float, settings: LocalizationSettings) -> None:
    floor = truth_floor(log, resolution, settings)
    bench.figure("floor: noise of one map", floor.disagreement, "m")
    bench.figure("floor: error common to disjoint maps (the truth's own)", floor.common, "m")


def _add_consistency(bench: Benchmark, smoothed: Errors, other: Log, settings: LocalizationSettings) -> None:
    calibration = errors_of(
        [run.smoothed.trajectory for run in localize_from_around(other, settings, 1)], truth_of(other.localizing)
    )
    factor = calibration.nees
    assert factor is not None and smoothed.covariances is not None
    bench.figure("NEES per degree of freedom, as reported", smoothed.nees or np.nan, "1")
    bench.figure(f"covariance factor from {other.name}", factor, "1")
    value = nees(smoothed.tangent, factor * smoothed.covariances).mean
    bench.figure("NEES per degree of freedom, with covariance factor", value, "1")


def _add_rivals(bench: Benchmark, given: Arguments, log: Log, settings: LocalizationSettings) -> None:
    """Odometry alone, the end-point distance field, and the harder split into halves."""
    assert given.data is not None
    truth = truth_of(log.localizing)
    alone = errors_of([log.localizing.dead_reckoning(truth.poses[0])], truth)
    bench.figure("odometry alone position RMSE", alone.position.rmse, "m")
    bench.figure("odometry alone heading RMSE", np.degrees(alone.heading.rmse), "deg")
    directions = 1 if given.quick else DIRECTIONS
    field = localize_from_around(log, settings.replaced(model="distance-field"), directions)
    _add_errors(bench, "distance field", [run.smoothed for run in field], log)
    halves = open_log(given.data, log.name, given.options["resolution"], "halves")
    _add_errors(bench, "halves", [run.smoothed for run in localize_from_around(halves, settings, 1)], halves)


def _picture(log: Log, runs: list[Localization]) -> Figure:
    from factorloc.mapping import DecayRateMap
    from factorloc.viewer import plot_map_and_trajectories

    image = DecayRateMap.from_statistics(log.statistics).reflection_probability()
    image[log.statistics.path_fixed == 0] = np.nan
    truth = truth_of(log.localizing)
    paths = {
        "odometry": log.localizing.dead_reckoning(truth.poses[0]),
        "smoothed": runs[0].smoothed.trajectory,
        "corrected": truth,
    }
    return plot_map_and_trajectories(image, log.statistics.grid.extent, paths, reference="corrected")


if __name__ == "__main__":
    sys.exit(main())
