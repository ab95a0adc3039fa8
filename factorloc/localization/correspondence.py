"""Correspondence: a line of a scan that stands for a facade of the map, and how doubtful that is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.intervals import Interval

__all__ = ["Correspondence", "Correspondences"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Correspondence:
    """A line of the scan that stands for a facade.

    In the frame of the body, ``n(alpha) . (p - anchor) = d`` for the points p of the line.

    Parameters
    ----------
    facade : int
        Row of the facade.
    anchor : ndarray, shape (2,)
        About where its middle is, m.
    alpha, d : Interval
        Hull of the peak, rad and m.
    votes : int
        Of the peak.
    rivalry, coverage : float
        Second peak relative to it; covered part of the facade.
    middle : (float, float)
        Where the middle half of the supporters begins and ends, from the anchor along the wall, to the left of its
        normal, m.
    extent : (float, float)
        Where most of them (90 %) begin and end, likewise, m.
    doubt : float
        Probability that it is false: that the line of the facade is not in the hull, or is that of another wall.
    core : (Interval, Interval) or None
        Alpha and d of the core of the hull, where the line more often is; None if none is known.
    core_doubt : float
        Probability that the line is in the hull but not in its core.
    """

    facade: int
    anchor: Array
    alpha: Interval
    d: Interval
    votes: int
    rivalry: float
    coverage: float
    middle: tuple[float, float]
    extent: tuple[float, float]
    doubt: float
    core: tuple[Interval, Interval] | None = None
    core_doubt: float = 0.0


@dataclass(frozen=True, eq=False)
class Correspondences:
    """What a scan tells about facades.

    Parameters
    ----------
    found : tuple of Correspondence
        Those that are believed, each with its doubt.
    asked : ndarray of int, shape (A,)
        Facades in reach and in sight.
    associated : ndarray of bool, shape (A, N)
        Points that may be of each of them.
    rejected : dict of str to int
        Facades asked for without a correspondence, by reason.
    """

    found: tuple[Correspondence, ...]
    asked: npt.NDArray[np.int64]
    associated: npt.NDArray[np.bool_]
    rejected: dict[str, int]

    @classmethod
    def none(cls, points: int) -> Correspondences:
        """Of a scan of so many points for which no facade was asked."""
        return cls((), np.empty(0, np.int64), np.empty((0, points), np.bool_), {})
