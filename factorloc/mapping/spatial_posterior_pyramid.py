"""Blur pyramid of the full posterior of the decay rates of a spatial map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.errors import MapError
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.bricks import BrickLayout
from factorloc.mapping.cell_table import CellTable
from factorloc.mapping.grid import Grid
from factorloc.mapping.prior import GammaPrior, PriorRule, estimate_prior
from factorloc.mapping.pyramid import BLUR_REACH, blurred_counts, checked_blurs
from factorloc.mapping.ray_statistics import RayStatistics
from factorloc.mapping.spatial_pyramid import SPATIAL_BLURS, pooled, pooling_of

__all__ = ["SpatialPosteriorLevel", "SpatialPosteriorPyramid"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class SpatialPosteriorLevel:
    """Gamma posteriors of counts blurred by one Gaussian.

    Parameters
    ----------
    blur : float
        Standard deviation of the Gaussian, m.
    shapes, paths, log_rates : CellTable
        a, b (m) and log of the effective rate ``a / (b + h / 2)`` (1/m) of a ray that ends halfway through a cell of
        edge h, in the same bricks; cells of the level may be larger than those of the map.
    least_nll : float
        A bound no ray's negative log-likelihood comes close to from above: ``-log(max effective rate) - 1/2``.
    """

    blur: float
    shapes: CellTable
    paths: CellTable
    log_rates: CellTable
    least_nll: float


@dataclass(frozen=True)
class SpatialPosteriorPyramid:
    """Posteriors of the decay rates of a spatial map at several blurs, coarse to fine.

    As :class:`~factorloc.mapping.posterior_pyramid.PosteriorPyramid`, with larger cells on blurred levels as
    :class:`~factorloc.mapping.spatial_pyramid.SpatialPyramid` has them.

    Parameters
    ----------
    grid : Grid
        Cells of the map.
    prior : GammaPrior
        Of every cell, and of all that lies outside.
    levels : tuple of SpatialPosteriorLevel
        Coarse to fine.
    """

    grid: Grid
    prior: GammaPrior
    levels: tuple[SpatialPosteriorLevel, ...]

    @classmethod
    def from_statistics(
        cls,
        statistics: BrickStatistics | RayStatistics,
        blurs: Sequence[float] = SPATIAL_BLURS,
        prior: GammaPrior | PriorRule = "marginal",
    ) -> SpatialPosteriorPyramid:
        """Blur the counts of a map; arguments as :meth:`PosteriorPyramid.from_statistics`.

        Raises
        ------
        MapError
            If the map is planar or holds no hit, or the blurs do not decrease.
        """
        if statistics.grid.dimension != 3:
            raise MapError("map: planar; use PosteriorPyramid")
        if isinstance(statistics, RayStatistics):
            statistics = BrickStatistics.from_dense(statistics)
        checked = checked_blurs(blurs)
        chosen = prior if isinstance(prior, GammaPrior) else estimate_prior(statistics, prior)
        levels = []
        for blur in checked:
            H, R = _blurred_tables(statistics, blur)
            shapes, paths = H.map(lambda hits: hits + chosen.shape), R.map(lambda path: path + chosen.path)
            half = np.float32(shapes.layout.grid.resolution / 2)
            log_rates = CellTable(shapes.layout, np.log(shapes.pool / (paths.pool + half)))
            levels.append(SpatialPosteriorLevel(blur, shapes, paths, log_rates, float(-log_rates.pool.max() - 0.5)))
        return cls(statistics.grid, chosen, tuple(levels))

    @property
    def blurs(self) -> tuple[float, ...]:
        """Standard deviations of the levels, m."""
        return tuple(level.blur for level in self.levels)


def _blurred_tables(statistics: BrickStatistics, blur: float) -> tuple[CellTable, CellTable]:
    """Hits and path lengths of one level, in the same bricks."""
    if blur == 0:
        hits = CellTable.from_cells(statistics, statistics.hits, 0.0)
        return hits, CellTable.from_cells(statistics, statistics.path_lengths, 0.0)
    factor, sigma = pooling_of(statistics.grid.resolution, blur)
    if factor > 1:
        grid, H, R = pooled(statistics, factor)
        return _in_same_bricks(*(CellTable.from_dense(grid, blurred_counts(values, sigma), 0.0) for values in (H, R)))
    halo = int(BLUR_REACH * sigma + 0.5)

    def table(of: str) -> CellTable:
        def blurred(part: RayStatistics) -> Array:
            return blurred_counts(np.asarray(getattr(part, of), np.float64), sigma)

        return CellTable.from_neighbourhoods(statistics, blurred, halo, 0.0)

    return _in_same_bricks(table("hits"), table("path_lengths"))


def _in_same_bricks(one: CellTable, two: CellTable) -> tuple[CellTable, CellTable]:
    """Lay out two tables of a grid in the bricks that either has."""
    bricks = np.union1d(one.layout.bricks, two.layout.bricks)
    layout = BrickLayout(one.layout.grid, bricks)

    def laid_out(table: CellTable) -> CellTable:
        pool = np.full((len(bricks) + 1, table.pool.shape[1]), np.float32(table.outside))
        pool[np.searchsorted(bricks, table.layout.bricks) + 1] = table.pool[1:]
        return CellTable(layout, pool)

    return laid_out(one), laid_out(two)
