"""Beliefs: posteriors of all cells that are carried from session to session (thesis, eq. 8.11, 8.15 and 8.17)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.special import betaln, gammaln

from factorloc.errors import MapError
from factorloc.mapping.fading_counts import Counts, FadingCounts
from factorloc.mapping.grid import Grid
from factorloc.mapping.prior import GammaPrior

__all__ = ["BetaBelief", "GammaBelief"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class GammaBelief:
    """Belief about the decay rate of every cell, ``Gamma(H + alpha, R + beta)``, with counts that may fade.

    Forgetting is a power prior: before a session is added, what was learned so far is taken to the power gamma, and the
    prior fills the rest. The parameters so follow ``a_t = alpha + gamma (a_(t-1) - alpha) + H_t``, and b alike; with
    gamma = 1 the belief is that of all sessions at once.

    Parameters
    ----------
    counts : FadingCounts
        What was learned.
    prior : GammaPrior
        alpha and beta.
    """

    counts: FadingCounts
    prior: GammaPrior

    @classmethod
    def from_statistics(cls, statistics: Counts, prior: GammaPrior) -> GammaBelief:
        """Begin with one session."""
        return cls(FadingCounts.of(statistics), prior)

    @property
    def grid(self) -> Grid:
        """Where the cells lie."""
        return self.counts.grid

    @cached_property
    def shapes(self) -> Array:
        """Shape parameters, shape as the counts."""
        return self.counts.hits + self.prior.shape

    @cached_property
    def paths(self) -> Array:
        """Path parameters, m, shape as the counts."""
        return self.counts.path_lengths + self.prior.path

    @property
    def mean(self) -> Array:
        """Expected decay rates, 1/m."""
        return np.asarray(self.shapes / self.paths)

    @property
    def variance(self) -> Array:
        """Variances of the decay rates, 1/m^2."""
        return np.asarray(self.shapes / self.paths**2)

    def update(self, session: Counts, forgetting: float = 1.0) -> GammaBelief:
        """Return the belief after a session; arguments as :meth:`FadingCounts.update`."""
        return replace(self, counts=self.counts.update(session, forgetting))

    def __add__(self, other: GammaBelief) -> GammaBelief:
        """Merge beliefs from different sessions; the prior they share counts once.

        Raises
        ------
        MapError
            If priors or rasters differ.
        """
        _require_same(self.prior == other.prior)
        return replace(self, counts=self.counts + other.counts)

    def log_overlap(self, other: GammaBelief) -> Array:
        """Log of the Bhattacharyya coefficient ``integral of sqrt(p q)`` in each cell: 0 for equal beliefs, else below.

        Returns
        -------
        ndarray
            On the union of both grids (:meth:`FadingCounts.aligned`).
        """
        one, two = (replace(b, counts=c) for b, c in zip((self, other), self.counts.aligned(other.counts), strict=True))
        a, b = (one.shapes + two.shapes) / 2, (one.paths + two.paths) / 2
        log_paths = (one.shapes * np.log(one.paths / b) + two.shapes * np.log(two.paths / b)) / 2
        return np.minimum(gammaln(a) - (gammaln(one.shapes) + gammaln(two.shapes)) / 2 + log_paths, 0.0)


@dataclass(frozen=True)
class BetaBelief:
    """Belief about the reflection probability of every cell, ``Beta(H + alpha, M + beta)``, with counts that may fade.

    Forgetting as in :class:`GammaBelief`.

    Parameters
    ----------
    counts : FadingCounts
        What was learned.
    alpha, beta : float
        Of the prior; positive.

    Raises
    ------
    MapError
        If the prior is none.
    """

    counts: FadingCounts
    alpha: float
    beta: float

    def __post_init__(self) -> None:
        if not (np.isfinite([self.alpha, self.beta]).all() and self.alpha > 0 and self.beta > 0):
            raise MapError(f"prior: alpha {self.alpha}, beta {self.beta}; expected two positive numbers")

    @classmethod
    def from_statistics(cls, statistics: Counts, alpha: float, beta: float) -> BetaBelief:
        """Begin with one session."""
        return cls(FadingCounts.of(statistics), alpha, beta)

    @property
    def grid(self) -> Grid:
        """Where the cells lie."""
        return self.counts.grid

    @cached_property
    def alphas(self) -> Array:
        """First parameters, shape as the counts."""
        return self.counts.hits + self.alpha

    @cached_property
    def betas(self) -> Array:
        """Second parameters, shape as the counts."""
        return self.counts.misses + self.beta

    @property
    def mean(self) -> Array:
        """Expected reflection probabilities."""
        return np.asarray(self.alphas / (self.alphas + self.betas))

    @property
    def variance(self) -> Array:
        """Variances of the reflection probabilities."""
        total = self.alphas + self.betas
        return np.asarray(self.alphas / total * (self.betas / total) / (total + 1.0))

    def update(self, session: Counts, forgetting: float = 1.0) -> BetaBelief:
        """Return the belief after a session; arguments as :meth:`FadingCounts.update`."""
        return replace(self, counts=self.counts.update(session, forgetting))

    def __add__(self, other: BetaBelief) -> BetaBelief:
        """Merge beliefs from different sessions; the prior they share counts once.

        Raises
        ------
        MapError
            If priors or rasters differ.
        """
        _require_same((self.alpha, self.beta) == (other.alpha, other.beta))
        return replace(self, counts=self.counts + other.counts)

    def log_overlap(self, other: BetaBelief) -> Array:
        """Log of the Bhattacharyya coefficient in each cell, as :meth:`GammaBelief.log_overlap`."""
        one, two = (replace(b, counts=c) for b, c in zip((self, other), self.counts.aligned(other.counts), strict=True))
        middle = betaln((one.alphas + two.alphas) / 2, (one.betas + two.betas) / 2)
        return np.minimum(middle - (betaln(one.alphas, one.betas) + betaln(two.alphas, two.betas)) / 2, 0.0)


def _require_same(same: bool) -> None:
    if not same:
        raise MapError("beliefs: of different priors; carry all sessions with one")
