"""Decay-rate maps: the chance per metre that a ray is reflected, for every cell (thesis, chapters 7 and 8)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from factorloc.errors import MapError
from factorloc.mapping._forward_kernels import decay_log_likelihoods, posterior_log_likelihoods
from factorloc.mapping.accumulation import rays_in_map
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.grid import Grid
from factorloc.mapping.prior import GammaPrior, PriorRule, estimate_prior
from factorloc.mapping.ray_statistics import RayStatistics
from factorloc.mapping.spatial_accumulation import spatial_rays_in_map
from factorloc.mapping.spatial_likelihood import decay_log_likelihood, posterior_log_likelihood
from factorloc.rays import pack
from factorloc.scan import Scan

__all__ = ["DecayRateMap", "DecayRatePosterior", "rimmed"]

Array = npt.NDArray[np.float64]


def rimmed(values: npt.ArrayLike, rim: float) -> Array:
    """Surround an array by one cell of a constant, as kernels want their grids; contiguous float64."""
    return np.pad(np.asarray(values, np.float64), 1, constant_values=rim)


def _world_rays(scan: Scan, T_map_body: npt.ArrayLike, grid: Grid) -> tuple[Array, Array]:
    if scan.dimension != grid.dimension:
        raise MapError(f"scan: it has {scan.dimension} dimensions, the map {grid.dimension}; use a map made for it")
    rays, pose = pack([scan]), np.asarray(T_map_body, np.float64)[None]
    return rays_in_map(rays, pose) if grid.dimension == 2 else spatial_rays_in_map(rays, pose)


@dataclass(frozen=True)
class DecayRateMap:
    """One decay rate per cell, the one that makes the mapping rays most likely: ``H / R`` (eq. 7.10).

    A map by maximum likelihood takes its data at their word: a cell no ray was reflected in has rate 0, and a ray that
    ends there has probability 0 (log-likelihood minus infinity). Cells no ray has crossed, and the space outside, have
    the prior's mean.

    Parameters
    ----------
    statistics : RayStatistics or BrickStatistics
        What the mapping rays left behind.
    prior : GammaPrior
        Its mean fills unseen space.
    """

    statistics: RayStatistics | BrickStatistics
    prior: GammaPrior

    @classmethod
    def from_statistics(
        cls, statistics: RayStatistics | BrickStatistics, prior: GammaPrior | PriorRule = "marginal"
    ) -> DecayRateMap:
        """Make the map, estimating the prior by the rule named."""
        return cls(statistics, prior if isinstance(prior, GammaPrior) else estimate_prior(statistics, prior))

    @property
    def grid(self) -> Grid:
        """Where the cells lie."""
        return self.statistics.grid

    @cached_property
    def rates(self) -> Array:
        """Decay rates, 1/m, shape ``grid.shape``; of a sparse map those of the visited cells."""
        path = self.statistics.path_lengths
        # A reflection exactly where a ray enters a cell leaves a hit without path: then the shortest path is assumed.
        safe = np.where((path == 0) & (self.statistics.hits > 0), 2.0**-20, path)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(safe > 0, self.statistics.hits / safe, self.prior.mean)

    def reflection_probability(self) -> Array:
        """Probability that a ray along one cell edge is reflected, ``1 - exp(-rate * resolution)``: what plots show."""
        return -np.expm1(-self.rates * self.grid.resolution)

    def log_likelihood(self, scan: Scan, T_map_body: npt.ArrayLike) -> Array:
        """Log-likelihood of each ray of a scan (eq. 7.13 to 7.16).

        Parameters
        ----------
        scan : Scan
            Of the map's dimension.
        T_map_body : array_like, shape (3,) or (4, 4)
            Pose of the body.

        Returns
        -------
        ndarray, shape (N,)
            Log densities (1/m) of returns, log probabilities of rays out of range; -inf where the map excludes them.

        Raises
        ------
        MapError
            If scan and map differ in dimension.
        """
        origins, directions = _world_rays(scan, T_map_body, self.grid)
        mean = self.prior.mean
        if self.grid.dimension == 3:
            return decay_log_likelihood(self.statistics, self.rates, mean, scan, origins, directions)
        with np.errstate(divide="ignore"):
            log_rates = rimmed(np.log(self.rates), np.log(mean))
        out = np.empty(len(scan))
        decay_log_likelihoods(
            rimmed(self.rates, mean).ravel(),
            log_rates.ravel(),
            (self.grid.shape[0], self.grid.shape[1]),
            mean,
            float(np.log(mean)),
            np.array(self.grid.origin),
            self.grid.resolution,
            origins,
            directions,
            scan.ranges,
            scan.status,
            np.array(scan.range_limits),
            out,
        )
        return out


@dataclass(frozen=True)
class DecayRatePosterior:
    """The full posterior of every decay rate, ``Gamma(H + alpha, R + beta)`` (eq. 8.17).

    Parameters
    ----------
    statistics : RayStatistics or BrickStatistics
        What the mapping rays left behind.
    prior : GammaPrior
        alpha and beta.
    """

    statistics: RayStatistics | BrickStatistics
    prior: GammaPrior

    @classmethod
    def from_statistics(
        cls, statistics: RayStatistics | BrickStatistics, prior: GammaPrior | PriorRule = "marginal"
    ) -> DecayRatePosterior:
        """Make the posterior, estimating the prior by the rule named."""
        return cls(statistics, prior if isinstance(prior, GammaPrior) else estimate_prior(statistics, prior))

    @property
    def grid(self) -> Grid:
        """Where the cells lie."""
        return self.statistics.grid

    @cached_property
    def shapes(self) -> Array:
        """Shape parameters ``H + alpha``, shape ``grid.shape``; of a sparse map those of the visited cells."""
        return self.statistics.hits.astype(np.float64) + self.prior.shape

    @cached_property
    def paths(self) -> Array:
        """Path parameters ``R + beta``, m, shape as :attr:`shapes`."""
        return self.statistics.path_lengths + self.prior.path

    @property
    def mean(self) -> Array:
        """Posterior mean of the decay rates, 1/m."""
        return np.asarray(self.shapes / self.paths)

    def log_likelihood(self, scan: Scan, T_map_body: npt.ArrayLike) -> Array:
        """Log-likelihood of each ray, all maps averaged by their belief (l_dec and the end of section 8.4.5).

        Parameters and returns as :meth:`DecayRateMap.log_likelihood`; always finite for rays longer than 0.
        """
        origins, directions = _world_rays(scan, T_map_body, self.grid)
        prior = (self.prior.shape, self.prior.path)
        if self.grid.dimension == 3:
            return posterior_log_likelihood(
                self.statistics, self.shapes, self.paths, prior, scan, origins, directions
            )
        out = np.empty(len(scan))
        posterior_log_likelihoods(
            rimmed(self.shapes, self.prior.shape).ravel(),
            rimmed(self.paths, self.prior.path).ravel(),
            (self.grid.shape[0], self.grid.shape[1]),
            self.prior.shape,
            self.prior.path,
            np.array(self.grid.origin),
            self.grid.resolution,
            origins,
            directions,
            scan.ranges,
            scan.status,
            np.array(scan.range_limits),
            out,
        )
        return out
