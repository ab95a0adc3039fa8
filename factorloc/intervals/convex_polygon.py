"""Position polygons: the convex polygon that strips and half-planes leave of a box, with nothing lost to rounding."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from factorloc.errors import GeometryError
from factorloc.intervals._polygon_kernels import clip_half_planes, meets_lines
from factorloc.intervals.box import Box
from factorloc.intervals.elementary import cos_sin, hypot
from factorloc.intervals.interval import Interval

__all__ = ["ConvexPolygon", "Strips", "lines_met", "union"]

Array = npt.NDArray[np.float64]

MARGIN = 1e-12
"""Outward shift of every half-plane, as a part of the largest coordinate or distance."""

CLIP_ERROR = 2.0**-48
"""What one clip may move a corner to the wrong side of a line, as a part of the same."""


@dataclass(frozen=True)
class Strips:
    """Strips of the plane: ``a x + b y`` in an interval each.

    Parameters
    ----------
    a, b : ndarray, shape (K,)
        Normals, of about unit length.
    offset : Interval, shape (K,)
        Of ``a x + b y``, m; an infinite bound makes a half-plane.
    """

    a: Array
    b: Array
    offset: Interval

    @classmethod
    def from_lines(cls, alpha: Interval, d: Interval, within: Box) -> Strips:
        """Enclose uncertain strips ``x cos alpha + y sin alpha`` in ``d`` by ones of a certain direction, in a box.

        Around the middle ``p0`` of the box, ``n(alpha) . p = n(alpha) . p0 + n(alpha) . (p - p0)``, and the normal of
        the middle direction differs from ``n(alpha)`` by at most the radius of alpha, so that the last term changes by
        no more than that times the radius of the box. No direction in alpha is passed over.

        Parameters
        ----------
        alpha : Interval, shape (K,)
            Directions of the normals, rad.
        d : Interval, shape (K,)
            Distances of the lines, m.
        within : Box
            A bounded box (x, y) that holds the positions asked for, m.

        Raises
        ------
        GeometryError
            If the box is empty or not bounded.
        """
        if within.bounds.shape != (2,) or not within.bounds.is_bounded.all():
            raise GeometryError("strips: within is no single bounded box (x, y); give one around the position")
        x_0, y_0 = within.mid
        away = (within.bounds - within.mid).magnitude
        radius = Interval(0.0, hypot(away[0], away[1]).hi)
        a, b = np.cos(alpha.mid), np.sin(alpha.mid)
        c, s = cos_sin(alpha)
        # Rounded sine and cosine of the middle differ from it by less than 2^-50, and so does the middle by rounding.
        turn = 0.5 * alpha.width + 2.0**-50 * (1.0 + alpha.magnitude)
        swing = Interval.around(np.zeros(alpha.shape), turn) * radius
        offset = d - (c * x_0 + s * y_0) + (Interval(a) * x_0 + Interval(b) * y_0) + swing
        return cls(a, b, offset)

    def __len__(self) -> int:
        return len(self.a)


@dataclass(frozen=True)
class ConvexPolygon:
    """A convex polygon, or the empty set.

    Clipping is rounded, so every half-plane is shifted outwards, and every edge too: by :data:`MARGIN` (1e-12) times
    the largest coordinate M, and by :data:`CLIP_ERROR` (32u) M for every half-plane of the call. Why this is enough:
    the evaluation of ``a x + b y - c`` errs by less than ``13u M``, and a new corner, a rounded point between two
    others, lies within ``8u M`` of their edge, inward at worst, and within ``30u M`` of the shifted line. Each
    half-plane replaces either end of an edge at most once, and what lies between two points moves no further than they
    do; after K half-planes an edge is off its own line by less than ``32u K M``, less than the shift. So no edge
    reaches the true set, which was inside at first.

    Parameters
    ----------
    corners : ndarray, shape (V, 2)
        m, counter-clockwise; (0, 2) for the empty set.
    """

    corners: Array

    @classmethod
    def from_box(cls, box: Box) -> ConvexPolygon:
        """The polygon of a single bounded box (x, y), m.

        Raises
        ------
        GeometryError
            If the box is not bounded or no rectangle.
        """
        if box.bounds.shape != (2,):
            raise GeometryError(f"polygon: bounds of shape {box.bounds.shape}; give a single box (x, y)")
        if box.is_empty:
            return cls(np.empty((0, 2)))
        if not box.bounds.is_bounded.all():
            raise GeometryError("polygon: a side is unbounded; give a bounded box")
        (x_0, y_0), (x_1, y_1) = box.lo, box.hi
        return cls(np.array([[x_0, y_0], [x_1, y_0], [x_1, y_1], [x_0, y_1]]))

    @classmethod
    def from_shapely(cls, region: Any) -> ConvexPolygon:
        """The convex hull of a shapely geometry with an area."""
        import shapely

        hull = shapely.orient_polygons(region.convex_hull) if not region.is_empty else None
        if hull is None or hull.geom_type != "Polygon":
            return cls(np.empty((0, 2)))
        return cls(shapely.get_coordinates(hull.exterior)[:-1].copy())

    def to_shapely(self) -> Any:
        """As a shapely polygon."""
        import shapely

        return shapely.Polygon(self.corners)

    @property
    def is_empty(self) -> bool:
        """Whether no point is left."""
        return not len(self.corners)

    @property
    def area(self) -> float:
        """Area, m^2; rounded as usual."""
        x, y = (self.corners - self.corners[:1]).T if len(self.corners) else np.zeros((2, 1))
        return float(0.5 * abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))))

    @property
    def box(self) -> Box:
        """Smallest box around the corners."""
        return Box(Interval.empty((2,)) if self.is_empty else Interval.hull_of(self.corners, 0))

    def clip(self, strips: Strips) -> ConvexPolygon:
        """What strips leave, and a margin: see above."""
        low, high = strips.offset.lo, strips.offset.hi
        return self.clip_half_planes(
            np.concatenate([strips.a, -strips.a]), np.concatenate([strips.b, -strips.b]), np.concatenate([high, -low])
        )

    def clip_half_planes(self, a: npt.ArrayLike, b: npt.ArrayLike, c: npt.ArrayLike) -> ConvexPolygon:
        """What half-planes ``a x + b y <= c`` leave, and a margin: see above.

        Parameters
        ----------
        a, b, c : array_like, shape (K,)
            Not both ``a`` and ``b`` zero; a ``c`` of NaN is an empty half-plane.

        Raises
        ------
        GeometryError
            If a normal is zero or not finite, or the shapes differ.
        """
        normals = np.array([a, b], np.float64).reshape(2, -1)
        limits = np.array(c, np.float64).reshape(-1)
        length = np.hypot(*normals)
        if normals.shape[1] != limits.size or not (np.isfinite(length) & (length > 0)).all():
            raise GeometryError("half-planes: a normal is zero or not finite, or shapes differ; mend a, b, c")
        if self.is_empty or np.isnan(limits).any() or (limits == -np.inf).any():
            return ConvexPolygon(np.empty((0, 2)))
        # The edges move with the others: the polygon is cut again, out of a larger box.
        low, high = self.corners.min(0), self.corners.max(0)
        across = np.roll(self.corners, -1, 0) - self.corners
        own = np.stack([across[:, 1], -across[:, 0]])
        normals = np.concatenate([own, normals], 1)
        limits = np.concatenate([(own * self.corners.T).sum(0), limits])
        scale = float(np.abs(self.corners).max())
        # A line beyond four times that decides by its sign alone, without a crossing.
        reach = np.abs(limits[len(own.T) :]) / length
        scale = max(scale, float(np.minimum(reach, 4.0 * scale).max(initial=0.0)))
        margin = scale * (MARGIN + CLIP_ERROR * limits.size)
        room = np.empty((4, 6 + limits.size))
        room[0, :4] = low[0] - margin, high[0] + margin, high[0] + margin, low[0] - margin
        room[1, :4] = low[1] - margin, low[1] - margin, high[1] + margin, high[1] + margin
        count = clip_half_planes(normals[0], normals[1], limits, room[0], room[1], 4, room[2], room[3], margin)
        return ConvexPolygon(np.ascontiguousarray(room[:2, :count].T))

    def contains(self, points: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Whether points, shape (..., 2), lie inside; rounded as usual."""
        points = np.asarray(points, np.float64)
        inside = np.full(points.shape[:-1], not self.is_empty)
        for start, end in zip(self.corners, np.roll(self.corners, -1, 0), strict=True):
            edge, away = end - start, points - start
            inside &= edge[0] * away[..., 1] - edge[1] * away[..., 0] >= 0
        return inside


