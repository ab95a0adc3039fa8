"""Reflection maps: the chance that a ray which enters a cell is reflected in it (thesis, chapters 7 and 8)."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from factorloc.errors import MapError
from factorloc.mapping._reflection_kernels import reflection_log_likelihoods
from factorloc.mapping._spatial_reflection_kernels import spatial_reflection_log_likelihoods
from factorloc.mapping.beam_model import BeamModel, rimmed
from factorloc.mapping.beta_prior import BetaPrior, estimate_beta_prior
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.prior import PriorRule
from factorloc.mapping.ray_statistics import RayStatistics

__all__ = ["ReflectionMap", "ReflectionModel", "ReflectionPosterior"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class ReflectionModel(BeamModel):
    """Reflection probabilities of cells, and the likelihood of rays they give (eq. 7.23).

    A cell reflects with the same probability however far a ray travels in it. Within the cell any place on the ray's
    chord is as good (eq. 7.30 to 7.32, where v_i must read v_k), so a return has the density ``P(cell) / chord``, and a
    limit of the range inside a cell parts the cell's probability as it parts the chord: sub, returns and sup add up to
    one. The end of section 8.4.5 counts the whole of the cell that holds a limit as passed, both below the minimum and
    beyond the maximum, and its parts do not. The chord of a ray's first cell begins where the ray does. Only a ray that
    cuts a corner by less than 2^-20 m, no visit when rays are counted, is not held to add up there.

    Space outside the grid goes on as cells of the same raster.

    Parameters
    ----------
    statistics : RayStatistics or BrickStatistics
        What the mapping rays left behind.
    prior : BetaPrior
        Its mean fills space outside the grid.
    """

    prior: BetaPrior

    @cached_property
    def probabilities(self) -> Array:
        """Reflection probability of each cell, shape ``grid.shape``; of a sparse map those of the visited cells."""
        hits, misses = self._counts()
        return np.asarray(hits / (hits + misses))

    @abstractmethod
    def _counts(self) -> tuple[Array, Array]:
        """Hits and misses of each cell, real or as if, whose ratio is its reflection probability."""

    def _bound_kernel(self) -> tuple[Any, ...]:
        outside = float(_log_miss(self.prior.hits, self.prior.misses))
        log_misses = _log_miss(*self._counts())
        if self.grid.dimension == 2:
            return reflection_log_likelihoods, rimmed(log_misses, outside).ravel(), self.grid.shape, outside
        cells = self._laid_out(log_misses, outside)
        return (
            spatial_reflection_log_likelihoods, cells.directory, cells.values, cells.strides, cells.shape, outside
        )  # fmt: skip


def _log_miss(hits: npt.ArrayLike, misses: npt.ArrayLike) -> Array:
    """Log-probability that a cell lets a ray pass, to all digits wherever between 0 and 1 it lies."""
    H, M = np.asarray(hits, np.float64), np.asarray(misses, np.float64)
    with np.errstate(divide="ignore"):
        return np.where(H < M, np.log1p(-np.minimum(H / (H + M), 0.5)), np.log(M / (H + M)))


@dataclass(frozen=True)
class ReflectionMap(ReflectionModel):
    """One reflection probability per cell, the one that makes the mapping rays most likely: ``H / (H + M)`` (eq. 8.16).

    A map by maximum likelihood takes its data at their word: no ray may end in a cell without hits, nor pass one
    without misses (log-likelihood minus infinity). A floor leaves such rays unlikely. Cells no ray has visited have the
    prior's mean, as the space outside.

    Parameters
    ----------
    statistics : RayStatistics or BrickStatistics
        What the mapping rays left behind.
    prior : BetaPrior
        Its mean fills unseen space.
    floor : float
        Lowest probability of a visited cell to reflect a ray, and not to; 0 is maximum likelihood.

    Raises
    ------
    MapError
        If the floor does not lie between 0 and 1/2.
    """

    floor: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.floor <= 0.5:
            raise MapError(f"floor: {self.floor}; expected a probability of at most 1/2, 0 for none")

    @classmethod
    def from_statistics(
        cls,
        statistics: RayStatistics | BrickStatistics,
        prior: BetaPrior | PriorRule = "marginal",
        *,
        floor: float = 0.0,
    ) -> ReflectionMap:
        """Make the map, estimating the prior by the rule named."""
        return cls(statistics, prior if isinstance(prior, BetaPrior) else estimate_beta_prior(statistics, prior), floor)

    def _counts(self) -> tuple[Array, Array]:
        hits, misses = self.statistics.hits.astype(np.float64), self.statistics.misses.astype(np.float64)
        visits = hits + misses
        seen, least = visits > 0, self.floor * visits
        H, M = np.clip(hits, least, visits - least), np.clip(misses, least, visits - least)
        return np.where(seen, H, self.prior.hits), np.where(seen, M, self.prior.misses)


@dataclass(frozen=True)
class ReflectionPosterior(ReflectionModel):
    """The full posterior of every reflection probability, ``Beta(H + alpha, M + beta)`` (eq. 8.15).

    A ray's likelihood is the average over all maps by their belief (l_ref, eq. 8.22). As a ray meets a cell once and
    counts it as hit or miss, that is its likelihood under the mean of the belief.

    Parameters
    ----------
    statistics : RayStatistics or BrickStatistics
        What the mapping rays left behind.
    prior : BetaPrior
        alpha and beta, for all cells or for each.
    """

    @classmethod
    def from_statistics(
        cls, statistics: RayStatistics | BrickStatistics, prior: BetaPrior | PriorRule = "marginal"
    ) -> ReflectionPosterior:
        """Make the posterior, estimating the prior by the rule named."""
        return cls(statistics, prior if isinstance(prior, BetaPrior) else estimate_beta_prior(statistics, prior))

    @cached_property
    def alphas(self) -> Array:
        """``H + alpha`` of each cell, shape ``grid.shape``; of a sparse map those of the visited cells."""
        return self.statistics.hits.astype(np.float64) + self.prior.of_cells[0]

    @cached_property
    def betas(self) -> Array:
        """``M + beta`` of each cell, shape as :attr:`alphas`."""
        return self.statistics.misses.astype(np.float64) + self.prior.of_cells[1]

    @property
    def mean(self) -> Array:
        """Posterior mean of the reflection probabilities."""
        return self.probabilities

    def _counts(self) -> tuple[Array, Array]:
        return self.alphas, self.betas
