"""Reweighting: which rays of a scan are weighed, with what exponent, and what came of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.localization.particles import Particles, log_sum_exp
from factorloc.rays import pack, spread
from factorloc.scan import Scan

__all__ = ["Reweighting", "choose_rays", "tempered_exponent"]

Array = npt.NDArray[np.float64]

_LEAST_EXPONENT = 1e-6  # of the information; a scan is never tempered further
_HALVINGS = 24


@dataclass(frozen=True)
class Reweighting:
    """What a scan did to the weights.

    Parameters
    ----------
    log_likelihood : float
        Logarithm of the mean likelihood of the scan over the particles, raised to the exponent; 0 of a scan without
        information, -inf of one that no particle explains.
    rays : int
        Rays weighed; 0 if the scan says nothing.
    exponent : float
        Exponent of the likelihood, lower than the information where it was tempered.
    tempered : bool
        Whether it was.
    """

    log_likelihood: float
    rays: int
    exponent: float
    tempered: bool = False

    @property
    def informative(self) -> bool:
        """Whether the scan had anything to say."""
        return self.rays > 0

    @property
    def excluded(self) -> bool:
        """Whether no particle explains the scan: all likelihoods are zero, or all particles outside the map."""
        return self.log_likelihood == -np.inf


def choose_rays(scan: Scan, count: int) -> Scan:
    """Return some rays of a scan: evenly spaced in the plane, spread over the surroundings in space.

    In space only returns are chosen, by :func:`factorloc.rays.spread`, in the frame of the body; in the plane rays of
    every status.
    """
    if scan.dimension == 2:
        if len(scan) <= count:
            return scan
        return scan.select(np.round((np.arange(count) + 0.5) * len(scan) / count - 0.5).astype(np.int64))
    rays = spread(pack([scan]), count)
    return Scan(
        rays.directions / np.linalg.norm(rays.directions, axis=1, keepdims=True),
        rays.ranges,
        rays.status,
        scan.range_limits,
        origins=rays.origins,
        stamp=scan.stamp,
    )


def tempered_exponent(particles: Particles, logs: Array, information: float, least: float | None) -> float:
    """Largest exponent of a likelihood, up to the information, that leaves enough particles effective.

    Parameters
    ----------
    particles : Particles
        Before reweighting.
    logs : ndarray, shape (P,)
        Log-likelihoods; -inf ones are out in any case, and do not count among the particles.
    information : float
        The exponent wanted.
    least : float, optional
        Share of the particles that must be effective afterwards; without, the information is the answer.
    """
    possible = np.isfinite(logs)
    if least is None or not possible.any():
        return information
    before, finite = particles.log_weights[possible], logs[possible]
    wanted = float(np.log(least * len(finite)))

    def enough(exponent: float) -> bool:
        after = before + exponent * finite
        return 2 * log_sum_exp(after) - log_sum_exp(2 * after) >= wanted

    if enough(information):
        return information
    low, high = _LEAST_EXPONENT * information, information
    for _ in range(_HALVINGS):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if enough(middle) else (low, middle)
    return low
