"""KLD sampling: as many particles as the spread of the belief needs (Fox, IJRR 2003)."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from factorloc.config import Block
from factorloc.geometry import se3

__all__ = ["KldSettings", "PoseBins", "enough_particles", "kld_bound"]

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]

_MOST_BINS = 2.0**62


class KldSettings(Block):
    """How many particles.

    Parameters
    ----------
    least, most : int
        Bounds of the number; equal ones fix it.
    epsilon : float
        Kullback-Leibler divergence that the sample may have from the belief, both taken by bins.
    confidence : float
        Probability with which it has no more.
    position_bin, heading_bin : float
        Edges of a bin, m and rad.

    Raises
    ------
    ConfigError
        If the least number is above the most.
    """

    least: int = Field(500, gt=0)
    most: int = Field(20_000, gt=0)
    epsilon: float = Field(0.05, gt=0)
    confidence: float = Field(0.99, gt=0.5, lt=1)
    position_bin: float = Field(0.5, gt=0)
    heading_bin: float = Field(float(np.radians(10.0)), gt=0, le=np.pi)

    @model_validator(mode="after")
    def _least_is_least(self) -> KldSettings:
        if self.least > self.most:
            raise ValueError(f"least {self.least} is above most {self.most}")
        return self

    @property
    def bins(self) -> PoseBins:
        """The bins."""
        return PoseBins(self.position_bin, self.heading_bin)


@dataclass(frozen=True)
class PoseBins:
    """Bins of position and heading; roll and pitch are not told apart.

    Parameters
    ----------
    position, heading : float
        Edges, m and rad; a turn has a whole number of bins, about as wide as asked.
    """

    position: float
    heading: float

    @property
    def headings(self) -> int:
        """Bins of a whole turn."""
        return max(round(2 * np.pi / self.heading), 1)

    def index(self, poses: npt.ArrayLike) -> Index:
        """Bins of poses (P, 3) or (P, 4, 4): whole numbers of x, y, (z,) heading; shape (P, D + 1)."""
        array = np.asarray(poses, np.float64)
        planar = array.ndim == 2
        position = array[:, :2] if planar else array[:, :3, 3]
        yaw = array[:, 2] if planar else se3.to_se2(array)[:, 2]
        turn = np.floor((yaw / (2 * np.pi) + 0.5) * self.headings)
        return np.column_stack([np.floor(position / self.position), turn % self.headings]).astype(np.int64)

    def number(self, poses: npt.ArrayLike) -> Index:
        """Number of each pose's bin, shape (P,): equal for the same bin, different for others."""
        index = self.index(poses)
        index -= index.min(0)
        if np.prod(index.max(0) + 1.0) > _MOST_BINS:  # scattered too far to be numbered through: ranks instead
            index = np.stack([np.unique(column, return_inverse=True)[1] for column in index.T], -1)
        return np.asarray(np.ravel_multi_index(tuple(index.T), tuple(index.max(0) + 1)))


def kld_bound(bins: npt.ArrayLike, epsilon: float, confidence: float) -> Array:
    """Particles for which the divergence stays below epsilon, with a confidence (eq. 7 of the paper).

    The chi-square quantile of ``k - 1`` degrees of freedom, over ``2 epsilon``, by Wilson and Hilferty:

        n = (k - 1) / (2 epsilon) * (1 - 2 / (9 (k - 1)) + sqrt(2 / (9 (k - 1))) z)^3.

    Parameters
    ----------
    bins : array_like
        Numbers k of bins with particles; one bin needs one particle.
    epsilon : float
        Bound of the divergence.
    confidence : float
        Probability of staying below; z is its quantile of the normal distribution.

    Returns
    -------
    ndarray
        Least numbers of particles (not rounded), shape as ``bins``.
    """
    freedom = np.asarray(bins, np.float64) - 1
    safe = 2 / (9 * np.maximum(freedom, 1))
    z = NormalDist().inv_cdf(confidence)
    return np.where(freedom < 1, 1.0, freedom / (2 * epsilon) * (1 - safe + np.sqrt(safe) * z) ** 3)


def enough_particles(bins: npt.ArrayLike, settings: KldSettings) -> int:
    """How many of a sequence of independent draws are enough.

    Draws are counted in as they come until there are as many as the bins they have met ask for.

    Parameters
    ----------
    bins : array_like of int, shape (M,)
        Number of the bin of each of independent draws from the belief, in no order (:meth:`PoseBins.number`).
    settings : KldSettings
        Bounds.

    Returns
    -------
    int
        From ``least`` to ``most``; ``most`` if the draws do not suffice.
    """
    numbers = np.asarray(bins, np.int64)
    _, first = np.unique(numbers, return_index=True)
    met = np.zeros(len(numbers), np.int64)
    met[first] = 1
    wanted = np.maximum(kld_bound(np.cumsum(met), settings.epsilon, settings.confidence), settings.least)
    done = np.flatnonzero(np.arange(1, len(numbers) + 1) >= wanted)
    return min(int(done[0]) + 1, settings.most) if len(done) else settings.most
