"""Level tables: all levels of a spatial map in one pool, as scan kernels read them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.errors import MapError
from factorloc.factors._scan_kernels import DECAY_RATE, DISTANCE_FIELD, POSTERIOR
from factorloc.factors._spatial_scan_kernels import COLUMNS
from factorloc.mapping.cell_table import CellTable
from factorloc.mapping.distance_table import DistanceTable
from factorloc.mapping.grid import Grid
from factorloc.mapping.spatial_posterior_pyramid import SpatialPosteriorLevel, SpatialPosteriorPyramid
from factorloc.mapping.spatial_pyramid import SpatialLevel, SpatialPyramid

__all__ = ["LevelTables"]

Array = npt.NDArray[np.float64]
Pool = npt.NDArray[np.float32]


@dataclass(frozen=True)
class LevelTables:
    """Levels of decay rates, posteriors or distance fields, coarse to fine.

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
    numbers : ndarray, shape (L, 12)
        Numbers of each level (:mod:`factorloc.factors._spatial_scan_kernels`).
    least_costs : ndarray, shape (L,)
        Lower bound of a ray's cost on each level.
    tertiary : ndarray of float32, optional
        A third number of every cell of the pool, in maps of posteriors.
    """

    grid: Grid
    blurs: tuple[float, ...]
    directory: npt.NDArray[np.int32]
    primary: Pool
    secondary: Pool
    numbers: Array
    least_costs: Array
    tertiary: Pool | None = None

    @classmethod
    def of(cls, pyramid: SpatialPyramid | SpatialPosteriorPyramid, fields: Sequence[DistanceTable] = ()) -> LevelTables:
        """Put distance fields, then the levels of a pyramid into one pool.

        Raises
        ------
        MapError
            If a field belongs to another map.
        """
        if any(field.distances.layout.grid.origin != pyramid.grid.origin for field in fields):
            raise MapError("field: its lowest corner is not that of the map; make it from the same statistics")
        levels = [*fields, *pyramid.levels]
        rows = [_columns(level, pyramid) for level in levels]
        numbers = np.zeros((len(levels), COLUMNS))
        directories = []
        start = bricks = 0
        for row, (model, tables, outside, parameters) in zip(numbers, rows, strict=True):
            layout = tables[0].layout
            directories.append(layout.directory + np.int32(bricks))
            row[:9] = (
                model, start, layout.strides[0], layout.strides[1], *layout.grid.shape, layout.grid.resolution, outside
            )  # fmt: skip
            row[9 : 9 + len(parameters)] = parameters
            start += len(layout.directory)
            bricks += len(tables[0].pool)
        pools = [np.concatenate([tables[k].pool.ravel() for _, tables, *_ in rows]) for k in range(len(rows[-1][1]))]
        return cls(
            pyramid.grid,
            tuple(level.blur for level in levels),
            np.concatenate(directories),
            pools[0],
            pools[1],
            numbers,
            np.array([0.0 if isinstance(level, DistanceTable) else level.least_nll for level in levels]),
            pools[2] if len(pools) > 2 else None,
        )

    @property
    def low(self) -> Array:
        """Lowest corner of all levels, m."""
        return np.array(self.grid.origin)

    @property
    def nbytes(self) -> int:
        """Memory of all levels."""
        tertiary = 0 if self.tertiary is None else self.tertiary.nbytes
        return self.directory.nbytes + self.primary.nbytes + self.secondary.nbytes + tertiary


def _columns(
    level: DistanceTable | SpatialLevel | SpatialPosteriorLevel, pyramid: SpatialPyramid | SpatialPosteriorPyramid
) -> tuple[int, tuple[CellTable, ...], float, tuple[float, ...]]:
    """Model, tables, number outside and parameters of a level."""
    if isinstance(level, DistanceTable):
        return DISTANCE_FIELD, (level.distances,) * 3, level.distances.outside, (level.sigma, level.huber)
    if isinstance(level, SpatialLevel):
        return DECAY_RATE, (level.rates, level.log_rates), level.rates.outside, (level.least_nll,)
    assert isinstance(pyramid, SpatialPosteriorPyramid)
    prior = pyramid.prior
    return POSTERIOR, (level.shapes, level.paths, level.log_rates), prior.shape, (level.least_nll, prior.path)
