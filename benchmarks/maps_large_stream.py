"""The process of :mod:`benchmarks.maps_large`: casts scans one after the other, maps them, merges, writes and reads.

It is a process of its own, so that its peak memory is nobody else's: ``python -m benchmarks.maps_large_stream FOLDER``
reads ``job.json`` there and leaves ``map.h5`` and ``report.json`` behind. No scan is kept for longer than the block it
is mapped in.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.harness import one_line_errors
from benchmarks.maps_large_settings import Job, LargeSettings
from benchmarks.ray_census import Census, Stream, same
from benchmarks.resident_memory import MemoryCurve, peak_resident
from factorloc import set_threads
from factorloc.config import read_config
from factorloc.errors import ConfigError
from factorloc.files import write_text
from factorloc.mapping import BrickStatistics, Grid, read_map, write_map
from factorloc.scan import Scan
from factorloc.simulation import Sessions, SpatialLidar, Town, hdl_64e, simulate_drive

__all__ = ["JOB", "MAP", "REPORT", "region_of", "session_scans", "stream_map"]

Array = npt.NDArray[np.float64]

MAP, PART, JOB, REPORT = "map.h5", "part_{}.h5", "job.json", "report.json"


@one_line_errors
def work(argv: list[str] | None = None) -> int:
    """Do the job of a folder."""
    folder = Path((argv or sys.argv[1:])[0])
    job = read_config(folder / JOB, Job)
    set_threads(job.threads)
    with MemoryCurve() as curve:
        report = stream_map(job, folder, curve)
    report |= {"memory": curve.samples.tolist(), "marks": curve.marks, "peak": peak_resident()}
    write_text(folder / REPORT, json.dumps(report))
    return 0


def stream_map(job: Job, folder: Path, curve: MemoryCurve) -> dict[str, Any]:
    """Cast, map, merge, write and read; returns figures by name."""
    settings = job.settings
    town = Town(settings.town, settings.seed)
    census, cast = Census(), 0.0
    whole, part_bytes, part_seconds = Stream(empty_map(town, settings), settings.block_rays), [], 0.0
    for number in range(settings.count):
        curve.mark(f"session {number}")
        part = Stream(empty_map(town, settings), settings.part_block_rays)
        began = time.perf_counter()
        for scan, pose in session_scans(town, number, job):
            cast += time.perf_counter() - began
            census.take(scan, pose)
            whole.take(scan, pose)
            part.take(scan, pose)
            began = time.perf_counter()
        part_bytes.append(part.flush().nbytes)
        write_map(folder / PART.format(number), part.flush(), provenance={"source": "simulated town"})
        part_seconds += part.seconds
    statistics, mapping = whole.flush(), whole.seconds
    streamed, ended = peak_resident(), curve.seconds
    curve.mark("write")
    writing = time.perf_counter()
    write_map(folder / MAP, statistics, provenance={"source": "simulated town"})
    written = time.perf_counter()
    curve.mark("read")
    again = same(read_map(folder / MAP), statistics)
    read = time.perf_counter()
    # From here on the map rests in its file, and the parts in theirs: no more than a sum and a part are in memory.
    del statistics, whole, part
    curve.mark("merge")
    equal, merging = [], 0.0
    for order in settings.orders:
        began = time.perf_counter()
        merged = merge_files([folder / PART.format(k) for k in order])
        merging += time.perf_counter() - began
        equal.append(same(read_map(folder / MAP), merged))
        del merged
    statistics = _sparse(read_map(folder / MAP))
    curve.mark("read a region")
    region = region_of(statistics.grid, town, settings.region)
    began = time.perf_counter()
    found = read_map(folder / MAP, region=region)
    lazily = time.perf_counter() - began
    window = statistics.window(found.grid)
    dense = found.to_dense() if isinstance(found, BrickStatistics) else found
    lazy = all(np.array_equal(getattr(dense, name), getattr(window, name)) for name in ("hits", "misses", "path_fixed"))
    return {
        "rays": census.rays,
        "distinct": census.distinct,
        "scans": census.scans,
        "left out": statistics.left_out,
        "hits": sum(int(tile.hits.sum(dtype=np.int64)) for tile in statistics.cells.tiles.values()),
        "cells": len(statistics.cells),
        "bricks": len(statistics.cells.bricks),
        "bytes": statistics.nbytes,
        "bytes of parts": part_bytes,
        "file bytes": (folder / MAP).stat().st_size,
        "grid": statistics.grid.shape,
        "region cells": len(found.cells) if isinstance(found, BrickStatistics) else 0,
        "seconds": {
            "streaming": ended,
            "casting": cast,
            "mapping": mapping,
            "mapping in parts": part_seconds,
            "merging": merging / len(settings.orders),
            "writing": written - writing,
            "reading": read - written,
            "reading a region": lazily,
        },
        "peak while streaming": streamed,
        "merges equal": equal,
        "read equal": again,
        "region equal": lazy,
    }


def merge_files(paths: Sequence[Path]) -> BrickStatistics:
    """Add up maps, read one after the other."""
    total = _sparse(read_map(paths[0]))
    for path in paths[1:]:
        total = total + _sparse(read_map(path))
    return total


def _sparse(statistics: object) -> BrickStatistics:
    if not isinstance(statistics, BrickStatistics):
        raise ConfigError("map: it is no sparse one")
    return statistics


def session_scans(town: Town, number: int, job: Job) -> Iterator[tuple[Scan, Array]]:
    """Cast so many scans of a session, evenly spread over its drive, one when it is asked for.

    Raises
    ------
    ConfigError
        If the session is too short.
    """
    settings = job.settings
    speed = settings.sessions.speed + number * settings.faster
    session = Sessions(town, settings.sessions.replaced(speed=speed)).session(number)
    lidar: SpatialLidar = hdl_64e(columns=job.columns) if job.columns else hdl_64e()
    drive = simulate_drive(
        session.world, session.route, lidar, seed=settings.seed + number, period=settings.period, keep_scans=False
    )
    rays = settings.quick_rays if job.quick else settings.rays
    # One scan more than needed: some rays end below the minimum range.
    wanted = int(rays / settings.count / (len(lidar.elevations) * lidar.columns)) + 2
    if wanted > len(drive):
        raise ConfigError(f"sessions: {len(drive)} scans in session {number}, {wanted} are needed; drive further")
    for k in np.linspace(0, len(drive) - 1, wanted).round().astype(int).tolist():
        yield drive.scans[k], drive.truth.poses[k]


def empty_map(town: Town, settings: LargeSettings) -> BrickStatistics:
    """A map around a town with nothing in it."""
    x_0, y_0, x_1, y_1 = town.grid.bounds
    low = np.array([x_0 - settings.margin, y_0 - settings.margin, settings.height[0]])
    high = np.array([x_1 + settings.margin, y_1 + settings.margin, settings.height[1]])
    shape = np.ceil((high - low) / settings.resolution - 1e-9).astype(int)
    return BrickStatistics.empty(Grid(tuple(low.tolist()), settings.resolution, tuple(shape.tolist())))


def region_of(grid: Grid, town: Town, size: Sequence[float]) -> tuple[Array, Array]:
    """Corners of a box in the middle of a town, as high as the map."""
    x_0, y_0, x_1, y_1 = town.grid.bounds
    centre, half = np.array([(x_0 + x_1) / 2, (y_0 + y_1) / 2]), np.array(size) / 2
    return np.append(centre - half, grid.origin[2]), np.append(centre + half, grid.upper[2])


if __name__ == "__main__":
    sys.exit(work())
