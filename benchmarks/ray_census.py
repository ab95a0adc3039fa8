"""Rays that are mapped block by block and counted: how many differ, and whether two maps of them are equal."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from factorloc.mapping import BrickStatistics
from factorloc.mapping.visited_cells import VisitedCells
from factorloc.rays import pack
from factorloc.scan import RayStatus, Scan

__all__ = ["Census", "Stream", "same"]

Array = npt.NDArray[np.float64]


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
