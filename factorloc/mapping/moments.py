"""Moments: mean and variance of the values of many cells, of all together and without each in turn."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

__all__ = ["Moments"]

Array = npt.NDArray[np.float64]


class Moments(NamedTuple):
    """Mean and variance (over N, not N - 1)."""

    mean: Array
    variance: Array

    @classmethod
    def of(cls, values: Array) -> Moments:
        """Moments of all values (N,), of shape ()."""
        return cls(np.asarray(values.mean()), np.asarray(values.var()))

    @classmethod
    def without_each(cls, values: Array) -> Moments:
        """Moments of all values (N,) but one, for each one left out, of shape (N,); zero variance of less than two.

        From sums over all: with ``d`` the distance to the mean of all and ``Q`` the sum of ``d^2``, the mean of the
        others is ``mean - d / (N - 1)``, and theirs is ``Q - d^2 N / (N - 1)``. Where one value makes up nearly all of
        ``Q``, that difference loses its digits; only the farthest value can, and its others are summed up anew.
        """
        n = len(values)
        if n < 2:
            return cls(values.copy(), np.zeros(n))
        mean = values.mean()
        d = values - mean
        means = mean - d / (n - 1)
        variances = np.maximum((d**2).sum() - d**2 * (n / (n - 1)), 0.0) / (n - 1)
        far = int(np.abs(d).argmax())
        means[far], variances[far] = cls.of(np.delete(values, far))
        return cls(means, variances)
