"""Blur pyramid of a spatial decay-rate map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.errors import MapError
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.cell_table import CellTable
from factorloc.mapping.grid import Grid, require_memory
from factorloc.mapping.pyramid import BLUR_REACH, blurred_counts, checked_blurs
from factorloc.mapping.ray_statistics import RayStatistics

__all__ = ["SPATIAL_BLURS", "SpatialLevel", "SpatialPyramid", "pooled", "pooling_of"]

Array = npt.NDArray[np.float64]

SPATIAL_BLURS = (1.0, 0.5, 0.25, 0.0)
"""Standard deviations of the blur, m, coarse to fine."""


@dataclass(frozen=True)
class SpatialLevel:
    """Decay rates blurred by one Gaussian.

    Parameters
    ----------
    blur : float
        Standard deviation of the Gaussian, m.
    rates, log_rates : CellTable
        1/m; cells of the level may be larger than those of the map.
    least_nll : float
        A bound no ray's negative log-likelihood comes close to from above: ``-log(max rate) - 1/2``.
    """

    blur: float
    rates: CellTable
    log_rates: CellTable
    least_nll: float


@dataclass(frozen=True)
class SpatialPyramid:
    """Decay rates of a spatial map at several blurs, coarse to fine.

    As :class:`~factorloc.mapping.pyramid.BlurPyramid`, the *counts* are blurred. A blur of several cells needs no cells
    that small: a level has cells of the largest power of two times the map's that is no longer than its blur, which
    makes walks shorter and saves memory.

    Parameters
    ----------
    grid : Grid
        Cells of the map.
    levels : tuple of SpatialLevel
        Coarse to fine.
    """

    grid: Grid
    levels: tuple[SpatialLevel, ...]

    @classmethod
    def from_statistics(
        cls, statistics: BrickStatistics | RayStatistics, blurs: Sequence[float] = SPATIAL_BLURS
    ) -> SpatialPyramid:
        """Blur the counts of a map.

        Raises
        ------
        MapError
            If the map is planar or holds no hit, or the blurs do not decrease.
        """
        if statistics.grid.dimension != 3:
            raise MapError("map: planar; use BlurPyramid")
        if isinstance(statistics, RayStatistics):
            statistics = BrickStatistics.from_dense(statistics)
        checked = checked_blurs(blurs)
        hits, path = statistics.hits.sum(), statistics.path_lengths.sum()
        if hits == 0 or path == 0:
            raise MapError("map: it holds no hit, or no path; nothing to localize in")
        mean = float(hits / path)
        levels = []
        for blur in checked:
            rates = _blurred_rates(statistics, blur, mean)
            least = -np.log(rates.pool.max()) - 0.5
            levels.append(SpatialLevel(blur, rates, rates.map(np.log), float(least)))
        return cls(statistics.grid, tuple(levels))

    @property
    def blurs(self) -> tuple[float, ...]:
        """Standard deviations of the levels, m."""
        return tuple(level.blur for level in self.levels)

    @property
    def nbytes(self) -> int:
        """Memory of all levels."""
        return sum(level.rates.nbytes + level.log_rates.pool.nbytes for level in self.levels)


def pooled(statistics: BrickStatistics, factor: int) -> tuple[Grid, Array, Array]:
    """Add up hits and path lengths (m) over ``factor`` cells along each axis.

    Returns
    -------
    grid : Grid
        The larger cells.
    hits, path : ndarray, shape ``grid.shape``

    Raises
    ------
    MapError
        If they do not fit into memory.
    """
    fine = statistics.grid
    grid = Grid(fine.origin, fine.resolution * factor, tuple(-(-n // factor) for n in fine.shape), fine.frame)
    require_memory(grid.cells * 32, f"a level of {' x '.join(map(str, grid.shape))} cells")
    cells = statistics.layout.cells(statistics.keys) // factor
    flat = np.ravel_multi_index(tuple(cells.T), grid.shape)
    H = np.bincount(flat, statistics.hits.astype(np.float64), grid.cells)
    R = np.bincount(flat, statistics.path_lengths, grid.cells)
    return grid, np.asarray(H, np.float64).reshape(grid.shape), np.asarray(R, np.float64).reshape(grid.shape)


def pooling_of(resolution: float, blur: float) -> tuple[int, float]:
    """How many cells of an edge (m) make one of a level with a blur (m), and the blur left to it, in those cells."""
    factor = 1
    while 2 * factor * resolution <= blur:
        factor *= 2
    size = factor * resolution
    # What the larger cells blur already (a box of variance size^2 / 12) is not blurred again.
    return factor, float(np.sqrt(max(blur**2 - (size**2 - resolution**2) / 12, 0.0)) / size)


def _blurred_rates(statistics: BrickStatistics, blur: float, mean: float) -> CellTable:
    factor, sigma = pooling_of(statistics.grid.resolution, blur)
    size = factor * statistics.grid.resolution

    def rates(H: Array, R: Array) -> Array:
        # Cells nobody crossed are held at the mean by a pseudo path of one cell.
        return np.asarray((H + mean * size) / (R + size), np.float64)

    if blur == 0:
        return CellTable.from_cells(
            statistics, rates(statistics.hits.astype(np.float64), statistics.path_lengths), mean
        )

    def blurred(H: Array, R: Array) -> Array:
        return rates(*(blurred_counts(np.asarray(values, np.float32), sigma) for values in (H, R)))

    if factor > 1:
        grid, H, R = pooled(statistics, factor)
        return CellTable.from_dense(grid, blurred(H, R), mean)
    halo = int(BLUR_REACH * sigma + 0.5)
    return CellTable.from_neighbourhoods(
        statistics, lambda part: blurred(part.hits.astype(np.float64), part.path_lengths), halo, mean
    )
