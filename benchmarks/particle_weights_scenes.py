"""Where particles are weighed: a map of every other scan of a drive, and particles around some of the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from benchmarks.returns import OFFICE
from benchmarks.spatial_returns import DRIVE_0005, STREET, load_spatial_drive
from benchmarks.starts import displaced
from factorloc.datasets import read_carmen
from factorloc.errors import DataError
from factorloc.geometry import se2
from factorloc.mapping import BrickStatistics, RayStatistics
from factorloc.scan import Scan
from factorloc.simulation import PlanarLidar, office_plan, office_routes

__all__ = ["GLOBAL", "TRACKING", "Drive", "Query", "Scene", "load_drive", "make_scene"]

Array = npt.NDArray[np.float64]

TRACKING, GLOBAL = "tracking", "global"
"""Particles around the true pose, and all over free space."""

_PERIOD = 0.5  # s, between two simulated scans of the office


@dataclass(frozen=True)
class Drive:
    """Scans with the poses they are mapped at.

    Parameters
    ----------
    name, source : str
        Short, and in words.
    scans : sequence of Scan
    poses : ndarray, shape (S, 3) or (S, 4, 4)
        ``T_map_body``.
    """

    name: str
    source: str
    scans: Sequence[Scan]
    poses: Array

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return 2 if self.poses.ndim == 2 else 3


@dataclass(frozen=True)
class Query:
    """Particles that are to be weighed by a scan.

    Parameters
    ----------
    scan : Scan
    poses : ndarray, shape (P, 3) or (P, 4, 4)
        ``T_map_body`` of the particles.
    """

    scan: Scan
    poses: Array

    @property
    def particle_beams(self) -> int:
        """Particles times rays."""
        return len(self.poses) * len(self.scan)

    @property
    def particle_returns(self) -> int:
        """Particles times rays with a return: all that a likelihood field looks up."""
        return len(self.poses) * int(self.scan.is_return.sum())


@dataclass(frozen=True)
class Scene:
    """A map, and scans that did not make it with their poses.

    Parameters
    ----------
    name : str
        Drive and resolution.
    statistics : RayStatistics or BrickStatistics
        The map.
    scans : sequence of Scan
    poses : ndarray, shape (Q, 3) or (Q, 4, 4)
        Where they were taken, ``T_map_body``.
    """

    name: str
    statistics: RayStatistics | BrickStatistics
    scans: Sequence[Scan]
    poses: Array

    def queries(
        self, spread: str, particles: int, beams: int, tracking: tuple[float, float], rng: np.random.Generator
    ) -> list[Query]:
        """Draw particles for each scan.

        Parameters
        ----------
        spread : {"tracking", "global"}
            How particles lie.
        particles, beams : int
            How many, and how many rays of each scan, evenly spread; all of them where there are fewer.
        tracking : (float, float)
            Horizontal offset in any direction, m, and in yaw, rad: the most.
        rng : numpy.random.Generator
        """
        drawn = self._anywhere if spread == GLOBAL else self._around
        return [
            Query(scan.select(_evenly(len(scan), beams)), drawn(pose, particles, tracking, rng))
            for scan, pose in zip(self.scans, self.poses, strict=True)
        ]

    def _around(self, pose: Array, count: int, most: tuple[float, float], rng: np.random.Generator) -> Array:
        radius, bearing = most[0] * np.sqrt(rng.random(count)), rng.uniform(-np.pi, np.pi, count)
        x, y, turn = radius * np.cos(bearing), radius * np.sin(bearing), rng.uniform(-most[1], most[1], count)
        if pose.ndim == 1:
            return np.asarray(se2.compose(pose, np.stack([x, y, turn], -1)))
        zero = np.zeros(count)
        return displaced(np.tile(pose, (count, 1, 1)), np.stack([x, y, zero], -1), np.stack([zero, zero, turn], -1))

    def _anywhere(self, _: Array, count: int, __: tuple[float, float], rng: np.random.Generator) -> Array:
        assert isinstance(self.statistics, RayStatistics)
        free = np.argwhere((self.statistics.misses > 0) & (self.statistics.hits == 0))
        cells = free[rng.integers(len(free), size=count)] + rng.random((count, 2))
        positions = self.statistics.grid.origin + self.statistics.grid.resolution * cells
        return np.concatenate([positions, rng.uniform(-np.pi, np.pi, (count, 1))], 1)


def load_drive(data: Path | None, log: str, scans: int = 0) -> Drive:
    """Read a corrected CARMEN log or KITTI drive 0005, or simulate the street, or an office where there is no data.

    Parameters
    ----------
    data : Path or None
        Folder of real data.
    log : str
        Name of the log, or one of :data:`~benchmarks.returns.OFFICE`, ``"0005"`` and ``"street"``.
    scans : int
        How many scans to use, from the first on; all if 0.

    Raises
    ------
    DataError
        If the drive cannot be read, or carries no truth.
    """
    rows = slice(scans or None)
    if log in (DRIVE_0005, STREET):
        spatial = load_spatial_drive(data, log)
        return Drive(log, spatial.source, spatial.scans[rows], spatial.poses[rows])
    if data is None or log == OFFICE:
        truth = office_routes()[0].sample(_PERIOD).poses[rows]
        cast = PlanarLidar.wide().cast_many(office_plan(), truth, np.random.default_rng(1))
        return Drive(OFFICE, "simulated office", cast, truth)
    read = read_carmen(data / "carmen" / f"{log}-corrected.log.gz")
    if read.truth is None:
        raise DataError(f"{read.name}: is no corrected log; name one that is")
    return Drive(log, f"log {read.name}", read.scans[rows], read.truth.poses[rows])


def make_scene(drive: Drive, resolution: float, queries: int) -> Scene:
    """Map the even scans of a drive, and take some of the others, evenly spread."""
    maker = RayStatistics if drive.dimension == 2 else BrickStatistics
    statistics = maker.from_scans(drive.scans[::2], drive.poses[::2], resolution=resolution)
    odd = np.arange(1, len(drive.scans), 2)
    rows = odd[_evenly(len(odd), queries)]
    return Scene(f"{drive.name}, {resolution:g} m", statistics, [drive.scans[row] for row in rows], drive.poses[rows])


def _evenly(count: int, most: int) -> npt.NDArray[np.int64]:
    return np.floor((np.arange(min(count, most)) + 0.5) * count / min(count, most)).astype(np.int64)
