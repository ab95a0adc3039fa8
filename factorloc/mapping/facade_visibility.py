"""Visibility: which facades are seen from a point of a map as drawn, and which may be seen from a region in truth."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import shapely

from factorloc.intervals import Box, Interval, cos_sin
from factorloc.mapping._visibility_kernels import surely_hidden, visible_shares
from factorloc.mapping.facade_bounds import FacadeBounds
from factorloc.mapping.facades import Facades

__all__ = ["Cores", "SightLines", "certain_cores", "faces_region", "hidden_from_region", "outline_edges", "shares_seen"]

Array = npt.NDArray[np.float64]

_MARGIN = 1e-3  # m; cores shrink by this much more, and rounding cannot matter
_SMALLEST = 0.01  # m^2; a smaller core hides nothing
_FLAT = 1e-9  # share of its area by which a union may differ from its hull and count as convex


@dataclass(frozen=True)
class SightLines:
    """How a sensor looks over things: what is certainly hidden depends on it.

    Parameters
    ----------
    height : float
        Greatest height of the sensor above the ground, m.
    elevation : float
        Greatest elevation of its beams, roll and pitch included, rad.
    least_building : float
        Height that buildings of unknown height have at least, m.
    """

    height: float = 2.0
    elevation: float = math.radians(4.0)
    least_building: float = 3.0

    def blocked_up_to(self, heights: Array) -> Array:
        """How far away (m) buildings of these heights (m) still hide everything behind them."""
        rise = np.where(np.isnan(heights), self.least_building, heights) - self.height
        slope = math.tan(min(max(self.elevation, 1e-6), 1.5))
        return np.asarray(rise / slope)


def outline_edges(polygons: Sequence[shapely.Polygon]) -> Array:
    """All edges of outlines and their courtyards, shape (E, 4)."""
    rings = [shapely.get_coordinates(ring) for polygon in polygons for ring in shapely.get_rings(polygon)]
    return np.concatenate([np.empty((0, 4)), *(np.hstack([ring[:-1], ring[1:]]) for ring in rings)])


def shares_seen(position: npt.ArrayLike, facades: Facades, edges: Array) -> Array:
    """Share of each facade that is seen from a point, if the map is as drawn; (F,)."""
    x, y = np.asarray(position, np.float64).tolist()
    shares = np.empty(len(facades))
    visible_shares(x, y, np.ascontiguousarray(facades.segments.reshape(-1, 4)), edges, shares)
    return shares


@dataclass(frozen=True)
class Cores:
    """Convex insides of buildings.

    Parameters
    ----------
    corners : ndarray, shape (M, 2)
        Of all, one core after the other, counter-clockwise, m.
    firsts : ndarray of int64, shape (N + 1,)
        First corner of each, and one past the last.
    owners : ndarray of int64, shape (N,)
        Building of each.
    """

    corners: Array
    firsts: npt.NDArray[np.int64]
    owners: npt.NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.owners)

    def polygon(self, number: int) -> shapely.Polygon:
        """One of them."""
        return shapely.Polygon(self.corners[self.firsts[number] : self.firsts[number + 1]])

    @cached_property
    def low(self) -> Array:
        """Lowest x and y of each, (N, 2)."""
        return np.minimum.reduceat(self.corners, self.firsts[:-1]) if len(self) else np.empty((0, 2))

    @cached_property
    def high(self) -> Array:
        """Highest x and y of each, (N, 2)."""
        return np.maximum.reduceat(self.corners, self.firsts[:-1]) if len(self) else np.empty((0, 2))


def certain_cores(polygons: Sequence[shapely.Polygon], errors: Array) -> Cores:
    """Convex pieces of what is inside of buildings whatever errors their corners have.

    Every point of a true outline is within the error of one as drawn, along each axis, and so are all outlines on the
    way from one to the other. A point farther than that from the outline is never crossed by it: it stays inside.

    Parameters
    ----------
    polygons : sequence of shapely.Polygon
        Buildings as drawn.
    errors : ndarray, shape (B,)
        Greatest error of their corners along each axis, m; NaN for buildings to leave out.
    """
    cores: list[Array] = []
    owners: list[int] = []
    for number, (polygon, error) in enumerate(zip(polygons, errors.tolist(), strict=True)):
        if math.isnan(error):
            continue
        reach = error + _MARGIN
        edges = outline_edges([polygon]).reshape(-1, 1, 2, 2)
        corners = edges + reach * np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])[None, :, None]
        blurred = shapely.convex_hull(shapely.multipoints(corners.reshape(len(edges), -1, 2)))
        inside = polygon.difference(shapely.union_all(blurred))
        for part in shapely.get_parts(inside) if inside.area > _SMALLEST else ():
            for convex in _convex_parts(part):
                ring = shapely.orient_polygons(shapely.convex_hull(convex)).exterior
                cores.append(shapely.get_coordinates(ring)[:-1])
                owners.append(number)
    firsts = np.cumsum([0, *(len(corners) for corners in cores)])
    return Cores(np.concatenate([np.empty((0, 2)), *cores]), firsts.astype(np.int64), np.array(owners, np.int64))


def _convex_parts(polygon: shapely.Polygon) -> Iterator[shapely.Polygon]:
    """Convex pieces of a polygon: its triangles, grown over their neighbours as long as they stay convex."""
    if _is_convex(polygon):
        yield polygon
        return
    triangles = list(shapely.get_parts(shapely.constrained_delaunay_triangles(polygon)))
    triangles.sort(key=lambda triangle: -triangle.area)
    while triangles:
        grown, rest = triangles[0], triangles[1:]
        while True:
            joins = (k for k, t in enumerate(rest) if _is_convex(shapely.union(grown, t)))
            if (k := next(joins, None)) is None:
                break
            grown = shapely.union(grown, rest.pop(k))
        yield grown
        triangles = rest


def _is_convex(shape: shapely.Geometry) -> bool:
    return bool(shape.geom_type == "Polygon" and shape.convex_hull.area - shape.area <= _FLAT * shape.area)


def faces_region(bounds: FacadeBounds, region: Box) -> npt.NDArray[np.bool_]:
    """Which facades may turn their outside to a point of a region (x, y) about the origin of the bounds, (F,)."""
    c, s = cos_sin(bounds.alpha)
    before = c * Interval(region.lo[0], region.hi[0]) + s * Interval(region.lo[1], region.hi[1]) - bounds.d
    return np.asarray(before.hi > 0.0)


def hidden_from_region(
    facades: Facades, region: Box, cores: Cores, reaches: Array, cell: float = 2.5, piece: float = 4.0
) -> npt.NDArray[np.bool_]:
    """Which facades no point of a region can see, whatever errors the map has.

    Region and facades are cut up. A piece is hidden from a cell if one convex core meets all ways between them, which
    holds if it meets those between their corners: what a convex core hides from a point is convex. A core that reaches
    into the cell hides nothing.

    Parameters
    ----------
    facades : Facades
        In the frame of the region.
    region : Box, sides (x, y)
        Where the sensor may be, m.
    cores : Cores
        Convex insides of buildings.
    reaches : ndarray, shape (len(cores),)
        How far away each still hides everything behind it, m.
    cell, piece : float
        Largest side of a cell and length of a piece, m; smaller ones find more that is hidden.

    Returns
    -------
    ndarray of bool, shape (F,)
        True only where a facade is certainly hidden.
    """
    hidden = np.zeros(len(facades), np.bool_)
    low, high = region.lo, region.hi
    far = np.maximum(cores.high - low, high - cores.low)
    meets = ((cores.low <= high) & (cores.high >= low)).all(1)
    used = np.flatnonzero((np.hypot(far[:, 0], far[:, 1]) <= reaches) & ~meets)
    if not len(used) or not len(facades):
        return hidden
    counts = np.maximum(np.ceil(facades.lengths / piece), 1).astype(np.int64)
    owners = np.repeat(np.arange(len(facades)), counts)
    order = np.arange(len(owners)) - np.repeat(np.cumsum(counts) - counts, counts)
    ends = np.stack([order, order + 1], 1) / counts[owners, None]
    a, b = facades.segments[owners, :1], facades.segments[owners, 1:]
    middle = a + ends[:, :, None] * (b - a)
    error = (facades.shifts + facades.vertex_errors)[owners] + _MARGIN
    around = np.array([(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)])
    pieces = (middle[:, :, None] + error[:, None, None, None] * around).reshape(len(owners), 8, 2)
    hidden[:] = True
    cells = _cells(low, high, cell)
    surely_hidden(cells, np.ascontiguousarray(pieces), owners, cores.corners, cores.firsts, used, hidden)
    return hidden


def _cells(low: Array, high: Array, size: float) -> Array:
    """Corners (C, 4, 2) of the cells of a rectangle."""
    xs, ys = (np.linspace(low[k], high[k], max(math.ceil((high[k] - low[k]) / size), 1) + 1) for k in (0, 1))
    x0, y0 = (side.ravel() for side in np.meshgrid(xs[:-1], ys[:-1], indexing="ij"))
    x1, y1 = (side.ravel() for side in np.meshgrid(xs[1:], ys[1:], indexing="ij"))
    return np.ascontiguousarray(np.stack([x0, y0, x1, y0, x1, y1, x0, y1], -1).reshape(-1, 4, 2))
