"""Weights of lines, how heavy false ones may be, and which poses hold all but a small part of the odds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

__all__ = ["PARTS", "Weights", "likely_depth", "surprising_weight", "weights_of"]

Array = npt.NDArray[np.float64]
Weights = npt.NDArray[np.int32]

PARTS = 8.0  # units of weight to a factor of e


def weights_of(doubts: Array) -> Weights:
    """Log odds of lines to be true, in eighths of a natural unit; at least one.

    Parameters
    ----------
    doubts : ndarray, shape (K,)
        Probabilities to be false, in (0, 0.5).
    """
    return np.maximum(np.rint(PARTS * np.log((1.0 - doubts) / doubts)), 1.0).astype(np.int32)


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


def likely_depth(odds: Sequence[Array], confidence: float) -> int:
    """How far below the largest sum of weights to keep poses, so that the others hold at most the rest of the odds.

    Parameters
    ----------
    odds : sequence of ndarray
        Volumes of poses by how far their sums of weights are below the largest, for each part of them.
    confidence : float
        In (0, 1).
    """
    volumes = np.zeros(max(len(one) for one in odds))
    for one in odds:
        volumes[: len(one)] += one
    odds_to = np.cumsum(volumes * np.exp(-np.arange(len(volumes)) / PARTS))
    return int(np.searchsorted(odds_to, confidence * odds_to[-1]))
