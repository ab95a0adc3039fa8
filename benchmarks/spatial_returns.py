"""Returns of a real or simulated drive in space, and the map they are walked through."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
from pydantic import Field

from benchmarks.kitti_frames import read_frames
from factorloc.config import Block, read_config
from factorloc.errors import DataError
from factorloc.mapping import BrickStatistics, Grid
from factorloc.mapping.bricks import CELLS, BrickLayout
from factorloc.mapping.spatial_accumulation import spatial_rays_in_map
from factorloc.rays import pack
from factorloc.scan import Scan
from factorloc.simulation import hdl_64e, simulate_drive
from factorloc.simulation.street import StreetSettings, street_route, street_world

__all__ = ["DRIVE_0005", "RANGE", "STREET", "SpatialDrive", "SpatialReturns", "load_spatial_drive", "spatial_returns"]

Array = npt.NDArray[np.float64]
Rates = npt.NDArray[np.float32]
Strides = tuple[int, int, int]

DRIVE_0005, STREET = "0005", "street"
"""Names of the drives: KITTI raw, 2011-09-26, drive 0005; and a simulated street."""

RANGE = 60.0
"""Maximum range of both lidars, m: rays are cut off there, so that the dense grids stay at about 70 million cells."""

_MINIMUM_RANGE = 0.9  # m

# m; the frame of the poses is the first scan's, whose rays would begin in a corner of eight cells, where all walks are
# right in a way of their own.
_OFF_THE_RASTER = (0.031, 0.047, 0.013)


class StreetDrive(Block):
    """The simulated drive of ``street.json``.

    Parameters
    ----------
    seed : int
        Of street and drive.
    period : float
        Time between two scans, s.
    speed : float
        m/s.
    street : StreetSettings
        What is driven along.
    """

    seed: int = Field(ge=0)
    period: float = Field(gt=0)
    speed: float = Field(gt=0)
    street: StreetSettings


@dataclass(frozen=True)
class SpatialDrive:
    """Scans with the poses they are mapped at.

    Parameters
    ----------
    source : str
        Which drive.
    scans : sequence of Scan
    poses : ndarray, shape (S, 4, 4)
        ``T_map_body``.
    """

    source: str
    scans: Sequence[Scan]
    poses: Array


@dataclass(frozen=True)
class SpatialReturns:
    """Rays with a return, in the map of the drive they come from.

    Parameters
    ----------
    source : str
        Which drive.
    statistics : BrickStatistics
        Its map, which holds every origin and every end.
    origins, directions : ndarray, shape (M, 3)
        In the frame of the map, m and unit vectors.
    lengths : ndarray, shape (M,)
        m.
    """

    source: str
    statistics: BrickStatistics
    origins: Array
    directions: Array
    lengths: Array

    @property
    def rays(self) -> tuple[Array, Array, Array]:
        """Origins, directions and lengths."""
        return self.origins, self.directions, self.lengths

    @property
    def grid(self) -> Grid:
        """The cells, without rim."""
        return self.statistics.grid

    @property
    def low(self) -> Array:
        """Lowest corner of the grid, m."""
        return np.array(self.grid.origin)

    @property
    def strides(self) -> Strides:
        """Of the dense arrays with a rim of one cell."""
        _, n_y, n_z = self.grid.shape
        return (n_y + 2) * (n_z + 2), n_z + 2, 1

    @property
    def dense_size(self) -> int:
        """Cells of the dense arrays, with rim."""
        return (self.grid.shape[0] + 2) * self.strides[0]

    @cached_property
    def layout(self) -> BrickLayout:
        """Bricks of the map."""
        return self.statistics.layout

    @cached_property
    def dense_cells(self) -> npt.NDArray[np.int64]:
        """Where the visited cells of the map lie in dense arrays, shape (V,)."""
        return np.asarray((self.layout.cells(self.statistics.keys) + 1) @ self.strides)

    @cached_property
    def dense_rates(self) -> Rates:
        """Decay rates in a dense array, flat, 1/m."""
        rates = np.full(self.dense_size, self._mean_rate, np.float32)
        rates[self.dense_cells] = self._visited_rates
        return rates

    @cached_property
    def brick_rates(self) -> Rates:
        """Decay rates in a pool of bricks, flat, 1/m; the first brick holds the rate of those that are not there."""
        pool = np.full((len(self.layout.bricks) + 1) * CELLS, self._mean_rate, np.float32)
        pool[self.layout.places(self.statistics.keys)] = self._visited_rates
        return pool

    @property
    def _mean_rate(self) -> float:
        return float(self.statistics.hits.sum() / self.statistics.path_lengths.sum())

    @property
    def _visited_rates(self) -> Array:
        """Hits over path, with the mean rate of the map along one cell edge as the prior."""
        b = self.grid.resolution
        return np.asarray((self.statistics.hits + self._mean_rate * b) / (self.statistics.path_lengths + b))


@lru_cache(maxsize=1)
def load_spatial_drive(data: Path | None, log: str) -> SpatialDrive:
    """Read the even ones of the packed scans of drive 0005, or simulate the street; both up to :data:`RANGE`.

    Parameters
    ----------
    data : Path or None
        Folder with ``kitti_raw_0005/frames_every3_full.npz`` and ``reference_poses.npz``.
    log : {"0005", "street"}
        Which drive.

    Raises
    ------
    DataError
        If the drive is unknown or cannot be read.
    ConfigError
        If ``street.json`` holds no street.
    """
    if log == STREET:
        return _street()
    if log != DRIVE_0005 or data is None:
        raise DataError(f"drive {log}: {'no real data' if log == DRIVE_0005 else 'unknown'}; give --log {STREET}")
    frames = read_frames(data, (_MINIMUM_RANGE, RANGE))
    scans, poses = frames.scans[::2], frames.poses[::2].copy()
    poses[:, :3, 3] += _OFF_THE_RASTER
    return SpatialDrive("KITTI raw 2011-09-26, drive 0005, every sixth frame", scans, poses)


def spatial_returns(drive: SpatialDrive, scans: int, resolution: float) -> SpatialReturns:
    """Map all scans of a drive, and take the returns of some.

    Parameters
    ----------
    drive : SpatialDrive
        What to map.
    scans : int
        How many scans to take, evenly spread.
    resolution : float
        Edge length of a cell, m.
    """
    statistics = BrickStatistics.from_scans(drive.scans, drive.poses, resolution=resolution)
    rows = np.unique(np.linspace(0, len(drive.scans) - 1, scans).round().astype(np.int64))
    rays = pack([drive.scans[row] for row in rows]).returns()
    origins, directions = spatial_rays_in_map(rays, drive.poses[rows])
    return SpatialReturns(drive.source, statistics, origins, directions, rays.ranges)


def _street() -> SpatialDrive:
    settings = read_config(Path(__file__).with_name("street.json"), StreetDrive)
    drive = simulate_drive(
        street_world(settings.street, settings.seed),
        street_route(settings.street, settings.speed),
        hdl_64e(range_limits=(_MINIMUM_RANGE, RANGE)),
        seed=settings.seed,
        period=settings.period,
    )
    return SpatialDrive("simulated street", drive.scans, drive.truth.poses)
