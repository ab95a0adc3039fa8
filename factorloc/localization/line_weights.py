"""Weights of lines, how heavy false ones may be, and which poses hold all but a small part of the odds."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["likely_level", "surprising_weight", "weights_of"]

Array = npt.NDArray[np.float64]
Weights = npt.NDArray[np.int32]

_PARTS = 8.0  # units of weight to a factor of e


def weights_of(doubts: Array) -> Weights:
    """Log odds of lines to be true, in eighths of a natural unit; at least one.

    Parameters
    ----------
    doubts : ndarray, shape (K,)
        Probabilities to be false, in (0, 0.5).
    """
    return np.maximum(np.rint(_PARTS * np.log((1.0 - doubts) / doubts)), 1.0).astype(np.int32)


def surprising_weight(weights: Weights, doubts: Array, surprise: float) -> int:
    """Least weight that false lines exceed together with no more than a probability, if they are independent.

    Parameters
    ----------
    weights, doubts : ndarray, shape (K,)
        Of the lines.
    surprise : float
        The probability.
    """
    chances = np.zeros(int(weights.sum()) + 1)
    chances[0] = 1.0
    for weight, doubt in zip(weights.tolist(), doubts.tolist(), strict=True):
        falls = doubt * chances[: len(chances) - weight]
        chances *= 1.0 - doubt
        chances[weight:] += falls
    beyond = 1.0 - np.cumsum(chances)
    return int(np.argmax(beyond <= surprise + 1e-12))


def likely_level(sums: npt.NDArray[np.int32], best: int, confidence: float) -> int:
    """Least sum of weights to keep, so that cells below hold at most the rest of the odds.

    Parameters
    ----------
    sums : ndarray of int
        Weights of the lines satisfied in cells of one size; negative where no pose is possible.
    best : int
        The largest.
    confidence : float
        In (0, 1).
    """
    cells = np.bincount(sums[sums >= 0], minlength=best + 1)[::-1]
    odds = np.cumsum(cells * np.exp(-np.arange(best + 1) / _PARTS))
    return best - int(np.searchsorted(odds, confidence * odds[-1]))
