"""Decay-rate maps: the chance per metre that a ray is reflected, for every cell (thesis, chapters 7 and 8)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from factorloc.errors import MapError
from factorloc.mapping._likelihood_kernels import decay_log_likelihoods, posterior_log_likelihoods
from factorloc.mapping._spatial_likelihood_kernels import (
    spatial_decay_log_likelihoods,
    spatial_posterior_log_likelihoods,
)
from factorloc.mapping.beam_model import BeamModel, rimmed
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.prior import GammaPrior, PriorRule, estimate_prior
from factorloc.mapping.ray_statistics import RayStatistics

__all__ = ["DecayRateMap", "DecayRatePosterior"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class DecayRateMap(BeamModel):
    """One decay rate per cell, the one that makes the mapping rays most likely: ``H / R`` (eq. 7.10).

    A map by maximum likelihood takes its data at their word: a cell no ray was reflected in has rate 0, and a ray that
    ends there has probability 0 (log-likelihood minus infinity). A floor under the rates leaves such rays unlikely.
    Cells no ray has crossed, and the space outside, have the prior's mean.

    Parameters
    ----------
    statistics : RayStatistics or BrickStatistics
        What the mapping rays left behind.
    prior : GammaPrior
        Its mean fills unseen space.
    floor : float
        Lowest rate of a cell some ray has crossed, 1/m; 0 is maximum likelihood.

    Raises
    ------
    MapError
        If the floor is negative or not finite.
    """

    prior: GammaPrior
    floor: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.floor < np.inf:
            raise MapError(f"floor: {self.floor} 1/m; expected a rate, 0 for none")

    @classmethod
    def from_statistics(
        cls,
        statistics: RayStatistics | BrickStatistics,
        prior: GammaPrior | PriorRule = "marginal",
        *,
        floor: float = 0.0,
    ) -> DecayRateMap:
        """Make the map, estimating the prior by the rule named."""
        return cls(statistics, prior if isinstance(prior, GammaPrior) else estimate_prior(statistics, prior), floor)

    @cached_property
    def rates(self) -> Array:
        """Decay rates, 1/m, shape ``grid.shape``; of a sparse map those of the visited cells."""
        path = self.statistics.path_lengths
        # A reflection exactly where a ray enters a cell leaves a hit without path: then the shortest path is assumed.
        safe = np.where((path == 0) & (self.statistics.hits > 0), 2.0**-20, path)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(safe > 0, np.maximum(self.statistics.hits / safe, self.floor), self.prior.mean)

    def reflection_probability(self) -> Array:
        """Probability that a ray along one cell edge is reflected, ``1 - exp(-rate * resolution)``: what plots show."""
        return -np.expm1(-self.rates * self.grid.resolution)

    def _bound_kernel(self) -> tuple[Any, ...]:
        mean = self.prior.mean
        if self.grid.dimension == 2:
            return decay_log_likelihoods, rimmed(self.rates, mean).ravel(), self.grid.shape, mean
        cells = self._laid_out(self.rates, mean)
        return spatial_decay_log_likelihoods, cells.directory, cells.values, cells.strides, cells.rim, cells.shape, mean


@dataclass(frozen=True)
class DecayRatePosterior(BeamModel):
    """The full posterior of every decay rate, ``Gamma(H + alpha, R + beta)`` (eq. 8.17).

    A ray's likelihood is the average over all maps by their belief (l_dec and the end of section 8.4.5); it is finite
    for every ray longer than 0. All space outside the grid is one cell with the prior.

    Parameters
    ----------
    statistics : RayStatistics or BrickStatistics
        What the mapping rays left behind.
    prior : GammaPrior
        alpha and beta, for all cells or for each.
    """

    prior: GammaPrior

    @classmethod
    def from_statistics(
        cls, statistics: RayStatistics | BrickStatistics, prior: GammaPrior | PriorRule = "marginal"
    ) -> DecayRatePosterior:
        """Make the posterior, estimating the prior by the rule named."""
        return cls(statistics, prior if isinstance(prior, GammaPrior) else estimate_prior(statistics, prior))

    @cached_property
    def shapes(self) -> Array:
        """Shape parameters ``H + alpha``, shape ``grid.shape``; of a sparse map those of the visited cells."""
        return self.statistics.hits.astype(np.float64) + self.prior.of_cells[0]

    @cached_property
    def paths(self) -> Array:
        """Path parameters ``R + beta``, m, shape as :attr:`shapes`."""
        return self.statistics.path_lengths + self.prior.of_cells[1]

    @property
    def mean(self) -> Array:
        """Posterior mean of the decay rates, 1/m."""
        return np.asarray(self.shapes / self.paths)

    def _bound_kernel(self) -> tuple[Any, ...]:
        prior = (self.prior.shape, self.prior.path)
        if self.grid.dimension == 2:
            tables = (rimmed(self.shapes, prior[0]).ravel(), rimmed(self.paths, prior[1]).ravel())
            return posterior_log_likelihoods, *tables, self.grid.shape, *prior
        shapes, paths = self._laid_out(self.shapes, prior[0]), self._laid_out(self.paths, prior[1])
        return (
            spatial_posterior_log_likelihoods, shapes.directory, shapes.values, paths.values, shapes.strides,
            shapes.shape, *prior,
        )  # fmt: skip