def union(polygons: Iterable[ConvexPolygon]) -> Any:
    """Union of convex polygons as a shapely geometry (a polygon, several, or an empty one)."""
    import shapely

    return shapely.union_all([polygon.to_shapely() for polygon in polygons if not polygon.is_empty])


def lines_met(points: Box, alpha: Interval, d: Interval, segments: Box) -> npt.NDArray[np.bool_]:
    """Which boxes meet which segments: their lines, and the hulls of their ends.

    Parameters
    ----------
    points : Box, sides (x, y), batch (N,)
        m.
    alpha, d : Interval, shape (K,)
        Directions of the normals (rad) and distances (m) of the lines.
    segments : Box, sides (x, y), batch (K,)
        Hulls of the segments' ends, m.

    Returns
    -------
    ndarray of bool, shape (K, N)
        False only where no point of the box can lie on the segment.
    """
    c, s = cos_sin(alpha)
    hull = np.ascontiguousarray(np.stack([segments.lo[0], segments.hi[0], segments.lo[1], segments.hi[1]]))
    out = np.empty((alpha.size, points.batch[0]), np.bool_)
    bounds = (points.lo[0], points.hi[0], points.lo[1], points.hi[1])
    meets_lines(*bounds, c.lo, c.hi, s.lo, s.hi, d.lo, d.hi, hull, out)
    return out
