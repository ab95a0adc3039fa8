"""Tables of localization with each sensor model, beside what was published."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
from rich.table import Table

from benchmarks.harness import Benchmark
from benchmarks.held_out import paired_p
from benchmarks.sensor_models_findings import BEST, FILTERED, Findings, new_table

__all__ = ["filter_table", "smoother_table"]

Array = npt.NDArray[np.float64]

PUBLISHED_FILTERS = {
    "Campus": (0.230, 0.284, 0.280),
    "Campus, failures": (0.252, 0.284, 0.366),
    "Forest": (0.331, 0.352, 0.417),
    "Park": (0.088, 0.089, 0.124),
}


def filter_table(bench: Benchmark, found: Findings, study: str) -> Table:
    """Add the errors of Monte Carlo localization in a study (table 7.2), and return their table."""
    table = new_table(
        f"{study}: mean position error, m, of Monte Carlo localization, +- its standard error over the runs "
        f"(median, and p that {BEST} is not better)",
        "scene", *FILTERED,
    )  # fmt: skip
    every: dict[str, list[Array]] = {model: [] for model in FILTERED}
    for scene in found.scenes:
        runs = {model: found.errors(scene, model, study) for model in FILTERED}
        known = {model: errors for model, errors in runs.items() if errors is not None}
        for model, errors in known.items():
            every[model].append(errors)
        table.add_row(scene, *_errors(bench, f"{scene}, {study}", known))
    table.add_section()
    table.add_row("all", *_errors(bench, f"all, {study}", {m: np.concatenate(parts) for m, parts in every.items()}))
    table.add_section()
    for name, (dec, ref, end) in PUBLISHED_FILTERS.items():
        if ("failures" in name) == ("failures" in study):
            table.add_row(f"published: {name}", "", f"{dec:.3f}", "", f"{ref:.3f}", f"{end:.3f}")
    return table


def _errors(bench: Benchmark, where: str, runs: Mapping[str, Array]) -> list[str]:
    cells = []
    for model, errors in runs.items():
        deviation = errors.std(ddof=1) / np.sqrt(len(errors))
        p = paired_p(errors, runs[BEST])
        bench.figure(f"{where}, {model}: position error", errors.mean(), "m")
        bench.figure(f"{where}, {model}: standard error", deviation, "m")
        bench.figure(f"{where}, {model}: median over the runs", np.median(errors), "m")
        bench.figure(f"{where}, {model}: runs off by more than 1 m", 100 * (errors > 1).mean(), "%")
        if model != BEST:
            bench.figure(f"{where}, {model}: p that {BEST} is not better", p, "1")
        tested = "" if model == BEST else f", {p:.1g}"
        cells.append(f"{errors.mean():.3f} +- {deviation:.3f}\n({np.median(errors):.3f}{tested})")
    return cells


def smoother_table(bench: Benchmark, found: Findings, scenes: Sequence[str]) -> Table:
    """Add the errors of tracking and smoothing, and return their table."""
    table = new_table(
        "position RMSE of tracking and smoothing, m; rotation, deg",
        "scene", "model", "tracked", "smoothed", "rotation", "ms a scan",
    )  # fmt: skip
    for scene in scenes:
        for model, errors in found.values[f"{scene}/smoother"].items():
            for name, unit in (("tracked", "m"), ("smoothed", "m"), ("rotation", "deg"), ("seconds", "s")):
                bench.figure(f"{scene}, {model}: {name}", errors[name], unit)
            table.add_row(
                scene, model, f"{errors['tracked']:.4f}", f"{errors['smoothed']:.4f}", f"{errors['rotation']:.3f}",
                f"{1e3 * errors['seconds']:.1f}",
            )  # fmt: skip
        table.add_section()
    return table
