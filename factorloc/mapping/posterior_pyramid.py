"""Blur pyramids of the full posterior of decay rates, planar and spatial."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.errors import MapError
from factorloc.mapping.beam_model import rimmed
from factorloc.mapping.grid import Grid
from factorloc.mapping.prior import GammaPrior, PriorRule, estimate_prior
from factorloc.mapping.pyramid import DEFAULT_BLURS, blurred_counts, checked_blurs
from factorloc.mapping.ray_statistics import RayStatistics

__all__ = ["PosteriorLevel", "PosteriorPyramid"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class PosteriorLevel:
    """Gamma posteriors of counts blurred by one Gaussian.

    Parameters
    ----------
    blur : float
        Standard deviation of the Gaussian, m.
    shapes, paths, log_rates : ndarray, shape ``(n_x + 2) * (n_y + 2)``
        a, b (m) and log of the effective rate ``a / (b + h / 2)`` (1/m) of a ray that ends halfway through a cell of
        edge h, flat arrays with a rim of one cell.
    least_nll : float
        A bound no ray's negative log-likelihood comes close to from above: ``-log(max effective rate) - 1/2``.
    """

    blur: float
    shapes: Array
    paths: Array
    log_rates: Array
    least_nll: float


@dataclass(frozen=True)
class PosteriorPyramid:
    """Posteriors ``Gamma(G * H + alpha, G * R + beta)`` of the decay rates at several blurs, coarse to fine.

    Not the posteriors are blurred but the *counts*, as in :class:`~factorloc.mapping.pyramid.BlurPyramid`; the prior is
    that of the map on all levels.

    Parameters
    ----------
    grid : Grid
        Where the cells lie.
    prior : GammaPrior
        Of every cell, and of all that lies outside.
    levels : tuple of PosteriorLevel
        Coarse to fine.
    """

    grid: Grid
    prior: GammaPrior
    levels: tuple[PosteriorLevel, ...]

    @classmethod
    def from_statistics(
        cls,
        statistics: RayStatistics,
        blurs: Sequence[float] = DEFAULT_BLURS,
        prior: GammaPrior | PriorRule = "marginal",
    ) -> PosteriorPyramid:
        """Blur the counts of a map.

        Parameters
        ----------
        statistics : RayStatistics
            Hits and path lengths.
        blurs : sequence of float
            Standard deviations, m, from coarse to fine.
        prior : GammaPrior or {"marginal", "published"}
            Of the rates, or the rule to estimate it by.

        Raises
        ------
        MapError
            If the map is spatial or holds no hit, or the blurs do not decrease.
        """
        if statistics.grid.dimension != 2:
            raise MapError("map: spatial; use SpatialPosteriorPyramid")
        checked = checked_blurs(blurs)
        chosen = prior if isinstance(prior, GammaPrior) else estimate_prior(statistics, prior)
        H, R = statistics.hits.astype(np.float64), statistics.path_lengths
        levels = []
        for blur in checked:
            sigma = blur / statistics.grid.resolution
            shapes = rimmed(blurred_counts(H, sigma) + chosen.shape, chosen.shape).ravel()
            paths = rimmed(blurred_counts(R, sigma) + chosen.path, chosen.path).ravel()
            log_rates = np.log(shapes / (paths + statistics.grid.resolution / 2))
            levels.append(PosteriorLevel(blur, shapes, paths, log_rates, float(-log_rates.max() - 0.5)))
        return cls(statistics.grid, chosen, tuple(levels))

    @property
    def blurs(self) -> tuple[float, ...]:
        """Standard deviations of the levels, m."""
        return tuple(level.blur for level in self.levels)
