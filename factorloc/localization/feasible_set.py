"""Feasible sets: headings and positions that all correspondences allow, but for some that are doubtful enough.

For a slice of headings ``theta``, a correspondence with the line ``(alpha_l, d_l)`` about the anchor q of the scan and
the facade ``(alpha, d_m)`` about its centre c says

    alpha = alpha_l + theta,    n(alpha) . (t + R(theta) q - c) = d_m - d_l,

a strip of positions t: heading and strip belong together. Across it, along the
wall, some of the middle half of the supporters is between the ends of the row of walls in line with the facade: a
second strip. The ends of the facade itself would be too tight, as supporters are of its neighbours too, and so would be
the first and the last supporter.

Some correspondences are false. Each has a doubt p, and weighs ``log((1 - p) / p)``: if they are false independently of
each other, a pose at which the false ones are exactly those that fail has odds of ``exp(-weight of those)``. The set is
made of the poses of least such weight, as many as hold all but a small part of these odds together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field
from scipy import ndimage

from factorloc.config import Block
from factorloc.errors import GeometryError
from factorloc.intervals import ConvexPolygon
from factorloc.localization._cell_kernels import convex_hull, mark_polygon
from factorloc.localization._facade_kernels import weigh_satisfied
from factorloc.localization.correspondence import Correspondence
from factorloc.localization.facade_strips import SLACK, Frame, Strips
from factorloc.localization.line_weights import likely_level, surprising_weight, weights_of
from factorloc.localization.wall_lines import WallLines
from factorloc.result import Bounds

__all__ = ["FeasibleSet", "FeasibleSettings", "hull_of", "hull_of_points", "intersect_correspondences"]

Array = npt.NDArray[np.float64]

_NEIGHBOURS = np.ones((3, 3))
_SIDES = 12
_SLIVER = 1e-4  # m^2
_TWINS = 1e-6  # m; corners at most so far apart are one


class FeasibleSettings(Block):
    """How correspondences are intersected.

    Parameters
    ----------
    confidence : float
        Poses are left out that together have at most the rest of the odds. That is a statement on doubts: no interval
        operation can promise that a line is that of its wall. Published is the intersection of all.
    surprise : float
        Assumptions count as violated if the lightest correspondences that have to be false are so heavy that it was
        less probable than this that as heavy ones are.
    orthogonal : {"chain", "none"}
        Second strip of each: along the wall, by the whole row of walls in line with it, or not at all. The facade alone
        would be too tight: supporters are of its neighbours too.
    slice : float
        Width of a slice of headings, rad.
    cells : int
        Cells along the longer side of the positions that were possible.
    """

    confidence: float = Field(0.9999, gt=0, lt=1)
    surprise: float = Field(1e-4, ge=0, lt=1)
    orthogonal: Literal["chain", "none"] = "chain"
    slice: float = Field(math.radians(0.35), gt=0)
    cells: int = Field(64, ge=4, le=512)


@dataclass(frozen=True, eq=False)
class FeasibleSet:
    """What correspondences leave.

    Parameters
    ----------
    bounds : Bounds
        Orientation interval and convex polygons; without polygons, if the assumptions are violated.
    slices : tuple of Bounds
        The same by narrow slices of headings: heading and position belong together, and a motion moves them so.
    conflicts : tuple of int
        Facades whose correspondences fail where those that hold weigh most.
    correspondences : int
        How many there were.
    """

    bounds: Bounds
    slices: tuple[Bounds, ...]
    conflicts: tuple[int, ...]
    correspondences: int

    @property
    def failed(self) -> int:
        """How many correspondences fail where most hold."""
        return len(self.conflicts)

    @property
    def violated(self) -> bool:
        """Whether no pose satisfies enough correspondences: assumptions are violated."""
        return not self.bounds.polygons


def intersect_correspondences(
    found: tuple[Correspondence, ...],
    walls: WallLines,
    start: Bounds | Sequence[Bounds],
    settings: FeasibleSettings | None = None,
) -> FeasibleSet:
    """Intersect correspondences over slices of headings and cells of positions, all but some doubtful ones.

    Cells are kept whole, and the convex hull of every set of positions that hang together becomes a polygon. If the
    true pose was in the start, and the lightest correspondences that are false (line not in the hull, facade not the
    right one) weigh no more than those of the lightest pose that was kept, it is in the result.

    Walls of one building share its shift. Two that meet at an angle therefore also bound the position by a box: that of
    the parallelogram which they leave without the shift, plus the shift along each axis.

    Parameters
    ----------
    found : tuple of Correspondence
        Of one scan.
    walls : WallLines
        The map.
    start : Bounds or sequence of Bounds
        Where the body may be: a set, or slices of one that may overlap; not empty.
    settings : FeasibleSettings, optional
        See there.
    """
    settings = settings or FeasibleSettings()
    given = (start,) if isinstance(start, Bounds) else tuple(start)
    whole = start if isinstance(start, Bounds) else hull_of(given)
    if not found:
        return FeasibleSet(whole, given, (), 0)
    corners = np.concatenate(whole.polygons)
    middle = 0.5 * (corners.min(0) + corners.max(0))
    facades = np.array([one.facade for one in found])
    strongest = int(facades[np.argmax([one.votes for one in found])])
    frame = Frame(middle, walls.along[strongest])
    local = frame.into(corners)
    low, high = local.min(0) - SLACK, local.max(0) + SLACK
    step = float((high - low).max()) / settings.cells
    shape = np.maximum(np.ceil((high - low) / step).astype(np.int64), 1)
    slices = max(math.ceil((whole.orientation[1] - whole.orientation[0]) / settings.slice), 1)
    edges = np.linspace(whole.orientation[0], whole.orientation[1], slices + 1)
    strips = Strips(found, walls, frame, edges, float(np.hypot(*(0.5 * (high - low)))))
    across = strips.along_walls(walls, settings.orthogonal == "chain")
    pairs, boxes = strips.of_buildings(walls)
    doubts = np.array([one.doubt for one in found])
    weights = weights_of(doubts)
    sums = np.empty((slices, shape[1], shape[0]), np.int32)
    room = np.empty(len(found), np.int64), np.empty(len(found), np.int64), np.empty(shape[0] + 1, np.int32)
    normal = strips.widened(strips.shift)
    weigh_satisfied(normal, across, boxes, pairs, weights, low[0], low[1], step, *room, sums)
    sums[~_cells_of(given, edges, frame, low, step, shape)] = -1
    best, all_of_them = int(sums.max()), int(weights.sum())
    conflicts = () if best == all_of_them else _conflicts(sums, normal, across, low, step, facades)
    if best < 0 or all_of_them - best > surprising_weight(weights, doubts, settings.surprise):
        return FeasibleSet(Bounds(whole.orientation, ()), (), conflicts, len(found))
    kept = sums >= likely_level(sums, best, settings.confidence)
    turns = np.flatnonzero(kept.any((1, 2)))
    orientation = float(edges[turns[0]]), float(edges[turns[-1] + 1])
    bounds = Bounds(orientation, _cut(_polygons(np.asarray(kept.any(0)), frame, low, step), corners))
    parts = []
    for j in turns:
        limits = float(edges[j]), float(edges[j + 1])
        before = [polygon for one in given if _meet(one.orientation, limits) for polygon in one.polygons]
        parts.append(Bounds(limits, _cut(_polygons(kept[j], frame, low, step), np.concatenate(before))))
    return FeasibleSet(bounds, tuple(parts), conflicts, len(found))


def hull_of(slices: Sequence[Bounds]) -> Bounds:
    """All headings of some slices, and one convex polygon around all their positions.

    Raises
    ------
    GeometryError
        If there is none.
    """
    if not slices:
        raise GeometryError("bounds: no slice is left; no pose is possible")
    headings = np.array([one.orientation for one in slices])
    corners = np.concatenate([polygon for one in slices for polygon in one.polygons])
    return Bounds((float(headings[:, 0].min()), float(headings[:, 1].max())), (hull_of_points(corners),))


def hull_of_points(points: Array) -> Array:
    """Corners of the convex hull of points, counter-clockwise."""
    out = np.empty((2 * len(points) + 2, 2))
    order = np.lexsort((points[:, 1], points[:, 0]))
    return out[: convex_hull(points, order, out)].copy()


def without_twins(polygon: Array) -> Array:
    """A convex polygon, a micrometre larger, without corners so near to each other that rounding turns their edge.

    Whoever asks on which side of such an edge a point is gets any answer.
    """
    kept = [polygon[0]]
    for corner in polygon[1:]:
        if np.abs(corner - kept[-1]).max() > _TWINS and np.abs(corner - kept[0]).max() > _TWINS:
            kept.append(corner)
    square = _TWINS * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    return hull_of_points((np.array(kept)[:, None] + square).reshape(-1, 2))


def _cells_of(
    given: Sequence[Bounds], edges: Array, frame: Frame, low: Array, step: float, shape: npt.NDArray[np.int64]
) -> npt.NDArray[np.bool_]:
    """Cells that meet a polygon of some slices, whose headings meet those of the cells; shape (J, Y, X)."""
    met = np.zeros((len(edges) - 1, shape[1], shape[0]), np.bool_)
    flags = np.empty((shape[1], shape[0]), np.bool_)
    for one in given:
        first = max(int(np.searchsorted(edges, one.orientation[0] - SLACK, "right")) - 1, 0)
        last = int(np.searchsorted(edges, one.orientation[1] + SLACK, "left"))
        flags[:] = False
        for polygon in one.polygons:
            mark_polygon(frame.into(polygon), low[0], low[1], step, SLACK, flags)
        met[first:last] |= flags
    return met


def _meet(one: tuple[float, float], other: tuple[float, float]) -> bool:
    return one[0] <= other[1] + SLACK and other[0] <= one[1] + SLACK


def _cut(polygons: tuple[Array, ...], before: Array) -> tuple[Array, ...]:
    """Polygons within the hull of what was possible before: whole cells would reach beyond it, scan after scan.

    Its longest sides do, or corners would become more with every scan.
    """
    hull = hull_of_points(before)
    if len(hull) < 3:
        return polygons
    along = np.roll(hull, -1, 0) - hull
    sides = np.argsort(-np.hypot(along[:, 0], along[:, 1]))[:_SIDES]
    hull, a, b = hull[sides], along[sides, 1], -along[sides, 0]
    c = a * hull[:, 0] + b * hull[:, 1]
    cut = [ConvexPolygon(one).clip_half_planes(a, b, c) for one in polygons]
    # Of a sliver, no pose is inside to rounding: it stays as it is.
    return tuple(
        one if part.area < _SLIVER else without_twins(part.corners) for one, part in zip(polygons, cut, strict=True)
    )


def _conflicts(
    sums: npt.NDArray[np.int32], strips: Array, across: Array, low: Array, step: float,
    facades: npt.NDArray[np.int64],
) -> tuple[int, ...]:  # fmt: skip
    """Facades whose strips do not meet the best cell."""
    j, y, x = np.unravel_index(int(np.argmax(sums)), sums.shape)
    centre = low + step * (np.array([x, y]) + 0.5)
    fails = np.zeros(len(facades), np.bool_)
    for limits in (strips[j], across[j]):
        value = limits[:, :2] @ centre
        radius = 0.5 * step * np.abs(limits[:, :2]).sum(1)
        fails |= (limits[:, 2] > limits[:, 3]) | (value - radius > limits[:, 3]) | (value + radius < limits[:, 2])
    return tuple(int(facade) for facade in facades[fails])


def _outermost(cells: npt.NDArray[np.bool_]) -> npt.NDArray[np.int64]:
    """First and last cell of every row."""
    rows = np.flatnonzero(cells.any(1))
    first, last = cells[rows].argmax(1), cells.shape[1] - 1 - cells[rows, ::-1].argmax(1)
    return np.concatenate([np.stack([rows, first], -1), np.stack([rows, last], -1)])


def _polygons(kept: npt.NDArray[np.bool_], frame: Frame, low: Array, step: float) -> tuple[Array, ...]:
    labels, number = ndimage.label(kept, _NEIGHBOURS)
    polygons = []
    for one in range(1, number + 1):
        cells = _outermost(labels == one)
        corners = np.concatenate([cells[:, ::-1] + np.array(at) for at in ((0, 0), (0, 1), (1, 0), (1, 1))])
        hull = hull_of_points(corners.astype(np.float64)) * step + low
        # Rounding moves corners by less than the slack; the frame keeps the order.
        outward = hull + SLACK * np.sign(hull - hull.mean(0))
        polygons.append(frame.out(outward))
    return tuple(polygons)
