"""Evidence: how probable the counts of a cell are when its rate is unknown, in closed form."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy.special import betaln, gammaln

from factorloc.errors import MapError
from factorloc.mapping.fading_counts import FadingCounts
from factorloc.mapping.prior import GammaPrior

__all__ = ["Evidence", "RateEvidence", "ReflectionEvidence"]

Array = npt.NDArray[np.float64]


class Evidence(Protocol):
    """What change detection and map correlation ask of a model of a cell."""

    def trials(self, counts: FadingCounts) -> tuple[Array, Array]:
        """Hits of each cell, and among what they were: path or misses."""
        ...

    def log_marginal(self, hits: Array, trials: Array) -> Array:
        """Log-probability of counts, the rate integrated out; without factors of the counts' order."""
        ...

    def log_bayes_factor(self, first: tuple[Array, Array], second: tuple[Array, Array]) -> Array:
        """Log of ``p(both | two rates) / p(both | one rate)``, the sum of two marginals less that of the sum."""
        ...


@dataclass(frozen=True)
class RateEvidence:
    """Evidence of the decay-rate model: hits along a path, with a rate of a Gamma prior.

    Parameters
    ----------
    prior : GammaPrior
        alpha and beta.
    """

    prior: GammaPrior

    def trials(self, counts: FadingCounts) -> tuple[Array, Array]:
        """Hits and path lengths."""
        return counts.hits, counts.path_lengths

    def log_marginal(self, hits: Array, trials: Array) -> Array:
        """``log Gamma(H + a) - log Gamma(a) + a log b - (H + a) log(R + b)``."""
        a, b = self.prior.shape, self.prior.path
        log_path = np.log(trials + b)
        return np.asarray(_log_gamma(hits, a) - gammaln(a) + a * np.log(b) - (hits + a) * log_path)

    def log_bayes_factor(self, first: tuple[Array, Array], second: tuple[Array, Array]) -> Array:
        """Two rates against one; arranged so that large counts do not cancel more than they must."""
        (H_1, R_1), (H_2, R_2) = first, second
        a, b = self.prior.shape, self.prior.path
        both = R_1 + R_2 + b
        order = betaln(H_1 + a, H_2 + a) - betaln(H_1 + H_2 + a, a)
        # The rest is -H_1 log(b_1 / both) - H_2 log(b_2 / both) + a log(b both / (b_1 b_2)), with b_i = R_i + b.
        share_1, share_2 = _log_share(R_1 + b, R_2, both), _log_share(R_2 + b, R_1, both)
        return np.asarray(order - H_1 * share_1 - H_2 * share_2 - a * (np.log1p(R_1 / b) + share_2))


@dataclass(frozen=True)
class ReflectionEvidence:
    """Evidence of the reflection model: hits among hits and misses, with a probability of a Beta prior.

    Parameters
    ----------
    alpha, beta : float
        Positive.
    """

    alpha: float
    beta: float

    def __post_init__(self) -> None:
        if not (np.isfinite([self.alpha, self.beta]).all() and self.alpha > 0 and self.beta > 0):
            raise MapError(f"prior: alpha {self.alpha}, beta {self.beta}; expected two positive numbers")

    def trials(self, counts: FadingCounts) -> tuple[Array, Array]:
        """Hits and misses."""
        return counts.hits, counts.misses

    def log_marginal(self, hits: Array, trials: Array) -> Array:
        """``log B(H + a, M + b) - log B(a, b)``."""
        a, b = self.alpha, self.beta
        log_beta = _log_gamma(hits, a) + _log_gamma(trials, b) - _log_gamma(hits + trials, a + b)
        return np.asarray(log_beta - betaln(a, b))

    def log_bayes_factor(self, first: tuple[Array, Array], second: tuple[Array, Array]) -> Array:
        """Two probabilities against one."""
        a, b = self.alpha, self.beta
        both = betaln(first[0] + second[0] + a, first[1] + second[1] + b) + betaln(a, b)
        return np.asarray(betaln(first[0] + a, first[1] + b) + betaln(second[0] + a, second[1] + b) - both)


def _log_gamma(counts: Array, offset: float) -> Array:
    """``log Gamma(counts + offset)``; whole counts, if there are many of each, are looked up."""
    values = np.asarray(counts, np.float64)
    most = values.max(initial=0.0)
    if 4 * most < values.size:
        whole = values.astype(np.int64)
        if np.array_equal(whole, values):
            return np.asarray(gammaln(np.arange(int(most) + 1) + offset)[whole])
    return np.asarray(gammaln(values + offset))


def _log_share(part: Array, rest: Array, whole: Array) -> Array:
    """``log(part / whole)``, where ``part + rest = whole``; exact near 0 and near 1."""
    return np.where(rest < part, np.log1p(-rest / whole), np.log(part / whole))
