"""FacadeBounds: where the ends and the line of each facade can be, given the errors its map is declared to have."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.errors import MapError
from factorloc.intervals import Box, Interval, atan2, cos, cos_sin, pi
from factorloc.mapping.facades import Facades

__all__ = ["FacadeBounds"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class FacadeBounds:
    """Sound bounds of F facades: whatever errors within the declared ones the map has, the truth is inside.

    Parameters
    ----------
    first, second : Box, sides (x, y), batch (F,)
        Ends ``[a1]`` and ``[a2]``, m, from the origin asked for; the building is on the left of the way from the first
        to the second.
    alpha : Interval, shape (F,)
        Direction of the normal that points out of the building, rad. Not wrapped: its middle is in about (-pi, pi], a
        bound may lie beyond. Where the errors could turn the wall round, it is a whole turn.
    d : Interval, shape (F,)
        Distance of the line from the origin along that normal, m: ``x cos alpha + y sin alpha = d``. Seen from its
        outside, it is negative.
    """

    first: Box
    second: Box
    alpha: Interval
    d: Interval

    @classmethod
    def of(cls, facades: Facades, origin: npt.ArrayLike = (0.0, 0.0)) -> FacadeBounds:
        """Bound facades about an origin; the nearer it is, the tighter the distances.

        The building is contracted as if it had not been shifted, and its shift is added last (a Minkowski sum), because
        a shift turns no wall. With the vertex error V of either end along each axis:

        - ``[alpha]`` is the exact range of directions between the two boxes, found in the quarter turn in which the
          wall runs along x. To either side of the mapped direction it reaches no further than
          ``atan(2 sqrt(2) V / (L - 2 V))`` if the wall is at least 3 V long. For the difference of the ends errs by up
          to 2 V along each axis: by corners that lie ``2 sqrt(2) V sin psi`` across the wall and
          ``2 sqrt(2) V cos psi`` along it, psi a quarter turn apart. One with psi from 45 to 135 degrees comes at most
          2 V nearer, and so keeps to the formula; one at ``90 degrees + q``, q > 45 degrees, does where
          ``L >= 2 V (sqrt(2) sin q - cos q) / (1 - cos q)``, which is greatest at cos q = 1/3, and 3 V there.
        - ``[d]`` is that of one point that surely is on the line: ``(1 - t) a1 + t a2``, with t the foot of the
          origin on the mapped wall. Its own error is at most ``(|1 - t| + |t|) V`` along each axis, that is V between
          the ends, and grows with the lever beyond them; the direction only enters by ``d0 (1 - cos)``.

        Parameters
        ----------
        facades : Facades
            Walls and their declared errors.
        origin : (2,) array_like
            Origin of the bounds in the frame of the facades, m; the pose to start from is a good one.

        Raises
        ------
        MapError
            If the origin is no point.
        """
        start = np.asarray(origin, np.float64)
        if start.shape != (2,) or not np.isfinite(start).all():
            raise MapError(f"facade bounds: origin {start.tolist()}; give a point (x, y), m")
        ends = Interval(np.moveaxis(facades.segments, 0, -1)) - Interval(start[:, None])  # (end, axis, facade)
        vertex, shift = (_around_zero(errors) for errors in (facades.vertex_errors, facades.shifts))
        first, second = ends[0] + vertex, ends[1] + vertex
        alpha = _normal_direction(second - first)
        c, s = cos_sin(alpha)
        swing = abs(c) + abs(s)
        d = _distance(ends, alpha, vertex * swing) + shift * swing
        return cls(Box(first + shift), Box(second + shift), alpha, d)

    def __len__(self) -> int:
        return self.alpha.size

    @property
    def hull(self) -> Box:
        """Hulls of both ends, sides (x, y), batch (F,): every point of the wall is inside."""
        return Box(self.first.bounds | self.second.bounds)

    def select(self, which: npt.ArrayLike) -> FacadeBounds:
        """Bounds of the facades named by a mask or indices."""
        rows = np.asarray(which) if np.size(which) else np.empty(0, np.int64)
        return FacadeBounds(self.first.select(rows), self.second.select(rows), self.alpha[rows], self.d[rows])


def _around_zero(errors: Array) -> Interval:
    return Interval(-errors, errors)


def _normal_direction(along: Interval) -> Interval:
    """Normals, to the right of vectors in boxes (2, F): a quarter turn below the hull of their directions."""
    dx, dy = along[0], along[1]
    x, y = dx.mid, dy.mid
    # Quarter turns that bring the wall next to the x axis are exact; there the hull of directions has no seam.
    quarter = np.where(np.abs(x) >= np.abs(y), np.where(x >= 0, 0, 2), np.where(y > 0, 1, 3))
    candidates = [(dx, dy), (dy, -dx), (-dx, -dy), (-dy, dx)]
    picked = [
        Interval.from_bounds(
            np.choose(quarter, [pair[axis].lo for pair in candidates]),
            np.choose(quarter, [pair[axis].hi for pair in candidates]),
        )
        for axis in (0, 1)
    ]
    turned = atan2(picked[1], picked[0])
    wrapped = np.where(quarter == 0, -1, quarter - 1)  # in quarters: -1, 0, 1, 2
    direction = turned + pi() * Interval(0.5 * wrapped)
    free = picked[0].lo <= 0.0  # the ends might change places
    whole = pi().hi
    return Interval.from_bounds(np.where(free, -whole, direction.lo), np.where(free, whole, direction.hi))


def _distance(ends: Interval, alpha: Interval, reach: Interval) -> Interval:
    """Distances of lines whose ends (end, axis, facade) are off by a vertex error each, which reaches that far."""
    a = ends.mid
    along = a[1] - a[0]
    length2 = (along**2).sum(0)
    # Any t will do: it is a number, and its rounding only moves the point along the wall.
    t = -(a[0] * along).sum(0) / length2
    x, y = (ends[0, axis] * (1.0 - Interval(t)) + ends[1, axis] * Interval(t) for axis in (0, 1))
    levers = abs(1.0 - Interval(t)) + abs(Interval(t))
    c, s = cos_sin(alpha)
    plain = x * c + y * s + reach * levers
    # The foot lies along the normal of the mapped wall, up to rounding: n(alpha) . foot = d0 cos(alpha - alpha0).
    normal = np.arctan2(-along[0], along[1])
    c0, s0 = cos_sin(Interval(normal))
    across, aside = x * c0 + y * s0, y * c0 - x * s0
    turn = alpha - normal
    by_turn = across * cos(turn) + aside * Interval(-1.0, 1.0) + reach * levers
    return plain & by_turn
