"""Beta priors of reflection probabilities, learned from the map itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize
from scipy.special import betaln, digamma

from factorloc.errors import MapError
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.moments import Moments
from factorloc.mapping.prior import MOST_CELLS, PriorRule
from factorloc.mapping.ray_statistics import RayStatistics

__all__ = ["BetaPrior", "CellwiseBetaPrior", "estimate_beta_prior"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class BetaPrior:
    """Beta distribution of a cell's reflection probability before any ray has met it; (1, 1) is the uniform one.

    Parameters
    ----------
    hits : float
        alpha: as if so many rays had been reflected.
    misses : float
        beta: and so many had passed.
    """

    hits: float
    misses: float

    def __post_init__(self) -> None:
        if not (np.isfinite([self.hits, self.misses]).all() and self.hits > 0 and self.misses > 0):
            raise MapError(f"prior: {self.hits} hits, {self.misses} misses; expected two positive numbers")

    @property
    def mean(self) -> float:
        """Expected reflection probability."""
        return self.hits / (self.hits + self.misses)

    @property
    def variance(self) -> float:
        """Variance of the reflection probability."""
        total = self.hits + self.misses
        return (self.hits / total) * (self.misses / total) / (total + 1)

    @property
    def of_cells(self) -> tuple[float | Array, float | Array]:
        """Alpha and beta of the cells of the map."""
        return self.hits, self.misses


@dataclass(frozen=True, eq=False)
class CellwiseBetaPrior(BetaPrior):
    """A prior for each cell of a map, learned from all the others; ``hits`` and ``misses`` are those of unseen space.

    Parameters
    ----------
    cell_hits, cell_misses : ndarray, shape of the map's counts
        alpha and beta of the cells.
    """

    cell_hits: Array
    cell_misses: Array

    def __post_init__(self) -> None:
        super().__post_init__()
        both = np.stack([self.cell_hits, self.cell_misses])
        if not (np.isfinite(both) & (both > 0)).all():
            raise MapError("prior: hits and misses of the cells; expected positive numbers")

    @property
    def of_cells(self) -> tuple[float | Array, float | Array]:
        """Alpha and beta of the cells of the map."""
        return self.cell_hits, self.cell_misses


def estimate_beta_prior(statistics: RayStatistics | BrickStatistics, rule: PriorRule = "marginal") -> BetaPrior:
    """Fit the prior to all cells that some ray has visited.

    The default maximizes the marginal likelihood of the counts, with each probability integrated out (beta-binomial):

        sum_i  log B(H_i + a, M_i + b) - log B(a, b).

    It knows that a cell seen once tells less of its probability than one seen a thousand times. Moments of
    ``H / (H + M)`` do not: the chance of few visits goes into their variance, and the prior becomes too wide.

    Parameters
    ----------
    statistics : RayStatistics or BrickStatistics
        Hits and misses.
    rule : {"marginal", "published", "leave-one-out"}
        Marginal likelihood; the moments of H/(H + M) over the cells (thesis, section 8.5: ``alpha = E s``,
        ``beta = (1 - E) s`` with ``s = E (1 - E) / var - 1``); or, for each cell, the moments over all cells but
        itself.

    Returns
    -------
    BetaPrior
        The prior of every cell, and of all space outside the grid; of "leave-one-out" a :class:`CellwiseBetaPrior`.

    Raises
    ------
    MapError
        If no cell was hit or none was missed; if no cell was visited twice, which leaves the spread of probabilities
        unknown; if moments are asked for and there are none; or if the rule is unknown.
    """
    hits, misses = statistics.hits.astype(np.float64), statistics.misses.astype(np.float64)
    visited = hits + misses > 0
    H, M = hits[visited], misses[visited]
    if not (H.any() and M.any()):
        kind = "missed" if H.any() else "hit"
        raise MapError(f"map: no cell was {kind}; there is nothing to learn a prior from")
    if rule in ("published", "leave-one-out"):
        mu = H / (H + M)
        alpha, beta = (float(number) for number in _from_moments(Moments.of(mu)))
        if rule == "published":
            return BetaPrior(alpha, beta)
        cell_hits, cell_misses = np.full(hits.shape, alpha), np.full(hits.shape, beta)
        cell_hits[visited], cell_misses[visited] = _from_moments(Moments.without_each(mu))
        return CellwiseBetaPrior(alpha, beta, cell_hits, cell_misses)
    if rule != "marginal":
        raise MapError(f"prior: unknown rule '{rule}'; choose 'marginal', 'published' or 'leave-one-out'")
    if (H + M).max() < 2:
        raise MapError("map: no cell was visited twice, so how probabilities spread is unknown; give a BetaPrior")
    if len(H) > MOST_CELLS:
        # Every k-th cell keeps the sample spread over the map and the result independent of a seed.
        some = slice(None, None, -(-len(H) // MOST_CELLS))
        H, M = (H[some], M[some]) if H[some].any() and M[some].any() and (H + M)[some].max() > 1 else (H, M)
    return _maximize_marginal(H, M)


def _from_moments(moments: Moments) -> tuple[Array, Array]:
    """Alpha and beta of the Beta distributions with these moments."""
    mean, variance = moments
    if not (variance > 0).all():
        raise MapError("map: its cells (but one) have one reflection probability, which has no moments; use 'marginal'")
    total = mean * (1 - mean) / variance - 1
    # Rounding leaves a total of some 1e-16 where it should be zero: every probability is 0 or 1.
    if not (total > 1e-9).all():
        raise MapError("map: its cells reflected all rays or none, so moments leave no prior; use 'marginal'")
    return mean * total, (1 - mean) * total


def _maximize_marginal(H: Array, M: Array) -> BetaPrior:
    # Most cells are one of few kinds, seen a few times; each kind is looked at once.
    kinds, counts = np.unique(np.stack([H, M], -1).view(np.complex128), return_counts=True)
    H, M = np.ascontiguousarray(kinds.real), np.ascontiguousarray(kinds.imag)
    n = counts.sum()

    def negative(log_parameters: Array) -> tuple[float, Array]:
        a, b = np.exp(log_parameters)
        value = counts @ (betaln(H + a, M + b) - betaln(a, b))
        whole = digamma(H + M + a + b) - digamma(a + b)
        slope_a = counts @ (digamma(H + a) - digamma(a) - whole)
        slope_b = counts @ (digamma(M + b) - digamma(b) - whole)
        return -float(value) / n, -np.array([a * slope_a, b * slope_b]) / n

    mean = float(counts @ H / (counts @ (H + M)))
    start = np.log([mean, 1 - mean])
    found = minimize(negative, start, jac=True, method="L-BFGS-B", bounds=[(-16.0, 12.0)] * 2)
    a, b = np.exp(found.x)
    return BetaPrior(float(a), float(b))
