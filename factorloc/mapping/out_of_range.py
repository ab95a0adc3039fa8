"""Priors of rays out of range: how often a ray ends below the minimum range, or nowhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from factorloc.errors import MapError
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.ray_statistics import RayStatistics
from factorloc.scan import RayStatus, Scan

__all__ = ["OutOfRangePrior"]


@dataclass(frozen=True)
class OutOfRangePrior:
    """Probabilities of the two outcomes that an end-point model knows nothing about (P of thesis, section 7.6.2).

    Parameters
    ----------
    below : float
        Of a ray below the minimum range.
    none : float
        Of a ray without return.
    """

    below: float = 0.01
    none: float = 0.1

    def __post_init__(self) -> None:
        if not (min(self.below, self.none) > 0 and self.below + self.none < 1):
            raise MapError(f"out of range: P {self.below} and {self.none}; expected positive numbers of a sum below 1")

    @property
    def within(self) -> float:
        """Probability of a return."""
        return 1.0 - self.below - self.none

    @classmethod
    def from_scans(cls, scans: Sequence[Scan]) -> OutOfRangePrior:
        """Learn both from their shares in scans, by Jeffreys' rule: half a ray is added to each outcome."""
        counts = np.sum([np.bincount(scan.status, minlength=3) for scan in scans], axis=0) + 0.5
        return cls(
            float(counts[RayStatus.BELOW_MINIMUM] / counts.sum()), float(counts[RayStatus.NO_RETURN] / counts.sum())
        )

    @classmethod
    def from_statistics(cls, statistics: RayStatistics | BrickStatistics, none: float = 0.1) -> OutOfRangePrior:
        """Learn the share of rays below the minimum from what a map left out; it does not count rays without return.

        Parameters
        ----------
        statistics : RayStatistics or BrickStatistics
            The map.
        none : float
            Probability of a ray without return; :meth:`from_scans` learns it too.
        """
        below = statistics.left_out.get("below minimum range", 0) + 0.5
        returns = int(statistics.hits.sum(dtype=np.int64)) + statistics.left_out.get("ended outside the grid", 0) + 0.5
        return cls(float((1.0 - none) * below / (below + returns)), none)
