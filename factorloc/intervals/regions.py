"""Regions of the plane as separators: half-planes, disks, annuli, polygons."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt

from factorloc.errors import GeometryError
from factorloc.intervals.box import Box
from factorloc.intervals.constraints import Distance, Linear, SegmentHull
from factorloc.intervals.contractor import AnyOf, Contractor, InSequence
from factorloc.intervals.interval import Interval
from factorloc.intervals.separator import Separator

if TYPE_CHECKING:
    import shapely

__all__ = ["Ring", "annulus", "disk", "half_plane", "polygon", "segment"]


@dataclass(frozen=True)
class Ring:
    """Points ``(x, y)`` whose distance to a centre lies in an interval.

    Parameters
    ----------
    centre : (float, float)
        m.
    distance : Interval
        m.
    """

    centre: tuple[float, float]
    distance: Interval
    minimal: ClassVar[bool] = False  # close to a tangent, the root of a rounded difference is loose

    @property
    def constraint(self) -> str:
        """The inequality in words."""
        return f"|(x, y) - {self.centre}| in {self.distance}"

    def contract(self, box: Box) -> Box:
        """Shrink boxes."""
        return Distance().contract(Box.of(box[0], box[1], *self.centre, self.distance)).take((0, 1))


def disk(centre: tuple[float, float], radius: float) -> Separator:
    """Points at most a radius (m) away from a centre (m)."""
    return annulus(centre, 0.0, radius)


def annulus(centre: tuple[float, float], least: float, most: float) -> Separator:
    """Points between two distances (m) of a centre (m).

    Raises
    ------
    GeometryError
        If the distances are not ``0 <= least <= most``.
    """
    if not 0 <= least <= most < math.inf:
        raise GeometryError(f"annulus: distances {least} to {most} m; 0 <= least <= most")
    beyond: Contractor = Ring(centre, Interval(most, math.inf))
    if least > 0:
        beyond = AnyOf((beyond, Ring(centre, Interval(0.0, least))))
    return Separator(Ring(centre, Interval(least, most)), beyond)


def half_plane(a: float, b: float, c: float) -> Separator:
    """Points with ``a x + b y <= c``."""
    return Separator(Linear(a, b, Interval(-math.inf, c)), Linear(a, b, Interval(c, math.inf)))


def segment(start: npt.ArrayLike, end: npt.ArrayLike) -> Contractor:
    """Points of the segment between two points, shape (2,) (m): on its line and in the hull of its ends."""
    p, q = np.asarray(start, np.float64), np.asarray(end, np.float64)
    hull = SegmentHull(Box(Interval.hull_of(np.stack([p, q]), 0)))
    x, y = Interval(p[0]), Interval(p[1])
    a, b = Interval(q[1]) - y, x - Interval(q[0])
    if (p == q).all():
        return hull
    return InSequence((hull, Linear(a, b, a * x + b * y)))


@dataclass(frozen=True)
class _PolygonSide:
    """Points of a polygon (or not of it): around its border, and beyond the border where a sample point is.

    What the contraction to the border leaves out is free of border, so that each of the (up to four) strips it takes
    off a box is connected and lies inside or outside as a whole. Whether a point off the border is inside is decided by
    GEOS, whose orientation predicates are robust.
    """

    region: Any
    border: Contractor
    inside: bool
    minimal: ClassVar[bool] = False

    @property
    def constraint(self) -> str:
        """Which side."""
        return f"(x, y) {'in' if self.inside else 'not in'} a polygon"

    def contract(self, box: Box) -> Box:
        """Shrink boxes."""
        flat = box.flat()
        edge = self.border.contract(flat)
        lo, hi = edge.lo.copy(), edge.hi.copy()
        gone = edge.is_empty
        keep = gone & self._wanted(flat)
        lo[:, keep], hi[:, keep] = flat.lo[:, keep], flat.hi[:, keep]
        for axis in range(2):
            for bound, own, below in ((lo, flat.lo, True), (hi, flat.hi, False)):
                strip_lo, strip_hi = flat.lo.copy(), flat.hi.copy()
                (strip_hi if below else strip_lo)[axis] = (edge.lo if below else edge.hi)[axis]
                strip = Box(Interval.from_bounds(strip_lo, strip_hi))
                kept = ~gone & (strip_lo[axis] < strip_hi[axis]) & self._wanted(strip)
                bound[axis, kept] = own[axis, kept]
                # A strip spans the whole box across.
                other = 1 - axis
                lo[other, kept], hi[other, kept] = flat.lo[other, kept], flat.hi[other, kept]
        return Box(Interval.from_bounds(lo.reshape(box.bounds.shape), hi.reshape(box.bounds.shape)))

    def _wanted(self, boxes: Box) -> npt.NDArray[np.bool_]:
        import shapely

        mid = boxes.mid
        wanted = shapely.contains_xy(self.region, mid[0], mid[1]) == self.inside
        # A box so thin that its middle rounds to a face may touch the border there: it is kept by either side.
        thin = ((mid <= boxes.lo) | (mid >= boxes.hi)).any(0)
        return np.asarray(~boxes.is_empty & (wanted | thin))


def polygon(region: shapely.Polygon | shapely.MultiPolygon | npt.ArrayLike) -> Separator:
    """Points of a polygon, with holes or without, or of several.

    Parameters
    ----------
    region : shapely polygon or array_like, shape (V, 2)
        m; corners in order.

    Raises
    ------
    GeometryError
        If the polygon is empty or its border crosses itself.
    """
    import shapely

    shape = region if isinstance(region, shapely.Geometry) else shapely.Polygon(np.asarray(region, np.float64))
    if shape.is_empty or not shape.is_valid:
        raise GeometryError(f"polygon: empty or its border is not simple ({shapely.is_valid_reason(shape)}); mend it")
    shapely.prepare(shape)
    rings = [ring for part in shapely.get_parts(shape) for ring in (part.exterior, *part.interiors)]
    corners = [shapely.get_coordinates(ring) for ring in rings]
    edges = tuple(segment(p, q) for ring in corners for p, q in pairwise(ring))
    border = AnyOf(edges)
    return Separator(_PolygonSide(shape, border, inside=True), _PolygonSide(shape, border, inside=False))
