"""Resampling: draw particles by their weights. Each policy is a function, passed as a value."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

__all__ = ["RESAMPLING", "Resampling", "multinomial", "residual", "stratified", "systematic"]

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]

Resampling: TypeAlias = Callable[[npt.ArrayLike, int, np.random.Generator], Index]
"""Draws ``count`` indices by weights (P,) that add up to one; each index has ``count * weight`` copies on average."""


def systematic(weights: npt.ArrayLike, count: int, rng: np.random.Generator) -> Index:
    """Draw at equal steps from one random offset ("low variance"): copies differ from their mean by less than one.

    Parameters
    ----------
    weights : array_like, shape (P,)
        Weights that add up to one.
    count : int
        Indices to draw.
    rng : numpy.random.Generator
        Source of randomness.

    Returns
    -------
    ndarray of int64, shape (count,)
        Increasing indices.
    """
    return _at(weights, (rng.random() + np.arange(count)) / count)


def stratified(weights: npt.ArrayLike, count: int, rng: np.random.Generator) -> Index:
    """Draw once in each of ``count`` equal parts: copies differ from their mean by less than two."""
    return _at(weights, (rng.random(count) + np.arange(count)) / count)


def multinomial(weights: npt.ArrayLike, count: int, rng: np.random.Generator) -> Index:
    """Draw independently, in no order: the most noise, and what theory assumes."""
    return _at(weights, rng.random(count))


def residual(weights: npt.ArrayLike, count: int, rng: np.random.Generator) -> Index:
    """Copy each index as often as is certain, and draw the rest systematically by what remains of the weights."""
    expected = np.asarray(weights, np.float64) * count
    copies = np.floor(expected).astype(np.int64)
    rest = count - int(copies.sum())
    certain = np.repeat(np.arange(len(copies), dtype=np.int64), copies)[:count]
    if rest <= 0:
        return certain
    remainder = expected - copies
    return np.concatenate([certain, systematic(remainder / remainder.sum(), rest, rng)])


def _at(weights: npt.ArrayLike, places: Array) -> Index:
    """Indices whose shares of [0, 1) hold some places."""
    edges = np.cumsum(np.asarray(weights, np.float64))
    # Rounding leaves the last edge short of one or beyond; the share of an index of weight zero is empty.
    found = np.searchsorted(edges, places * edges[-1], side="right")
    return np.asarray(np.minimum(found, int(np.argmax(edges == edges[-1]))), np.int64)


RESAMPLING: dict[str, Resampling] = {
    "systematic": systematic,
    "stratified": stratified,
    "residual": residual,
    "multinomial": multinomial,
}
"""Policies by name, as settings know them."""
