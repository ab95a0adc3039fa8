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
from factorloc.mapping.moments import Moments
from factorloc.mapping.ray_statistics import RayStatistics

__all__ = ["MOST_CELLS", "CellwiseGammaPrior", "GammaPrior", "PriorRule", "estimate_prior"]

Array = npt.NDArray[np.float64]
PriorRule = Literal["marginal", "published", "leave-one-out"]

MOST_CELLS = 500_000
"""Cells a marginal prior is fitted to; the optimum of a larger sample does not move by a digit that matters."""


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

    @property
    def of_cells(self) -> tuple[float | Array, float | Array]:
        """Alpha and beta of the cells of the map."""
        return self.shape, self.path


@dataclass(frozen=True, eq=False)
class CellwiseGammaPrior(GammaPrior):
    """A prior for each cell of a map, learned from all the others; ``shape`` and ``path`` are those of unseen space.

    Parameters
    ----------
    shapes, paths : ndarray, shape of the map's counts
        alpha and beta of the cells.
    """

    shapes: Array
    paths: Array

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (np.isfinite([self.shapes, self.paths]).all() and (self.shapes > 0).all() and (self.paths > 0).all()):
            raise MapError("prior: shapes and paths of the cells; expected positive numbers")

    @property
    def of_cells(self) -> tuple[float | Array, float | Array]:
        """Alpha and beta of the cells of the map."""
        return self.shapes, self.paths


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
    rule : {"marginal", "published", "leave-one-out"}
        Marginal likelihood (empirical Bayes); the moments of H/R over the cells (thesis, section 8.5:
        ``alpha = E^2 / var``, ``beta = E / var``); or, for each cell, the moments over all cells but itself.

    Returns
    -------
    GammaPrior
        The prior of every cell, and of all space outside the grid; of "leave-one-out" a :class:`CellwiseGammaPrior`.

    Raises
    ------
    MapError
        If no cell was crossed, nothing was ever hit, all cells have one rate where moments are asked for, or the rule
        is unknown.
    """
    path = statistics.path_lengths
    crossed = path > 0
    H, R = statistics.hits[crossed].astype(np.float64), path[crossed]
    if len(H) == 0 or H.sum() == 0:
        raise MapError("map: no cell was hit; there is nothing to learn a prior from")
    if rule == "published":
        moments = Moments.of(H / R)
        return GammaPrior(*(float(number) for number in _from_moments(moments)))
    if rule == "leave-one-out":
        moments = Moments.of(H / R)
        shape, beta = (float(number) for number in _from_moments(moments))
        shapes, paths = np.full(path.shape, shape), np.full(path.shape, beta)
        shapes[crossed], paths[crossed] = _from_moments(Moments.without_each(H / R))
        return CellwiseGammaPrior(shape, beta, shapes, paths)
    if rule != "marginal":
        raise MapError(f"prior: unknown rule '{rule}'; choose 'marginal', 'published' or 'leave-one-out'")
    if len(H) > MOST_CELLS:
        # Every k-th cell keeps the sample spread over the map and the result independent of a seed.
        stride = -(-len(H) // MOST_CELLS)
        H, R = (H[::stride], R[::stride]) if H[::stride].any() else (H, R)
    return _maximize_marginal(H, R)


def _from_moments(moments: Moments) -> tuple[Array, Array]:
    """Alpha and beta of the Gamma distributions with these moments."""
    mean, variance = moments
    if not ((variance > 0) & (mean > 0)).all():
        raise MapError("map: its cells (but one) have one decay rate, which has no moments; use the 'marginal' prior")
    return mean * (mean / variance), mean / variance


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
