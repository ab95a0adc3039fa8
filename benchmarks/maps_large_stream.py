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
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from pydantic import Field

from benchmarks.harness import one_line_errors
from benchmarks.resident_memory import MemoryCurve, peak_resident
from factorloc import set_threads
from factorloc.config import Block, read_config
from factorloc.errors import ConfigError
from factorloc.files import write_text
from factorloc.mapping import BrickStatistics, Grid, read_map, write_map
from factorloc.mapping.visited_cells import VisitedCells
from factorloc.rays import pack
from factorloc.scan import RayStatus, Scan
from factorloc.simulation import Sessions, SessionSettings, SpatialLidar, Town, TownSettings, hdl_64e, simulate_drive

__all__ = ["MAP", "Census", "Goals", "LargeSettings", "Stream", "region_of", "same", "stream_map"]

Array = npt.NDArray[np.float64]

MAP, PART, JOB, REPORT = "map.h5", "part_{}.h5", "job.json", "report.json"


class Goals(Block):
    """Bounds.

    Parameters
    ----------
    rays : float
        The least; of a full run.
    peak : float
        The most memory, GB (10^9 bytes).
    """

    rays: float
    peak: float


class LargeSettings(Block):
    """What ``maps_large.json`` holds.

    Parameters
    ----------
    seed : int
        Of town and drives.
    rays, quick_rays : float
        How many to cast at least, in a full run and in a quick one, in the same world.
    resolution : float
        Edge of a cell, m.
    town : TownSettings
        The world.
    sessions : SessionSettings
        What changes in it, and how far each session drives.
    count : int
        Sessions; each makes a partial map.
    faster : float
        How much faster each session is driven than the one before, m/s: else scans of two might be at the same poses.
    period : float
        Time between two scans, s; a quick run takes fewer of them.
    height : (float, float)
        Lowest and highest end of the map, m.
    margin : float
        How far the map reaches beyond the town, m.
    block_rays, part_block_rays : int
        After how many rays the whole map and the partial ones take in what was cast. They differ, so that the two are
        walked in different blocks.
    orders : tuple of tuple of int
        In which partial maps are merged.
    region : (float, float)
        Size of the region in the middle of the town that is read alone, m.
    goals : Goals
    """

    seed: int = Field(ge=0)
    rays: float = Field(gt=0)
    quick_rays: float = Field(gt=0)
    resolution: float = Field(gt=0)
    town: TownSettings
    sessions: SessionSettings
    count: int = Field(gt=0)
    faster: float = Field(ge=0)
    period: float = Field(gt=0)
    height: tuple[float, float]
    margin: float = Field(ge=0)
    block_rays: int = Field(gt=0)
    part_block_rays: int = Field(gt=0)
    orders: tuple[tuple[int, ...], ...]
    region: tuple[float, float]
    goals: Goals


class Job(Block):
    """What ``job.json`` holds.

    Parameters
    ----------
    settings : LargeSettings
    quick : bool
    threads : int
    columns : int
        Firings of the lidar in one turn; as sold if 0.
    """

    settings: LargeSettings
    quick: bool
    threads: int
    columns: int = Field(0, ge=0)


@dataclass
class Stream:
    """A map that grows by blocks of scans.

    Parameters
    ----------
    statistics : BrickStatistics
        What it holds.
    block_rays : int
        After how many rays it takes them in.
    seconds : float
        Time that took.
    """

    statistics: BrickStatistics
    block_rays: int
    seconds: float = 0.0
    _scans: list[Scan] = field(default_factory=list)
    _poses: list[Array] = field(default_factory=list)

    def take(self, scan: Scan, pose: Array) -> None:
        """Take one scan with its pose ``T_map_body`` (4, 4)."""
        self._scans.append(scan)
        self._poses.append(pose)
        if sum(map(len, self._scans)) >= self.block_rays:
            self.flush()

    def flush(self) -> BrickStatistics:
        """Map what has been taken, and forget the scans."""
        if self._scans:
            began = time.perf_counter()
            self.statistics = self.statistics.add(pack(self._scans), np.array(self._poses))
            self.seconds += time.perf_counter() - began
            self._scans, self._poses = [], []
        return self.statistics


@dataclass
class Census:
    """Counts rays that differ from all others.

    Rays of one scan are told apart by origin, direction and range. Those of two scans are taken to differ as the poses
    and the ranges of the scans do, which are noise: a scan whose pose or ranges were there before counts nothing.

    Parameters
    ----------
    rays, distinct : int
        All rays the sensor did not lose below its minimum range, and those of them that differ.
    scans : int
    """

    rays: int = 0
    distinct: int = 0
    scans: int = 0
    _poses: set[bytes] = field(default_factory=set)
    _ranges: set[int] = field(default_factory=set)

    def take(self, scan: Scan, pose: Array) -> None:
        """Count the rays of a scan."""
        used = scan.status != RayStatus.BELOW_MINIMUM
        self.scans += 1
        self.rays += int(used.sum())
        ranges = hash(scan.ranges.tobytes())
        if pose.tobytes() not in self._poses and ranges not in self._ranges:
            self.distinct += len(
                np.unique(_digests(np.column_stack([scan.origins, scan.directions, scan.ranges])[used]))
            )
        self._poses.add(pose.tobytes())
        self._ranges.add(ranges)


def _digests(rows: Array) -> npt.NDArray[np.uint64]:
    """64 bits of each row of numbers (N, K), shape (N,); equal rows have equal ones, and others hardly ever."""
    digest = np.zeros(len(rows), np.uint64)
    for column in rows.T:
        digest = (digest ^ np.ascontiguousarray(column).view(np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
        digest ^= digest >> np.uint64(29)
    return digest


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


def same(one: object, other: BrickStatistics) -> bool:
    """Whether two maps are equal to the last bit, in what they count and in how."""
    if not isinstance(one, BrickStatistics):
        return False
    if (one.grid, one.scans, one.left_out) != (other.grid, other.scans, other.left_out):
        return False
    tiles, others = one.cells.tiles, other.cells.tiles
    return list(tiles) == list(others) and all(_same_tile(tiles[number], others[number]) for number in tiles)


def _same_tile(one: VisitedCells, other: VisitedCells) -> bool:
    packed = zip((one.packed_hits, one.packed_misses, one.packed_path),
                 (other.packed_hits, other.packed_misses, other.packed_path), strict=True)  # fmt: skip
    return (
        np.array_equal(one.bricks, other.bricks)
        and np.array_equal(one.visited, other.visited)
        and all(
            np.array_equal(getattr(x, name), getattr(y, name))
            for x, y in packed
            for name in ("narrow", "places", "wide")
        )
    )


if __name__ == "__main__":
    sys.exit(work())
