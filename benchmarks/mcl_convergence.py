"""Convergence of Monte Carlo localization: from a guess, and from nothing, in drives all over an office.

A survey maps the office (30 m x 20 m); every run is another tour from another place, with noise of its own. From a
guess up to 2.5 m and 5 degrees off a run has converged if its estimate is near the truth at the last scan; without any
guess, from the first scan on from which the estimate stays near it until the last. A street is the same in space.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from pydantic import Field
from rich.table import Table

from benchmarks.harness import Benchmark, arguments, one_line_errors
from benchmarks.mcl_convergence_picture import convergence_picture
from benchmarks.mcl_outcomes import Outcome, measure, wilson
from benchmarks.mcl_scenes import Guess, LidarSettings, Office, Run, Runs, Street, StreetRuns
from benchmarks.timing import spread
from benchmarks.tours import TourSettings
from factorloc.config import Block, read_config
from factorloc.errors import ConfigError
from factorloc.localization import MonteCarloSettings, Particles
from factorloc.mapping.sensor_models import make_sensor_model
from factorloc.simulation import OdometryNoise

SETTINGS = Path(__file__).with_name("mcl_convergence.json")
GUESS, ANYWHERE, STREET = "guess", "anywhere", "street"
SHARE = "converged"

_QUICK = 10  # one of so many runs is left in a quick run


class Wheels(Block):
    """Noise of the simulated wheels (:class:`factorloc.simulation.OdometryNoise`).

    Parameters
    ----------
    alpha1, alpha2, alpha3, alpha4 : float
        Variances.
    """

    alpha1: float = Field(ge=0)
    alpha2: float = Field(ge=0)
    alpha3: float = Field(ge=0)
    alpha4: float = Field(ge=0)


class ConvergenceSettings(Block):
    """What ``mcl_convergence.json`` holds.

    Parameters
    ----------
    seed : int
        Of everything.
    resolution : float
        Edge length of a cell of the office's map, m.
    success : (float, float)
        An estimate nearer to the truth than this, m and deg, has converged.
    tours, lidar, odometry, period
        Drives through the office.
    models : tuple of str
        Sensor models. The first one is judged, and alone begins anywhere.
    filter : MonteCarloSettings
        Of the filter.
    guess, anywhere, street
        Runs.
    goals : dict of str to float
        Least share of runs that converge, %, by the name of the runs.
    """

    seed: int = Field(ge=0)
    resolution: float = Field(gt=0)
    success: tuple[float, float]
    tours: TourSettings
    lidar: LidarSettings
    odometry: Wheels
    period: float = Field(gt=0)
    models: tuple[str, ...] = Field(min_length=1)
    filter: MonteCarloSettings
    guess: Guess
    anywhere: Runs
    street: StreetRuns
    goals: dict[str, float]


class ConvergenceBenchmark(Benchmark):
    """Figures of all kinds of runs side by side."""

    def _figure_table(self) -> Table:
        names = list(dict.fromkeys(name.split(": ")[1] for name in self.figures))
        kinds = list(dict.fromkeys(name.split(": ")[0] for name in self.figures))
        table = Table("figure", title=self.name, title_justify="left")
        for kind in kinds:
            table.add_column(kind.replace(", ", "\n"), justify="right")
        table.add_column("unit")
        for name in names:
            units = [self.figures[full][1] for kind in kinds if (full := f"{kind}: {name}") in self.figures]
            table.add_row(name, *(self._cell(f"{kind}: {name}") for kind in kinds), units[0])
        return table

    def _cell(self, name: str) -> str:
        return f"{self.figures[name][0]:.3g}" if name in self.figures else ""


@one_line_errors
def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; the exit code is 1 if a goal is missed."""
    given = arguments("mcl_convergence", __doc__ or "", argv, kinds=(GUESS, ANYWHERE, STREET), settings=str(SETTINGS))
    settings = read_config(given.options["settings"], ConvergenceSettings)
    unknown = (set(given.options["kinds"]) | set(settings.goals)) - {GUESS, ANYWHERE, STREET}
    if unknown:
        raise ConfigError(f"runs {min(unknown)}: unknown; take {GUESS}, {ANYWHERE} or {STREET}")
    facts: dict[str, object] = {}
    bench = ConvergenceBenchmark(
        "mcl_convergence", {"quick": given.quick, **settings.model_dump(mode="json"), "scenes": facts}
    )
    every = _QUICK if given.quick else 1
    curves: dict[str, list[Outcome]] = {}
    cloud: list[Particles] = []
    kinds = [kind for kind in (GUESS, ANYWHERE) if kind in given.options["kinds"]]
    office = None
    if kinds:
        wheels = OdometryNoise(**settings.odometry.model_dump())
        office = Office(
            settings.tours, settings.lidar.lidar, wheels, settings.period, settings.resolution, settings.seed
        )
        facts["office"] = {
            "size, m": office.size,
            "survey, m": round(office.survey_length, 1),
            "scans in the map": office.statistics.scans,
            "free space, m2": round(len(office.free_space.cells) * settings.resolution**2, 1),
        }
    for kind in kinds:
        assert office is not None
        runs: Runs = settings.guess if kind == GUESS else settings.anywhere
        for name in settings.models if kind == GUESS else settings.models[:1]:
            model = make_sensor_model(office.statistics, name)
            who = f"{kind}, {name}"
            curves[who] = measure(
                range(0, runs.runs, every), _drives(office, runs), model, settings.filter, settings.success,
                office.free_space, cloud.append if kind == ANYWHERE else None,
            )  # fmt: skip
            add_figures(bench, who, curves[who])
    if STREET in given.options["kinds"]:
        street = Street(settings.street, settings.seed)
        facts["street"] = {"scans in the map": street.statistics.scans, "bytes of the map": street.statistics.nbytes}
        who = f"{STREET}, {settings.models[0]}"
        model = make_sensor_model(street.statistics, settings.models[0])
        drawn = range(0, settings.street.runs, 3 if given.quick else 1)
        curves[who] = measure(drawn, street.run, model, settings.filter, settings.success, None)
        add_figures(bench, who, curves[who])
    for kind, least in settings.goals.items():
        who = f"{kind}, {settings.models[0]}: {SHARE}"
        if who in bench.figures:
            bench.goal(who, *bench.figures[who], least=least)
    return bench.finish(given, convergence_picture(curves, settings.success, office, cloud))


