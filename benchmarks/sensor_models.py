"""Sensor models compared on real drives (thesis, sections 7.6 and 8.5.2): a map of even scans, and odd ones in it.

Compared are maximum-likelihood maps (MLM) and full posteriors (FMP) of the reflection model (REF) and the decay-rate
model (DEC), the end-point model and a decay-rate model with noise. What a model has to choose besides is chosen on
training scans, each in the map of all the others: among it the floor under a maximum-likelihood map, without which a
single ray into a cell without hits has likelihood zero.

All was fixed in ``sensor_models.json`` before any result was known, but for sizes, cut down for time, and two changes
after a first look at three logs. Filters are not tempered (:mod:`benchmarks.filter_study`). And a second MLM and a
second FMP choose what they take unseen space for; by default that is the prior of the cells, whose mean is ruled by
walls and makes a ray without return that leaves the map all but impossible.

- Held-out scans: nats per ray at the true pose.
- Divergences between the likelihood of poses and the truth (:mod:`benchmarks.pose_divergence`).
- Monte Carlo localization, with and without failing rays (:mod:`benchmarks.filter_study`), and its error over time.
- Smoothing, with the models that have a factor.

Published figures stand beside; they are of other recordings, with another lidar, so only their order can be compared.
The poses of the logs are themselves good to 0.03 m only, and drive 0005 has but scan-to-map GICP: errors are deviations
from these.

A full run takes about an hour of one core. Until all is done it keeps the record of every model and scene beside the
JSON file: a run that was broken off goes on where it was, if neither settings nor code have changed.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.filter_study import Sigmas, Study, run_filters
from benchmarks.harness import Arguments, arguments, one_line_errors
from benchmarks.held_out import ends_of, weigh
from benchmarks.pose_divergence import diverge
from benchmarks.sensor_model_choices import FIELD, MODELS, Choices, choose, make_model
from benchmarks.sensor_model_records import Records
from benchmarks.sensor_model_scenes import SCENES, Scene, evenly, open_scene
from benchmarks.sensor_model_settings import Settings, Sizes
from benchmarks.sensor_models_findings import FIGURE_MODELS, FILTERED, Findings, ModelsBenchmark
from benchmarks.sensor_models_picture import models_picture
from benchmarks.sensor_models_tables import report
from benchmarks.smoother_study import smooth_scene
from factorloc import set_threads
from factorloc.config import read_config
from factorloc.errors import DataError

SETTINGS = Path(__file__).with_name("sensor_models.json")
PARTS = ("held-out", "divergences", "filters", "figure", "smoother")


@one_line_errors
def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; the exit code is 1 if a goal is missed."""
    about = (__doc__ or "").splitlines()[0]
    given = arguments("sensor_models", about, argv, scenes=("all",), parts=PARTS, settings=str(SETTINGS))
    settings = read_config(given.options["settings"], Settings)
    sizes = settings.quick if given.quick else settings.full
    chosen = given.options["scenes"]
    scenes, parts = list(sizes.scenes if "all" in chosen else chosen), set(given.options["parts"])
    facts: dict[str, Any] = {"quick": given.quick, **settings.model_dump(mode="json")}
    facts |= {"scenes": scenes, "parts": sorted(parts), "threads": given.threads}
    kept = given.json.with_suffix(".parts.json")
    smoothed = [name for name in scenes if name in settings.smoother.scenes and "smoother" in parts]
    with _bar(len(scenes) * (1 + len(MODELS)) + len(smoothed)) as progress, _workers(given.threads) as pool:
        records = Records(kept, facts, progress)
        for name in scenes:
            measure(name, given, settings, sizes, parts, records, pool)
        for name in smoothed:
            records.get(f"{name}/smoother", partial(smoothers, name, given, settings, sizes))
    bench = ModelsBenchmark("sensor_models", facts)
    facts["seconds (wall, processor)"] = records.seconds
    findings = Findings(records.values, scenes, settings.block)
    bench.tables = list(report(bench, findings, settings.filters, settings.gain))
    code = bench.finish(given, models_picture(findings, settings.filters))
    records.discard()
    return code


def measure(
    name: str, given: Arguments, settings: Settings, sizes: Sizes, parts: set[str], records: Records, pool: Executor
) -> None:
    """Make all records of a scene but those of the smoother."""
    opened: dict[str, Any] = {}

    def scene() -> Scene:
        if not opened:
            opened["scene"] = open_scene(name, given.data, settings.planar, settings.spatial)
        return opened["scene"]  # type: ignore[no-any-return]

    rays = settings.spatial.rays

    def choices() -> dict[str, Any]:
        return choose(scene(), settings.training, sizes.training_scans, rays, pool).model_dump()

    made = Choices(**records.get(f"{name}/choices", choices))

    def of_model(model: str) -> dict[str, Any]:
        here = scene()
        rows = evenly(len(here.held_out), sizes.held_out)
        if "ends" not in opened:
            opened["ends"] = list(
                pool.map(lambda row: ends_of(here.statistics, here.held_out[row], here.poses[row]), rows.tolist())
            )
        weigher = make_model(model, here, made)
        weigher.log_likelihood(here.held_out[0], here.poses[0])  # laid out once, before threads ask for it
        seed = settings.seed * len(SCENES) + SCENES.index(name)
        out: dict[str, Any] = {}
        if "held-out" in parts and model != FIELD:
            out["held-out"] = asdict(weigh(weigher, here, rows, opened["ends"], pool))
        if "divergences" in parts and model != FIELD:
            some = rows[evenly(len(rows), sizes.divergence_scans)]
            out["divergences"] = asdict(diverge(weigher, here, some, settings.divergence, rays, seed, pool))
        filters, figure = settings.filters, settings.figure

        def run(study: Study, start: Sigmas) -> list[list[float]]:
            scans = min(study.scans, sizes.filter_scans or study.scans)
            some = study.replaced(scans=scans)
            return run_filters(weigher, here, some, filters, start, sizes.runs, 100 * seed, pool)

        if "filters" in parts and model in FILTERED:
            out["filters"] = {study.name: run(study, filters.start) for study in filters.studies}
        if "figure" in parts and model in FIGURE_MODELS and name in figure.scenes:
            out["figure"] = run(Study(particles=figure.particles, scans=figure.scans), figure.start)
        return out

    for model in MODELS:
        records.get(f"{name}/{model}", partial(of_model, model))


def smoothers(name: str, given: Arguments, settings: Settings, sizes: Sizes) -> dict[str, dict[str, float]]:
    """Errors of tracking and smoothing by model."""
    if given.data is None:
        raise DataError("no real data: set FACTORLOC_DATA or give --data")
    return smooth_scene(
        name, given.data, settings.planar.resolution, settings.smoother.models, sizes.directions, sizes.smoothed_scans
    )


@contextmanager
def _workers(count: int) -> Iterator[Executor]:
    """So many threads that each run kernels on their own."""
    with ThreadPoolExecutor(count, initializer=set_threads, initargs=(1,)) as pool:
        yield pool


@contextmanager
def _bar(total: int) -> Iterator[Any]:
    """Show on stderr what is being done."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True, highlight=False)
    columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=console, transient=not console.is_terminal) as progress:
        task = progress.add_task("", total=total)
        done = -1

        def show(name: str) -> None:
            nonlocal done
            done += 1
            progress.update(task, completed=done, description=name)

        yield show


if __name__ == "__main__":
    sys.exit(main())
