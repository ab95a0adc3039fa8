"""Blur pyramid of a decay-rate map: what lets a scan find its place from far away."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter

from factorloc.errors import MapError
from factorloc.mapping.beam_model import rimmed
from factorloc.mapping.grid import Grid
from factorloc.mapping.ray_statistics import RayStatistics

__all__ = ["BLUR_REACH", "DEFAULT_BLURS", "BlurPyramid", "PyramidLevel", "blurred_counts", "checked_blurs"]

Array = npt.NDArray[np.float64]

BLUR_REACH = 3.0
"""Standard deviations after which a blur ends."""

DEFAULT_BLURS = (1.0, 0.5, 0.25, 0.1, 0.0)
"""Standard deviations of the blur, m, coarse to fine."""


@dataclass(frozen=True)
class PyramidLevel:
    """Decay rates blurred by one Gaussian.

    Parameters
    ----------
    blur : float
        Standard deviation of the Gaussian, m.
    rates, log_rates : ndarray, shape ``(n_x + 2) * (n_y + 2)``
        Flat arrays with a rim of one cell, 1/m.
    outside : float
        Rate outside the grid, 1/m.
    least_nll : float
        A bound no ray's negative log-likelihood comes close to from above: ``-log(max rate) - 1/2``. The square root
        of the distance to it is the residual of a ray.
    """

    blur: float
    rates: Array
    log_rates: Array
    outside: float
    least_nll: float


@dataclass(frozen=True)
class BlurPyramid:
    """Decay rates at several blurs, coarse to fine.

    Not the rates are blurred but the *counts*: ``rate = (G * H + rate_0 b) / (G * R + b)``, with the mean rate of the
    map ``rate_0`` and a short pseudo path ``b`` that holds cells nobody crossed at the mean. So a thin wall stays as
    likely to stop a ray as it was, only over a wider strip.

    Parameters
    ----------
    grid : Grid
        Where the cells lie.
    levels : tuple of PyramidLevel
        Coarse to fine.
    """

    grid: Grid
    levels: tuple[PyramidLevel, ...]

    @classmethod
    def from_statistics(
        cls, statistics: RayStatistics, blurs: Sequence[float] = DEFAULT_BLURS, pseudo_path: float | None = None
    ) -> BlurPyramid:
        """Blur the counts of a map.

        Parameters
        ----------
        statistics : RayStatistics
            Hits and path lengths.
        blurs : sequence of float
            Standard deviations, m, from coarse to fine.
        pseudo_path : float, optional
            Weight of the mean rate in every cell, m of path; one cell edge by default.

        Raises
        ------
        MapError
            If the blurs do not decrease, the pseudo path is not positive, or the map holds no hit.
        """
        checked = checked_blurs(blurs)
        b = statistics.grid.resolution if pseudo_path is None else pseudo_path
        if not (np.isfinite(b) and b > 0):
            raise MapError(f"pseudo_path: {b} m; expected a positive length")
        H, R = statistics.hits.astype(np.float64), statistics.path_lengths
        if H.sum() == 0 or R.sum() == 0:
            raise MapError("map: it holds no hit, or no path; nothing to localize in")
        mean = H.sum() / R.sum()
        levels = []
        for blur in checked:
            sigma = blur / statistics.grid.resolution
            H_blurred, R_blurred = (blurred_counts(values, sigma) for values in (H, R))
            rates = rimmed((H_blurred + mean * b) / (R_blurred + b), mean).ravel()
            least = -np.log(rates.max()) - 0.5
            levels.append(PyramidLevel(blur, rates, np.log(rates), float(mean), float(least)))
        return cls(statistics.grid, tuple(levels))

    @property
    def blurs(self) -> tuple[float, ...]:
        """Standard deviations of the levels, m."""
        return tuple(level.blur for level in self.levels)


def checked_blurs(blurs: Sequence[float]) -> tuple[float, ...]:
    """Blurs of a pyramid.

    Raises
    ------
    MapError
        If there is none, or they do not decrease down to 0 or more.
    """
    decreasing = all(a > b for a, b in itertools.pairwise(blurs))
    if not (len(blurs) > 0 and decreasing and np.isfinite(blurs[0]) and blurs[-1] >= 0):
        raise MapError(f"blurs: {tuple(blurs)} m; expected decreasing lengths, 0 at the end for the map itself")
    return tuple(float(blur) for blur in blurs)


def blurred_counts(values: Array, sigma: float) -> Array:
    """Counts blurred by a Gaussian of ``sigma`` cells; beyond the border nothing is known, neither hits nor path."""
    if sigma == 0:
        return values
    # Rounding may leave tiny negative sums.
    return np.maximum(gaussian_filter(values, sigma, mode="constant", truncate=BLUR_REACH), 0.0)
