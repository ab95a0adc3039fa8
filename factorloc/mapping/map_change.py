"""Map change: what became of each cell between two sessions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import expit, logit

from factorloc.errors import MapError
from factorloc.mapping.evidence import Evidence
from factorloc.mapping.fading_counts import Counts, FadingCounts
from factorloc.mapping.grid import Grid

__all__ = ["MapChange"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class MapChange:
    """Bayes factor of each cell for two rates, one a session, against one rate that explains both.

    Where only one session has been nothing is known: the factor is 1.

    Parameters
    ----------
    grid : Grid
        The union of both maps.
    log_bayes_factors : ndarray, shape ``grid.shape``, or (V,)
        Positive where the cell has changed; of sparse maps those of the cells with keys.
    keys : ndarray of int64, shape (V,), optional
        Keys of the cells of sparse maps, increasing.
    """

    grid: Grid
    log_bayes_factors: Array
    keys: npt.NDArray[np.int64] | None = None

    @classmethod
    def between(cls, first: Counts, second: Counts, evidence: Evidence) -> MapChange:
        """Compare two sessions.

        Parameters
        ----------
        first, second : RayStatistics, BrickStatistics or FadingCounts
            Counts of different rays, on one raster; both sparse or both dense.
        evidence : RateEvidence or ReflectionEvidence
            The model, with its prior.

        Raises
        ------
        MapError
            If the rasters differ, or only one of the maps is sparse.
        """
        one, two = FadingCounts.of(first).aligned(second)
        seen = one.visited & two.visited
        pair = [tuple(values[seen] for values in evidence.trials(counts)) for counts in (one, two)]
        factors = np.zeros(seen.shape)
        factors[seen] = evidence.log_bayes_factor((pair[0][0], pair[0][1]), (pair[1][0], pair[1][1]))
        return cls(one.grid, factors, one.keys)

    def probability(self, prior: float = 0.01) -> Array:
        """Probability that each cell has changed.

        Parameters
        ----------
        prior : float
            The same before either session, in (0, 1).

        Raises
        ------
        MapError
            If it is out of bounds.
        """
        if not 0 < prior < 1:
            raise MapError(f"prior: {prior}; expected a probability of change in (0, 1)")
        return np.asarray(expit(self.log_bayes_factors + logit(prior)))

    @property
    def log_match(self) -> float:
        """Log evidence that both maps show the same world: minus the sum of all factors."""
        return -float(self.log_bayes_factors.sum())
