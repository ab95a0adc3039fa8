"""Gamma priors of decay rates, learned from the map itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize
from scipy.special import digamma, gammaln

from factorloc.errors import MapError
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.ray_statistics import RayStatistics

__all__ = ["GammaPrior", "PriorRule", "estimate_prior"]

Array = npt.NDArray[np.float64]
PriorRule = Literal["marginal", "published"]

_MOST_CELLS = 500_000  # the optimum of a larger sample does not move by a digit that matters


@dataclass(frozen=True)
class GammaPrior:
    """Gamma distribution of a cell's decay rate before any ray has met it.

    Parameters
    ----------
    shape : float
        alpha: as if so many hits had been seen.
    path : float
        beta, m: along so much path.
    """

    shape: float
    path: float

    def __post_init__(self) -> None:
        if not (np.isfinite([self.shape, self.path]).all() and self.shape > 0 and self.path > 0):
            raise MapError(f"prior: shape {self.shape}, path {self.path} m; expected two positive numbers")

    @property
    def mean(self) -> float:
        """Expected decay rate, 1/m."""
        return self.shape / self.path

    @property
    def variance(self) -> float:
        """Variance of the decay rate, 1/m^2."""
        return self.shape / self.path**2


def estimate_prior(statistics: RayStatistics | BrickStatistics, rule: PriorRule = "marginal") -> GammaPrior:
    """Fit the prior to all cells that some ray has crossed.

    Decay rates are heavy-tailed (a wall cell of 0.1 m that stops every ray after a millimetre has 1000 1/m), so the
    thesis' moments are ruled by a few cells and leave a prior that says next to nothing. The default instead maximizes
    the marginal likelihood of the counts, with each rate integrated out:

        sum_i  log Gamma(H_i + a) - log Gamma(a) + a log b - (H_i + a) log(R_i + b).

    Parameters
    ----------
    statistics : RayStatistics or BrickStatistics
        Hits and path lengths.
    rule : {"marginal", "published"}
        Marginal likelihood (empirical Bayes), or the moments of H/R over the cells (thesis, section 8.5).

    Returns
    -------
    GammaPrior
        The prior of every cell, and of all space outside the grid.

    Raises
    ------
    MapError
        If no cell was crossed, nothing was ever hit, or the rule is unknown.
    """
    path = statistics.path_lengths
    crossed = path > 0
    H, R = statistics.hits[crossed].astype(np.float64), path[crossed]
    if len(H) == 0 or H.sum() == 0:
        raise MapError("map: no cell was hit; there is nothing to learn a prior from")
    if rule == "published":
        rate = H / R
        if not rate.var() > 0:
            raise MapError("map: all cells have one decay rate, so it has no moments; use the 'marginal' prior")
        return GammaPrior(float(rate.mean() ** 2 / rate.var()), float(rate.mean() / rate.var()))
    if rule != "marginal":
        raise MapError(f"prior: unknown rule '{rule}'; choose 'marginal' or 'published'")
    if len(H) > _MOST_CELLS:
        # Every k-th cell keeps the sample spread over the map and the result independent of a seed.
        stride = -(-len(H) // _MOST_CELLS)
        H, R = (H[::stride], R[::stride]) if H[::stride].any() else (H, R)
    return _maximize_marginal(H, R)


def _maximize_marginal(H: Array, R: Array) -> GammaPrior:
    hit = H > 0
    H_hit, n = H[hit], len(H)

    def negative(log_parameters: Array) -> tuple[float, Array]:
        a, b = np.exp(log_parameters)
        value = gammaln(H_hit + a).sum() - hit.sum() * gammaln(a) + n * a * np.log(b) - ((H + a) * np.log(R + b)).sum()
        slope_a = digamma(H_hit + a).sum() - hit.sum() * digamma(a) + n * np.log(b) - np.log(R + b).sum()
        slope_b = n * a / b - ((H + a) / (R + b)).sum()
        return -value / n, -np.array([a * slope_a, b * slope_b]) / n

    start = np.log([0.1, 0.1 * R.sum() / H.sum()])
    found = minimize(negative, start, jac=True, method="L-BFGS-B", bounds=[(-16.0, 12.0)] * 2)
    a, b = np.exp(found.x)
    return GammaPrior(float(a), float(b))
