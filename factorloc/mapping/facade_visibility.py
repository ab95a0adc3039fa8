"""Visibility: which facades are seen from a point of a map as drawn, and which may be seen from a region in truth."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from factorloc.intervals import Box, Interval, cos_sin
from factorloc.mapping._visibility_kernels import surely_hidden, visible_shares
from factorloc.mapping.facade_bounds import FacadeBounds
from factorloc.mapping.facades import Facades

__all__ = ["SightLines", "certain_cores", "faces_region", "hidden_from_region", "outline_edges", "shares_seen"]

Array = npt.NDArray[np.float64]

_MARGIN = 1e-3  # m; cores shrink by this much more, and rounding cannot matter
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


def certain_cores(polygons: Sequence[shapely.Polygon], errors: Array) -> tuple[list[Array], npt.NDArray[np.int64]]:
    """Convex pieces of what is inside of buildings whatever errors their corners have.

    Every point of a true outline is within the error of one as drawn, along each axis, and so are all outlines on the
    way from one to the other. A point farther than that from the outline is never crossed by it: it stays inside.

    Parameters
    ----------
    polygons : sequence of shapely.Polygon
        Buildings as drawn.
    errors : ndarray, shape (B,)
        Greatest error of their corners along each axis, m; NaN for buildings to leave out.

    Returns
    -------
    cores : list of ndarray, shape (K, 2)
        Corners, counter-clockwise, m.
    owners : ndarray of int64
        Building of each.
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
        for part in shapely.get_parts(polygon.difference(shapely.union_all(blurred))):
            for convex in _convex_parts(part):
                ring = shapely.orient_polygons(shapely.convex_hull(convex)).exterior
                cores.append(shapely.get_coordinates(ring)[:-1])
                owners.append(number)
    return cores, np.array(owners, np.int64)


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
    facades: Facades, region: Box, cores: Sequence[Array], reaches: Array, cell: float = 2.5, piece: float = 4.0
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
    cores : list of ndarray, shape (K, 2)
        Convex insides of buildings, m.
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
    used = []
    for corners, reach in zip(cores, reaches.tolist(), strict=True):
        x, y = corners.T
        far = math.hypot(max(x.max() - low[0], high[0] - x.min()), max(y.max() - low[1], high[1] - y.min()))
        meets = x.min() <= high[0] and x.max() >= low[0] and y.min() <= high[1] and y.max() >= low[1]
        if far <= reach and not meets:
            used.append(corners)
    if not used or not len(facades):
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
    firsts = np.cumsum([0, *(len(corners) for corners in used)])
    cells = _cells(low, high, cell)
    surely_hidden(cells, np.ascontiguousarray(pieces), owners, np.concatenate(used), firsts.astype(np.int64), hidden)
    return hidden


def _cells(low: Array, high: Array, size: float) -> Array:
    """Corners (C, 4, 2) of the cells of a rectangle."""
    xs, ys = (np.linspace(low[k], high[k], max(math.ceil((high[k] - low[k]) / size), 1) + 1) for k in (0, 1))
    x0, y0 = (side.ravel() for side in np.meshgrid(xs[:-1], ys[:-1], indexing="ij"))
    x1, y1 = (side.ravel() for side in np.meshgrid(xs[1:], ys[1:], indexing="ij"))
    return np.ascontiguousarray(np.stack([x0, y0, x1, y0, x1, y1, x0, y1], -1).reshape(-1, 4, 2))
