"""A map of fifty million rays in two gigabytes: a town driven through in several sessions, streamed scan by scan.

Scans of an HDL-64E in a simulated town are cast, mapped into bricks in blocks, and forgotten, in a process of its own
whose peak memory is measured. No ray is cast twice. Each session makes a partial map besides, walked in other blocks:
merged in any order, these are the streamed map to the last bit. It is written, read again, and a region of it is read
alone. The picture is drawn from the file, slab by slab.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.harness import Arguments, Benchmark, arguments, one_line_errors
from benchmarks.maps_large_picture import large_picture
from benchmarks.maps_large_settings import LargeSettings
from benchmarks.maps_large_stream import JOB, MAP, REPORT
from factorloc.config import read_config
from factorloc.errors import FactorlocError
from factorloc.files import write_text
from factorloc.mapping import read_map
from factorloc.mapping.storage import read_map_info
from factorloc.mapping.top_view import top_view

Array = npt.NDArray[np.float64]

SETTINGS = Path(__file__).with_name("maps_large.json")

_SLAB = 20.0  # m of the map that are read at a time to draw it


@one_line_errors
def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; the exit code is 1 if a goal is missed."""
    given = arguments("maps_large", __doc__ or "", argv, settings=str(SETTINGS), columns=0)
    settings = read_config(given.options["settings"], LargeSettings)
    with tempfile.TemporaryDirectory() as folder:
        report = run_apart(Path(folder), settings, given)
        view, extent = view_of(Path(folder) / MAP)
    facts = {"quick": given.quick, "threads": given.threads, "lidar": "HDL-64E", "grid": report["grid"]}
    bench = Benchmark("maps_large", {**facts, "left out": report["left out"], **settings.model_dump()})
    add_figures(bench, report, settings, given.quick)
    memory = np.array(report["memory"]), [(at, name) for at, name in report["marks"]]
    return bench.finish(given, large_picture(view, extent, *memory, settings.goals.peak))


def run_apart(folder: Path, settings: LargeSettings, given: Arguments) -> dict[str, Any]:
    """Do the job in a process of its own; returns what it reports.

    Raises
    ------
    FactorlocError
        If it fails.
    """
    job = {"settings": settings.model_dump(), "quick": given.quick, "threads": given.threads}
    write_text(folder / JOB, json.dumps({**job, "columns": given.options["columns"]}))
    command = [sys.executable, "-m", "benchmarks.maps_large_stream", str(folder)]
    done = subprocess.run(command, stderr=subprocess.PIPE, text=True, check=False)
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        raise FactorlocError(f"process that maps: {last.removeprefix('error: ')}")
    report: dict[str, Any] = json.loads((folder / REPORT).read_text(encoding="utf-8"))
    return report


def add_figures(bench: Benchmark, report: dict[str, Any], settings: LargeSettings, quick: bool) -> None:
    """Add all figures and goals."""
    seconds = report["seconds"]
    for name, key in (("rays", "rays"), ("rays that differ from all others", "distinct"), ("visited cells", "cells")):
        bench.figure(name, report[key] / 1e6, "million")
    for name in ("scans", "bricks"):
        bench.figure(name, report[name], "1")
    for name in ("casting", "mapping", "mapping in parts"):
        bench.figure(f"{name}: rays", report["rays"] / seconds[name] / 1e6, "million/s")
    for name, value in seconds.items():
        bench.figure(f"{name}: time", value, "s")
    bench.figure("map in memory", report["bytes"] / 1e6, "MB")
    bench.figure("map in memory, a visited cell", report["bytes"] / report["cells"], "bytes")
    bench.figure("map in memory, a ray", report["bytes"] / report["rays"], "bytes")
    bench.figure("map as a file", report["file bytes"] / 1e6, "MB")
    bench.figure("cells of the region read alone", report["region cells"] / 1e6, "million")
    bench.figure("peak memory while streaming", report["peak while streaming"] / 1e9, "GB")
    bench.figure("peak memory with merging, writing and reading", report["peak"] / 1e9, "GB")
    if not quick:
        bench.goal(
            "rays that differ from all others", report["distinct"] / 1e6, "million", least=settings.goals.rays / 1e6
        )
    bench.goal("rays cast twice", report["rays"] - report["distinct"], "1", most=0)
    bench.goal("peak memory", report["peak"] / 1e9, "GB", most=settings.goals.peak)
    orders = report["merges equal"]
    bench.goal("orders of merging that give the streamed map", sum(orders), "1", least=len(orders))
    bench.goal("the map read again is equal", report["read equal"], "1", least=1)
    bench.goal("a region read alone is equal", report["region equal"], "1", least=1)


def view_of(path: Path) -> tuple[Array, tuple[float, float, float, float]]:
    """Map of a file from above, and its extent; read in slabs along x, of which only one is in memory."""
    grid = read_map_info(path).grid
    view = np.full(grid.shape[:2], np.nan)
    step = max(1, round(_SLAB / grid.resolution))
    for first in range(0, grid.shape[0], step):
        x = grid.origin[0] + grid.resolution * np.array([first, min(first + step, grid.shape[0])])
        slab = read_map(path, region=((x[0], *grid.origin[1:]), (x[1], *grid.upper[1:])))
        view[first : first + slab.grid.shape[0]] = top_view(slab)
    return view, grid.extent


if __name__ == "__main__":
    sys.exit(main())
