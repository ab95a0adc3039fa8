"""Recovery: notice that the vehicle may be elsewhere, and draw particles there.

A filter whose particles are all in wrong places has no way back of its own. Augmented Monte Carlo localization watches
for likelihoods that drop below what they used to be (Probabilistic Robotics, table 8.3), which finds a filter that gets
lost, but none that never was right, and takes a new view for a loss. Here the question is put as Bayes would: between
any two scans the vehicle may, with a small probability, have been carried anywhere. What is believed before a scan z is

    (1 - p) * belief + p * uniform,

and the scan weighs both parts by their evidence: the share of the uniform one becomes

    s = p * E_anywhere / (p * E_anywhere + (1 - p) * E_belief),    E = mean likelihood of z,

and its particles are drawn from the uniform distribution by their likelihoods (sampling, importance resampling; the
sensor resetting of Lenser and Veloso 2000 with a share that follows from the evidence). No level of the likelihood has
to be known: a belief is as good as it explains scans better than strangers do. A few strangers are asked at every scan.
Only when they would be given a particle are many drawn, so that some are near the truth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from factorloc.config import Block
from factorloc.localization.initialization import Initialization
from factorloc.localization.particles import Particles, log_sum_exp
from factorloc.localization.resampling import systematic
from factorloc.localization.reweighting import tempered_exponent

__all__ = ["Elsewhere", "RecoverySettings", "look_elsewhere"]

Array = npt.NDArray[np.float64]


class RecoverySettings(Block):
    """When and how widely a filter looks elsewhere.

    Parameters
    ----------
    probability : float
        That the vehicle has been carried anywhere since the last scan.
    probes : int
        Poses that are asked at every scan.
    candidates : int
        Poses that are asked where those explain the scan too well, at least ``probes``.
    most : float
        Largest share of particles drawn elsewhere at a time.

    Raises
    ------
    ConfigError
        If there are fewer candidates than probes.
    """

    probability: float = Field(0.001, gt=0, lt=1)
    probes: int = Field(200, gt=0)
    candidates: int = Field(20_000, gt=0)
    most: float = Field(0.9, gt=0, le=1)

    @model_validator(mode="after")
    def _candidates_are_more(self) -> RecoverySettings:
        if self.candidates < self.probes:
            raise ValueError(f"candidates {self.candidates} are fewer than probes {self.probes}")
        return self


@dataclass(frozen=True)
class Elsewhere:
    """Poses that explain a scan, among those that were asked.

    Parameters
    ----------
    share : float
        Probability that the vehicle is at one of them and not where it is believed to be.
    poses : ndarray, shape (C, 3) or (C, 4, 4)
        What was asked.
    weights : ndarray, shape (C,)
        Their likelihoods, tempered, adding up to one.
    """

    share: float
    poses: Array
    weights: Array

    def sample(self, count: int, rng: np.random.Generator) -> Array:
        """Draw poses by their weights."""
        return np.asarray(self.poses[systematic(self.weights, count, rng)])


def look_elsewhere(
    log_evidence: float,
    log_likelihoods: Callable[[Array], Array],
    free_space: Initialization,
    settings: RecoverySettings,
    particles: int,
    rng: np.random.Generator,
    tempering: float | None = None,
) -> Elsewhere | None:
    """Ask poses drawn anywhere how well they explain a scan.

    Parameters
    ----------
    log_evidence : float
        Of the belief: logarithm of the mean likelihood of the scan over the particles; -inf if none explains it.
    log_likelihoods : callable
        Of the scan at poses, shape (P,).
    free_space : Initialization
        Anywhere.
    settings : RecoverySettings
        How many.
    particles : int
        Number of particles: a share that is not worth one of them is none.
    rng : numpy.random.Generator
        Source of the poses.
    tempering : float, optional
        Least share of the poses that may be effective, as of particles; the share of :class:`Elsewhere` is that of the
        likelihood as it is.

    Returns
    -------
    Elsewhere or None
        None if nobody explains the scan well enough.
    """
    for count in (settings.probes, settings.candidates):
        poses = free_space.sample(count, rng)
        logs = log_likelihoods(poses)
        total = log_sum_exp(logs)
        share = _share(total - np.log(count), log_evidence, settings.probability)
        if share * particles < 1:
            return None
    strangers = Particles.uniform(poses)
    weights = strangers.reweighted(tempered_exponent(strangers, logs, 1.0, tempering) * logs).weights
    return Elsewhere(min(share, settings.most), poses, weights)


def _share(anywhere: float, belief: float, probability: float) -> float:
    """Posterior probability of being anywhere, of logarithms of evidences."""
    if anywhere == -np.inf:
        return 0.0
    odds = np.log(probability) - np.log1p(-probability) + anywhere - belief
    return float(1 / (1 + np.exp(-np.clip(odds, -700, 700))))
