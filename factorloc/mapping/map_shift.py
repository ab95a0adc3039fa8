"""Map shift: correlation of two maps by the evidence that they show the same world (thesis, section 2.3)."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc import _jit
from factorloc.errors import MapError
from factorloc.mapping.evidence import Evidence
from factorloc.mapping.fading_counts import Counts, FadingCounts

__all__ = ["MapShift", "log_match"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class MapShift:
    """Evidence for each shift of a second map against a first one.

    Parameters
    ----------
    first_shift : tuple of int
        Shift of the first entry of ``log_matches``, cells.
    resolution : float
        Edge of a cell, m.
    log_matches : ndarray, shape (shifts along each axis)
        :func:`log_match` of each shift.
    """

    first_shift: tuple[int, ...]
    resolution: float
    log_matches: Array

    @classmethod
    def search(cls, first: Counts, second: Counts, evidence: Evidence, most: int | tuple[int, ...] = 10) -> MapShift:
        """Compute the evidence of all shifts in a window, one by one; in threads.

        Parameters
        ----------
        first, second : RayStatistics or dense FadingCounts
            Counts of different rays, on one raster.
        evidence : RateEvidence or ReflectionEvidence
            The model, with its prior.
        most : int or tuple of int
            Largest shift along each axis to either side, cells.

        Raises
        ------
        MapError
            If the rasters differ, or a map is sparse.
        """
        one, two, offset = _pair(first, second)
        reach = (most,) * one.grid.dimension if isinstance(most, int) else most
        if len(reach) != one.grid.dimension or min(reach) < 0:
            raise MapError(f"most: {most}; expected the cells of the largest shift along each axis")
        marginals = [_marginals(counts, evidence) for counts in (one, two)]
        shifts = np.array(list(itertools.product(*(range(-n, n + 1) for n in reach))))
        out = np.empty(len(shifts))

        def correlate(begin: int, end: int) -> None:
            for k in range(begin, end):
                out[k] = _log_match(one, two, marginals, offset + shifts[k], evidence)

        _jit.in_threads(correlate, len(shifts))
        return cls(tuple(-n for n in reach), one.grid.resolution, out.reshape([2 * n + 1 for n in reach]))

    @property
    def cells(self) -> tuple[int, ...]:
        """The best shift, cells: by so much the second map is to be moved."""
        best = np.unravel_index(int(self.log_matches.argmax()), self.log_matches.shape)
        return tuple(int(a) + b for a, b in zip(best, self.first_shift, strict=True))

    @property
    def metres(self) -> tuple[float, ...]:
        """The best shift, m."""
        return tuple(n * self.resolution for n in self.cells)

    @property
    def probabilities(self) -> Array:
        """Probability of each shift, if all were equally probable before, and cells are as independent as assumed."""
        weights = np.exp(self.log_matches - self.log_matches.max())
        return np.asarray(weights / weights.sum())


def log_match(first: Counts, second: Counts, evidence: Evidence, shift: tuple[int, ...]) -> float:
    """Log evidence that two maps show the same world, the second moved by whole cells.

    The sum over all cells of ``log p(both | one rate) - log p(first) - log p(second)``; cells that only one of the maps
    has seen add nothing. Positive: rather the same world than two.

    Parameters
    ----------
    first, second : RayStatistics or dense FadingCounts
        Counts of different rays, on one raster.
    evidence : RateEvidence or ReflectionEvidence
        The model, with its prior.
    shift : tuple of int
        Cells along each axis.

    Raises
    ------
    MapError
        If the rasters differ, or a map is sparse.
    """
    one, two, offset = _pair(first, second)
    marginals = [_marginals(counts, evidence) for counts in (one, two)]
    return _log_match(one, two, marginals, offset + np.array(shift), evidence)


def _pair(first: Counts, second: Counts) -> tuple[FadingCounts, FadingCounts, npt.NDArray[np.int64]]:
    one, two = FadingCounts.of(first), FadingCounts.of(second)
    if one.keys is not None or two.keys is not None:
        raise MapError("maps: sparse; lay out a part of both with BrickStatistics.window to correlate them")
    if not one.grid.shares_raster(two.grid):
        raise MapError(f"maps: {one.grid} and {two.grid} do not share a raster; build both at one resolution")
    offset = np.round((np.array(two.grid.origin) - one.grid.origin) / one.grid.resolution).astype(np.int64)
    return one, two, offset


def _marginals(counts: FadingCounts, evidence: Evidence) -> Array:
    out = np.zeros(counts.grid.shape)
    hits, trials = evidence.trials(counts)
    out[counts.visited] = evidence.log_marginal(hits[counts.visited], trials[counts.visited])
    return out


def _log_match(
    one: FadingCounts, two: FadingCounts, marginals: list[Array], offset: npt.NDArray[np.int64], evidence: Evidence
) -> float:
    low = np.maximum(offset, 0)
    high = np.minimum(offset + two.grid.shape, one.grid.shape)
    if not (low < high).all():
        return 0.0
    at_one = tuple(slice(int(a), int(b)) for a, b in zip(low, high, strict=True))
    at_two = tuple(slice(int(a), int(b)) for a, b in zip(low - offset, high - offset, strict=True))
    seen = one.visited[at_one] & two.visited[at_two]
    (hits_1, trials_1), (hits_2, trials_2) = evidence.trials(one), evidence.trials(two)
    hits = hits_1[at_one][seen] + hits_2[at_two][seen]
    both = evidence.log_marginal(hits, trials_1[at_one][seen] + trials_2[at_two][seen])
    return float((both - marginals[0][at_one][seen] - marginals[1][at_two][seen]).sum())