def _drives(office: Office, runs: Runs) -> Callable[[int], Run]:
    return lambda number: office.run(number, runs.scans, runs if isinstance(runs, Guess) else None)


def add_figures(bench: Benchmark, who: str, outcomes: Sequence[Outcome]) -> None:
    """Add what runs of one kind came to."""
    first = np.array([one.converged_at for one in outcomes if one.converged_at is not None], np.float64)
    low, high = wilson(len(first), len(outcomes))
    bench.figure(f"{who}: runs", len(outcomes), "1")
    bench.figure(f"{who}: {SHARE}", 100 * len(first) / len(outcomes), "%", (100 * low, 100 * high))
    bench.figure(f"{who}: {SHARE}, Wilson interval from", 100 * low, "%")
    bench.figure(f"{who}: {SHARE}, Wilson interval to", 100 * high, "%")
    for name, quantile in (("median", 0.5), ("95 % of runs", 0.95)):
        value = float(np.quantile(first, quantile)) if len(first) else np.nan
        bench.figure(f"{who}: first of the scans that are all near, {name}", value, "scan")
    done = [one for one in outcomes if one.converged_at is not None]
    for name, unit, values in (
        ("position error at the end, median", "m", [one.position[-1] for one in done]),
        ("heading error at the end, median", "deg", [one.heading[-1] for one in done]),
    ):
        bench.figure(f"{who}: {name}", float(np.median(values)) if values else np.nan, unit)
    weighed = np.concatenate([one.weighed for one in outcomes])
    bench.figure(f"{who}: NEES per degree of freedom", weighed.mean() if len(weighed) else np.nan, "1")
    bench.figure(f"{who}: NEES per degree of freedom, median", np.median(weighed) if len(weighed) else np.nan, "1")
    bench.figure(f"{who}: particles, mean", float(np.mean([one.particles for one in outcomes])), "1")
    bench.figure(f"{who}: runs that looked elsewhere", sum(one.recoveries > 0 for one in outcomes), "1")
    bench.figure(f"{who}: looks elsewhere a run", float(np.mean([one.recoveries for one in outcomes])), "1")
    times = np.array([one.milliseconds for one in outcomes])
    bench.figure(f"{who}: a scan, median over runs", np.median(times), "ms", spread(times))


if __name__ == "__main__":
    sys.exit(main())
