"""All benchmarks, one after the other, each in a process of its own; says at the end which goals were met."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.table import Table

from benchmarks.harness import default_data, new_console, one_line_errors, yes_or_no

OUT = Path("out")


@dataclass(frozen=True)
class Run:
    """One benchmark with its arguments.

    Parameters
    ----------
    module : str
        Its name in this package.
    arguments : tuple of str
        What it is told besides the common arguments.
    needs_data : bool
        Whether it is left out without real data.
    """

    module: str
    arguments: tuple[str, ...] = ()
    needs_data: bool = False


RUNS = {
    "raycast": Run("raycast"),
    "solver": Run("solver"),
    "carmen-intel": Run("carmen", ("--log", "intel"), needs_data=True),
    "carmen-aces": Run("carmen", ("--log", "aces"), needs_data=True),
    "basin": Run("basin"),
    "kitti0005": Run("kitti0005", needs_data=True),
    "posterior_simulation": Run("posterior_simulation"),
    "sensor_models": Run("sensor_models", needs_data=True),
    "mcl_convergence": Run("mcl_convergence"),
    "mcl_speed": Run("mcl_speed"),
    "maps_large": Run("maps_large"),
    "poles_extraction": Run("poles_extraction"),
    "poles_kitti": Run("poles_kitti", needs_data=True),
    "poles_kitti_simulated": Run("poles_kitti_simulated", needs_data=True),
    "poles_longterm": Run("poles_longterm"),
    "poles_speed": Run("poles_speed"),
    "victoria_park": Run("victoria_park"),
    "interval_speed": Run("interval_speed"),
    "facades_districts": Run("facades_districts", needs_data=True),
    "facades_kitti0005": Run("facades_kitti0005", needs_data=True),
    "facades_simulated": Run("facades_simulated", needs_data=True),
    "interval_containment": Run("interval_containment"),
}
"""Every published table and ratio, by the name of its files."""


@one_line_errors
def main(argv: list[str] | None = None) -> int:
    """Run all benchmarks; the exit code is 1 if a goal was missed or a benchmark failed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--data", help="folder of real data (default: FACTORLOC_DATA, or ../shared/data)")
    parser.add_argument("--quick", action="store_true", help="fewer samples, never easier ones")
    parser.add_argument("--threads", type=int, help="threads of the kernels (default: all cores)")
    given = parser.parse_args(argv)
    common = ["--quick"] if given.quick else []
    common += ["--data", given.data] if given.data else []
    common += ["--threads", str(given.threads)] if given.threads else []
    without_data = not given.data and default_data() is None
    table = Table("benchmark", "goal", "value", "unit", "bound", "met", title="all goals", title_justify="left")
    good = True
    for name, run in RUNS.items():
        if run.needs_data and without_data:
            table.add_row(name, "left out: no real data")
            continue
        goals = execute(name, run, common)
        if goals is None:
            table.add_row(name, "[bold red]failed[/bold red]")
        for goal in goals or []:
            value = "not finite" if goal["value"] is None else f"{goal['value']:.4g}"
            table.add_row(name, goal["name"], value, goal["unit"], goal["bound"], yes_or_no(goal["met"]))
        table.add_section()
        good = good and goals is not None and all(goal["met"] for goal in goals)
    new_console().print(table)
    return 0 if good else 1


def execute(name: str, run: Run, common: Sequence[str]) -> list[dict[str, Any]] | None:
    """Run one benchmark and return the goals of the file it writes, or None if it writes none."""
    report = OUT / f"{name}.json"
    before = report.stat().st_mtime_ns if report.exists() else None
    files = ["--json", str(report), "--plot", str(report.with_suffix(".png"))]
    subprocess.run([sys.executable, "-m", f"benchmarks.{run.module}", *run.arguments, *common, *files], check=False)
    if not report.exists() or report.stat().st_mtime_ns == before:
        return None
    goals: list[dict[str, Any]] = json.loads(report.read_text(encoding="utf-8"))["goals"]
    return goals


if __name__ == "__main__":
    sys.exit(main())
