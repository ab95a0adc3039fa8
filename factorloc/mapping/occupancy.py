"""Occupancy: how probable it is that a cell reflects more than a given share of the rays that meet it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.special import betaincc

from factorloc.errors import MapError
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.cell_table import CellTable
from factorloc.mapping.grid import Grid
from factorloc.mapping.ray_statistics import RayStatistics

__all__ = ["OccupancyMap"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class OccupancyMap:
    """Occupancy by the tail of the Beta posterior of a cell's reflection probability (thesis, section 12.4.1).

    A cell is occupied with probability ``P(mu > threshold)``, where ``mu ~ Beta(H + alpha, M + beta)``. Cells no ray
    has met have the prior's tail.

    Parameters
    ----------
    statistics : RayStatistics or BrickStatistics
        The map.
    alpha, beta : float
        Of the prior; positive.
    threshold : float
        mu_o of the thesis: a cell is occupied if it reflects a larger share of the rays.

    Raises
    ------
    MapError
        If a number is out of bounds.
    """

    statistics: RayStatistics | BrickStatistics
    alpha: float
    beta: float
    threshold: float = 0.2

    def __post_init__(self) -> None:
        if not (np.isfinite([self.alpha, self.beta]).all() and self.alpha > 0 and self.beta > 0):
            raise MapError(f"prior: alpha {self.alpha}, beta {self.beta}; expected two positive numbers")
        if not 0 <= self.threshold <= 1:
            raise MapError(f"threshold: {self.threshold}; expected a reflection probability in [0, 1]")

    @property
    def grid(self) -> Grid:
        """Where the cells lie."""
        return self.statistics.grid

    @property
    def unseen(self) -> float:
        """Occupancy of a cell no ray has met."""
        return float(betaincc(self.alpha, self.beta, self.threshold))

    @cached_property
    def probabilities(self) -> Array:
        """Occupancy, shape ``grid.shape``; of a sparse map that of the visited cells, shape (V,)."""
        hits, misses = self.statistics.hits, self.statistics.misses
        # Most cells were seen alike (many, not at all): each pair of counts is integrated once.
        pairs, place = np.unique(hits.astype(np.uint64) << np.uint64(32) | misses, return_inverse=True)
        H, M = (pairs >> np.uint64(32)).astype(np.float64), (pairs & np.uint64(2**32 - 1)).astype(np.float64)
        tails = np.asarray(betaincc(H + self.alpha, M + self.beta, self.threshold))
        return np.asarray(tails[place].reshape(hits.shape))

    def occupied(self, least: float = 0.5) -> npt.NDArray[np.bool_]:
        """Cells that some ray has met and whose occupancy is at least so much, shape as :attr:`probabilities`."""
        met = (self.statistics.hits > 0) | (self.statistics.misses > 0)
        return np.asarray(met & (self.probabilities >= least))

    def table(self) -> CellTable:
        """Occupancy of every cell of a spatial map, as interpolation reads it; unseen ones have the prior's."""
        if isinstance(self.statistics, BrickStatistics):
            return CellTable.from_cells(self.statistics, self.probabilities, self.unseen)
        return CellTable.from_dense(self.grid, self.probabilities, self.unseen)
