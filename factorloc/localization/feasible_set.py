"""Feasible sets: headings and positions that all but a few of some correspondences allow.

For a slice of headings ``theta``, a correspondence with the line ``(alpha_l, d_l)`` about the anchor q of the scan and
the facade ``(alpha, d_m)`` about its centre c says

    alpha = alpha_l + theta,    n(alpha) . (t + R(theta) q - c) = d_m - d_l,

a strip of positions t: heading and strip belong together. Across it, along the wall, the median of the supporters lies
between the ends of the row of walls in line with the facade: a second strip. The ends of the facade itself would be too
tight, as supporters are of its neighbours too, and so would be the first and the last supporter.
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
from factorloc.localization._cell_kernels import convex_hull, mark_polygon
from factorloc.localization._facade_kernels import count_satisfied
from factorloc.localization.correspondences import Correspondence
from factorloc.localization.facade_strips import SLACK, Frame, Strips
from factorloc.localization.wall_lines import WallLines
from factorloc.result import Bounds

__all__ = ["FeasibleSet", "FeasibleSettings", "hull_of", "hull_of_points", "intersect_correspondences"]

Array = npt.NDArray[np.float64]

_NEIGHBOURS = np.ones((3, 3))


class FeasibleSettings(Block):
    """How correspondences are intersected.

    Parameters
    ----------
    relaxed : float
        Part of the correspondences that may be false, rounded down. The smallest number that leaves a pose is *not*
        sound, and not on offer.
    most_false : int
        No more of them may be false than this, however many there are.
    orthogonal : {"chain", "none"}
        Second strip of each: along the wall, by the whole row of walls in line with it, or not at all. The facade alone
        would be too tight: supporters are of its neighbours too.
    slice : float
        Width of a slice of headings, rad.
    cells : int
        Cells along the longer side of the positions that were possible.
    """

    relaxed: float = Field(1.0 / 3.0, ge=0, lt=1)
    most_false: int = Field(2, ge=0)
    orthogonal: Literal["chain", "none"] = "chain"
    slice: float = Field(math.radians(0.25), gt=0)
    cells: int = Field(96, ge=4, le=512)


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
        Facades whose correspondences fail where most hold.
    correspondences, allowed, failed : int
        How many there were, how many may be false, and how many are at best.
    """

    bounds: Bounds
    slices: tuple[Bounds, ...]
    conflicts: tuple[int, ...]
    correspondences: int
    allowed: int
    failed: int

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
    """Intersect correspondences over slices of headings and cells of positions, all but some of them.

    A pose is kept if at least ``n - floor(relaxed n)`` of n correspondences may hold there; cells are kept whole, and
    the convex hull of every set of positions that hang together becomes a polygon. If that many correspondences are
    right (line in the hull, facade the right one), and the true pose was in the start, it is in the result.

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
    allowed = min(math.floor(settings.relaxed * len(found) + 1e-9), settings.most_false)
    given = (start,) if isinstance(start, Bounds) else tuple(start)
    whole = start if isinstance(start, Bounds) else hull_of(given)
    if not found:
        return FeasibleSet(whole, given, (), 0, 0, 0)
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
    counts = np.empty((slices, shape[1], shape[0]), np.int32)
    room = np.empty(len(found), np.int64), np.empty(len(found), np.int64), np.empty(shape[0] + 1, np.int32)
    normal = strips.widened(strips.shift)
    count_satisfied(normal, across, boxes, pairs, low[0], low[1], step, *room, counts)
    counts[~_cells_of(given, edges, frame, low, step, shape)] = -1
    best = int(counts.max())
    failed = len(found) - max(best, 0)
    conflicts = () if failed == 0 else _conflicts(counts, normal, across, low, step, facades)
    kept = counts >= len(found) - allowed
    if not kept.any():
        return FeasibleSet(Bounds(whole.orientation, ()), (), conflicts, len(found), allowed, failed)
    turns = np.flatnonzero(kept.any((1, 2)))
    orientation = float(edges[turns[0]]), float(edges[turns[-1] + 1])
    bounds = Bounds(orientation, _polygons(np.asarray(kept.any(0)), frame, low, step))
    parts = tuple(Bounds((float(edges[j]), float(edges[j + 1])), _polygons(kept[j], frame, low, step)) for j in turns)
    return FeasibleSet(bounds, parts, conflicts, len(found), allowed, failed)


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


def _conflicts(
    counts: npt.NDArray[np.int32], strips: Array, across: Array, low: Array, step: float,
    facades: npt.NDArray[np.int64],
) -> tuple[int, ...]:  # fmt: skip
    """Facades whose strips do not meet the best cell."""
    j, y, x = np.unravel_index(int(np.argmax(counts)), counts.shape)
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
