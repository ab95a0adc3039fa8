"""Level tables: all levels of a spatial map in one pool, as scan kernels read them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.errors import MapError
from factorloc.factors._scan_kernels import DECAY_RATE, DISTANCE_FIELD
from factorloc.factors._spatial_scan_kernels import COLUMNS
from factorloc.mapping.distance_table import DistanceTable
from factorloc.mapping.grid import Grid
from factorloc.mapping.spatial_pyramid import SpatialLevel, SpatialPyramid

__all__ = ["LevelTables"]

Array = npt.NDArray[np.float64]
Pool = npt.NDArray[np.float32]


@dataclass(frozen=True)
class LevelTables:
    """Levels of decay rates and distance fields, coarse to fine.

    Parameters
    ----------
    grid : Grid
        Cells of the map.
    blurs : tuple of float
        Blur of each level, m; of a distance field, how far it reaches.
    directory : ndarray of int32
        Brick of every place of every level.
    primary, secondary : ndarray of float32
        The pool.
    numbers : ndarray, shape (L, 11)
        Numbers of each level (:mod:`factorloc.factors._spatial_scan_kernels`).
    least_costs : ndarray, shape (L,)
        Lower bound of a ray's cost on each level.
    """

    grid: Grid
    blurs: tuple[float, ...]
    directory: npt.NDArray[np.int32]
    primary: Pool
    secondary: Pool
    numbers: Array
    least_costs: Array

    @classmethod
    def of(cls, pyramid: SpatialPyramid, fields: Sequence[DistanceTable] = ()) -> LevelTables:
        """Put distance fields, then the levels of a pyramid into one pool.

        Raises
        ------
        MapError
            If a field belongs to another map.
        """
        if any(field.distances.layout.grid.origin != pyramid.grid.origin for field in fields):
            raise MapError("field: its lowest corner is not that of the map; make it from the same statistics")
        levels: list[DistanceTable | SpatialLevel] = [*fields, *pyramid.levels]
        directories, primary, secondary, numbers = [], [], [], np.zeros((len(levels), COLUMNS))
        start = bricks = 0
        for row, level in zip(numbers, levels, strict=True):
            if isinstance(level, DistanceTable):
                model, one, two, parameters = DISTANCE_FIELD, level.distances, level.distances, (level.sigma, level.huber)
            else:
                model, one, two, parameters = DECAY_RATE, level.rates, level.log_rates, (level.least_nll, 0.0)
            layout = one.layout
            directories.append(layout.directory + np.int32(bricks))
            primary.append(one.pool.ravel())
            secondary.append(two.pool.ravel())
            row[:] = (
                model, start, layout.strides[0], layout.strides[1], *layout.grid.shape, layout.grid.resolution,
                one.outside, *parameters,
            )  # fmt: skip
            start += len(layout.directory)
            bricks += len(one.pool)
        return cls(
            pyramid.grid,
            tuple(level.blur for level in levels),
            np.concatenate(directories),
            np.concatenate(primary),
            np.concatenate(secondary),
            numbers,
            np.array([0.0 if isinstance(level, DistanceTable) else level.least_nll for level in levels]),
        )

    @property
    def low(self) -> Array:
        """Lowest corner of all levels, m."""
        return np.array(self.grid.origin)

    @property
    def nbytes(self) -> int:
        """Memory of all levels."""
        return self.directory.nbytes + self.primary.nbytes + self.secondary.nbytes
