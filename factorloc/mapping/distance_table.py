"""Distance fields in space: how far every cell is from the nearest one that reflects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from factorloc.errors import MapError
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.cell_table import CellTable
from factorloc.mapping.ray_statistics import RayStatistics
from factorloc.mapping.spatial_pyramid import pooled

__all__ = ["DistanceTable"]


@dataclass(frozen=True)
class DistanceTable:
    """Distance to the nearest reflecting cell, and how a scan term takes it.

    Parameters
    ----------
    distances : CellTable
        m, cut off at the farthest.
    blur : float
        How far the field reaches, m: its place among the levels of a map.
    sigma : float
        Standard deviation of an end point's distance, m.
    huber : float
        Threshold of the Huber loss, in sigmas.
    """

    distances: CellTable
    blur: float
    sigma: float
    huber: float

    @classmethod
    def from_statistics(
        cls,
        statistics: BrickStatistics | RayStatistics,
        *,
        factor: int = 2,
        farthest: float = 4.0,
        sigma: float = 0.25,
        huber: float = 2.0,
        least_rate: float = 0.5,
    ) -> DistanceTable:
        """Make the field of a map.

        Parameters
        ----------
        statistics : BrickStatistics or RayStatistics
            The map, spatial.
        factor : int
            Cells of the field along an edge are so many of the map's: it serves to come near, not to arrive.
        farthest : float
            Distances end here, m.
        sigma, huber : float
            See above.
        least_rate : float
            A cell counts as reflecting from this decay rate on, 1/m.

        Raises
        ------
        MapError
            If no cell reflects, or the map does not fit into memory.
        """
        if isinstance(statistics, RayStatistics):
            statistics = BrickStatistics.from_dense(statistics)
        grid, H, R = pooled(statistics, factor)
        occupied = least_rate * np.maximum(R, grid.resolution) < H
        if not occupied.any():
            raise MapError(f"map: no cell has a decay rate above {least_rate} 1/m; lower least_rate")
        distance = np.minimum(distance_transform_edt(~occupied) * grid.resolution, farthest)
        return cls(CellTable.from_dense(grid, distance, farthest), farthest, sigma, huber)
