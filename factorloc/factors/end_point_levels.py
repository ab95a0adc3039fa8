"""Levels of an end-point model: its field once, its standard deviation wider from level to level."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from factorloc.errors import MapError
from factorloc.factors._scan_kernels import END_POINT
from factorloc.factors._spatial_scan_kernels import COLUMNS
from factorloc.factors.level_tables import LevelTables
from factorloc.mapping.beam_model import rimmed
from factorloc.mapping.cell_table import CellTable
from factorloc.mapping.end_point import EndPointModel
from factorloc.mapping.grid import Grid
from factorloc.mapping.pyramid import checked_blurs

__all__ = ["EndPointLevels"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class EndPointLevels:
    """An end-point model at several standard deviations, coarse to fine.

    A distance field is smooth from afar already; what ends its reach is the normal density, which the random part
    swallows a few standard deviations away. So not the field is blurred, but the density: its variance is
    ``sigma^2 + blur^2``.

    Parameters
    ----------
    model : EndPointModel
        The model at blur 0.
    blurs : tuple of float
        m, decreasing.

    Raises
    ------
    MapError
        If the blurs do not decrease.
    """

    model: EndPointModel
    blurs: tuple[float, ...]

    @classmethod
    def of(cls, model: EndPointModel, blurs: Sequence[float]) -> EndPointLevels:
        """Make the levels of a model."""
        return cls(model, checked_blurs(blurs))

    @property
    def grid(self) -> Grid:
        """Where the cells lie."""
        return self.model.grid

    @cached_property
    def fields(self) -> Array:
        """Distances of a planar map with a rim, flat, the same for each level."""
        distances = self.model.distances
        if self.grid.dimension != 2 or isinstance(distances.values, CellTable):
            raise MapError("map: spatial; use SpatialEndPointTerm")
        return np.tile(rimmed(distances.values, distances.farthest).ravel(), (len(self.blurs), 1))

    @cached_property
    def table(self) -> CellTable:
        """Distances of a spatial map, in bricks."""
        distances = self.model.distances
        if self.grid.dimension != 3:
            raise MapError("map: planar; use EndPointTerm")
        if isinstance(distances.values, CellTable):
            return distances.values
        return CellTable.from_dense(self.grid, distances.values, distances.farthest)

    def numbers(self, maximum_range: float) -> Array:
        """Sigma (m), floor relative to the peak, and log of the peak (1/m) of each level, shape (L, 3).

        Raises
        ------
        MapError
            If the maximum range is no finite length.
        """
        if not (np.isfinite(maximum_range) and maximum_range > 0):
            raise MapError(
                f"maximum range: {maximum_range} m; an end-point model needs the sensor's, as range_limits of the scans"
            )
        sigma = np.hypot(self.model.sigma, self.blurs)
        peak = self.model.hit / (np.sqrt(2 * np.pi) * sigma)
        return np.stack([sigma, self.model.random / maximum_range / peak, np.log(peak)], -1)

    def least_costs(self, maximum_range: float) -> Array:
        """Cost of an end at distance 0 on each level, shape (L,)."""
        _, floor, log_peak = self.numbers(maximum_range).T
        return np.asarray(-log_peak - np.log1p(floor))

    def tables(self, maximum_range: float) -> LevelTables:
        """Levels of a spatial map as its kernels read them: all of one pool of bricks."""
        table = self.table
        layout, pool = table.layout, table.pool.ravel()
        numbers = np.zeros((len(self.blurs), COLUMNS))
        numbers[:, :9] = (
            END_POINT, 0, layout.strides[0], layout.strides[1], *self.grid.shape, self.grid.resolution, table.outside
        )  # fmt: skip
        numbers[:, 9:] = self.numbers(maximum_range)
        return LevelTables(
            self.grid, self.blurs, layout.directory, pool, pool, numbers, self.least_costs(maximum_range)
        )
