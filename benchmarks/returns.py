"""Returns of a real or simulated drive, laid out for the walks that are compared."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from factorloc.datasets import read_carmen
from factorloc.errors import DataError
from factorloc.mapping import BlurPyramid, RayStatistics
from factorloc.mapping.accumulation import rays_in_map
from factorloc.rays import pack
from factorloc.simulation import PlanarLidar, office_plan, office_routes

__all__ = ["OFFICE", "Returns", "load_returns"]

Array = npt.NDArray[np.float64]

OFFICE = "office"
"""Name of the simulated drive."""

_PERIOD = 0.5  # s, between two simulated scans


@dataclass(frozen=True)
class Returns:
    """Rays with a return, in the map of the drive they come from.

    Parameters
    ----------
    source : str
        Which drive.
    statistics : RayStatistics
        Its map, which holds every origin and every end.
    origins, directions : ndarray, shape (M, 2)
        In the frame of the map, m and unit vectors.
    lengths : ndarray, shape (M,)
        m.
    rates, log_rates : ndarray, shape (cells with rim,)
        Decay rates of the map, 1/m, and their logarithms.
    """

    source: str
    statistics: RayStatistics
    origins: Array
    directions: Array
    lengths: Array
    rates: Array
    log_rates: Array

    @property
    def rays(self) -> tuple[Array, Array, Array]:
        """Origins, directions and lengths."""
        return self.origins, self.directions, self.lengths

    @property
    def shape(self) -> tuple[int, int]:
        """Cells along x and y, without rim."""
        return self.statistics.grid.shape[0], self.statistics.grid.shape[1]

    @property
    def low(self) -> Array:
        """Lowest corner of the grid, m."""
        return np.array(self.statistics.grid.origin)

    @property
    def resolution(self) -> float:
        """Edge length of a cell, m."""
        return self.statistics.grid.resolution

    @property
    def stride(self) -> int:
        """Cells along y, with rim."""
        return self.shape[1] + 2


def load_returns(data: Path | None, log: str, scans: int = 0, resolution: float = 0.1) -> Returns:
    """Take the returns of a corrected CARMEN log, or of a simulated office where there is no data.

    Parameters
    ----------
    data : Path or None
        Folder with ``carmen/LOG-corrected.log.gz``.
    log : str
        Name of the log, or :data:`OFFICE`.
    scans : int
        How many scans, evenly spread; all if 0.
    resolution : float
        Edge length of a cell, m.

    Raises
    ------
    DataError
        If the log cannot be read, or carries no truth.
    """
    drive = None if data is None or log == OFFICE else read_carmen(data / "carmen" / f"{log}-corrected.log.gz")
    if drive is None:
        truth = office_routes()[0].sample(_PERIOD).poses
    elif drive.truth is None:
        raise DataError(f"{drive.name}: is no corrected log; name one that is")
    else:
        truth = drive.truth.poses
    rows = np.unique(np.linspace(0, len(truth) - 1, scans or len(truth)).round().astype(np.int64))
    poses = truth[rows]
    if drive is None:
        chosen = PlanarLidar.wide().cast_many(office_plan(), poses, np.random.default_rng(1))
    else:
        chosen = [drive.scans[row] for row in rows]
    rays = pack(chosen).returns()
    origins, directions = rays_in_map(rays, poses)
    statistics = RayStatistics.from_scans(chosen, poses, resolution=resolution)
    finest = BlurPyramid.from_statistics(statistics, blurs=(0.0,)).levels[0]
    source = "simulated office" if drive is None else f"log {drive.name}"
    return Returns(source, statistics, origins, directions, rays.ranges, finest.rates, finest.log_rates)
