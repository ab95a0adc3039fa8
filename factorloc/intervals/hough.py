"""Interval Hough transform: which lines meet most of some boxes.

A line is ``x cos alpha + y sin alpha = d``. The accumulator has cells of directions and distances; a box votes for
every cell that holds a line through one of its points, and for none that surely does not. So the cell of a line that
passes through n of the boxes has at least n votes: that is guaranteed. That the line in question is in the cluster of
the highest cell is not; it is what the transform hopes for (Ehambram, Jaulin, Wagner: Hybrid Interval-Probabilistic
Localization in Building Maps).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.errors import GeometryError
from factorloc.intervals._hough_kernels import find_peak, vote
from factorloc.intervals.box import Box
from factorloc.intervals.elementary import cos_sin
from factorloc.intervals.interval import Interval

__all__ = ["HoughAccumulator", "HoughPeak"]

Array = npt.NDArray[np.float64]

_MOST_CELLS = 2.0**28  # beyond, a distance is not told from its neighbours


@dataclass(frozen=True)
class HoughPeak:
    """The cluster of the highest cell of an accumulator.

    Parameters
    ----------
    alpha : Interval
        Hull of its directions, rad.
    d : Interval
        Hull of its distances, m.
    votes : int
        Of the highest cell.
    second : int
        Most votes of a cell apart from the cluster.
    """

    alpha: Interval
    d: Interval
    votes: int
    second: int

    @property
    def rivalry(self) -> float:
        """Second peak relative to the first; 1 without a vote."""
        return self.second / self.votes if self.votes else 1.0


@dataclass(frozen=True, eq=False)
class HoughAccumulator:
    """Votes for lines.

    Parameters
    ----------
    counts : ndarray of int, shape (A, D)
        Boxes that a line of each cell may meet.
    alpha_first, alpha_step : float
        Lowest direction and width of a bin, rad.
    d_first, d_step : float
        Lowest distance and width of a bin, m.
    """

    counts: npt.NDArray[np.int32]
    alpha_first: float
    alpha_step: float
    d_first: float
    d_step: float

    @classmethod
    def from_boxes(
        cls, points: Box, alpha: Interval, d: Interval, *, alpha_step: float = math.radians(0.25), d_step: float = 0.1
    ) -> HoughAccumulator:
        """Let boxes vote for all lines of an interval of directions and one of distances.

        Parameters
        ----------
        points : Box, sides (x, y), batch (N,)
            m; bounded.
        alpha, d : Interval
            Single and bounded, rad and m. Cells cover them; the last ones may reach beyond.
        alpha_step, d_step : float
            Size of a cell, rad and m.

        Raises
        ------
        GeometryError
            If an interval is empty or unbounded, a step is not positive or far too small, or points are not bounded.
        """
        if not (alpha.is_bounded.all() and d.is_bounded.all() and alpha.size == d.size == 1):
            raise GeometryError("hough: alpha and d must be single bounded intervals")
        if points.axes != 2 or len(points.batch) != 1 or not points.bounds.is_bounded.all():
            raise GeometryError(f"hough: points of shape {points.bounds.shape}; give bounded boxes (x, y) of a batch")
        if not (alpha_step > 0 and d_step > 0):
            raise GeometryError(f"hough: steps {alpha_step} rad, {d_step} m; both must be positive")
        reach = max(float(points.bounds.magnitude.max(initial=0.0)) * 2.0, float(d.magnitude.max()))
        if reach > _MOST_CELLS * d_step:
            raise GeometryError(f"hough: points {reach:g} m away in cells of {d_step:g} m; move the origin near them")
        first, d_first = float(alpha.lo.min()), float(d.lo.min())
        rows = max(math.ceil((float(alpha.hi.max()) - first) / alpha_step), 1)
        columns = max(math.ceil((float(d.hi.max()) - d_first) / d_step), 1)
        edges = first + alpha_step * np.arange(rows + 1)
        # An edge is rounded by a few units of its last place; bins overlap by far more.
        slack = 1e-12 * (1.0 + np.abs(edges).max())
        c, s = cos_sin(Interval(edges[:-1] - slack, edges[1:] + slack))
        n = points.batch[0]
        counts = np.empty((rows, columns + 1), np.int32)
        room = np.empty(n, np.int32), np.empty(n, np.int32)
        lo, hi = points.lo, points.hi
        vote(lo[0], hi[0], lo[1], hi[1], c.lo, c.hi, s.lo, s.hi, d_first, d_step, *room, counts)
        return cls(counts[:, :-1], first, alpha_step, d_first, d_step)

    def cell(self, alpha: npt.ArrayLike, d: npt.ArrayLike) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Row and column of lines; outside of the accumulator if they are."""
        row = np.floor((np.asarray(alpha, np.float64) - self.alpha_first) / self.alpha_step)
        column = np.floor((np.asarray(d, np.float64) - self.d_first) / self.d_step)
        return row.astype(np.int64), column.astype(np.int64)

    def peak(self, threshold: float = 0.85, apart: float = 0.8) -> HoughPeak:
        """Find the cluster of the highest cell.

        Parameters
        ----------
        threshold : float
            Cells with more votes than this part of the highest cell's belong to clusters.
        apart : float
            What is more than this apart from the cluster in distance, m, is another line; what is nearer and above the
            threshold widens the hull.

        Raises
        ------
        GeometryError
            If the threshold is not in (0, 1) or ``apart`` is negative.
        """
        if not (0 < threshold < 1 and apart >= 0):
            raise GeometryError(f"hough: threshold {threshold}, apart {apart} m; 0 < threshold < 1, apart >= 0")
        rows, columns = self.counts.shape
        hull = np.empty(4, np.int64)
        whole = self.counts.base if self.counts.base is not None else np.pad(self.counts, ((0, 0), (0, 1)))
        room = np.empty(rows * columns, np.int64), np.empty((rows, columns), np.bool_)
        votes, second = find_peak(whole, threshold, math.ceil(apart / self.d_step), *room, hull)
        return HoughPeak(
            self._bins(self.alpha_first, self.alpha_step, hull[0], hull[1]),
            self._bins(self.d_first, self.d_step, hull[2], hull[3]),
            int(votes),
            int(second),
        )

    @staticmethod
    def _bins(first: float, step: float, low: int, high: int) -> Interval:
        lo, hi = first + step * low, first + step * high
        slack = 1e-12 * (1.0 + max(abs(lo), abs(hi)))
        return Interval(lo - slack, hi + slack)
