"""Pose cells: slices of headings and cells of positions, and what the correspondences that hold there weigh."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from factorloc.intervals import ConvexPolygon
from factorloc.localization._cell_kernels import mark_polygon
from factorloc.localization._facade_kernels import weigh_satisfied
from factorloc.localization.correspondence import Correspondence
from factorloc.localization.facade_strips import SLACK, Frame, Strips
from factorloc.localization.feasible_layers import Layer, hull_of_layers, hull_of_points, without_twins
from factorloc.localization.feasible_settings import FeasibleSettings
from factorloc.localization.line_groups import LineGroups
from factorloc.localization.line_weights import PARTS, weights_of
from factorloc.localization.wall_lines import WallLines
from factorloc.result import Bounds

__all__ = ["PoseCells"]

Array = npt.NDArray[np.float64]

_NEIGHBOURS = np.ones((3, 3))
_SIDES = 12
_SLIVER = 1e-4  # m^2
_IMPOSSIBLE = -(2**30)


class PoseCells:
    """Cells that cover some layers, and what the facades weigh of which the poses of each may satisfy a correspondence.

    Cells are kept whole, and the convex hull of every set of positions that hang together becomes a polygon.

    Walls of one building share its shift. Two that meet at an angle therefore also bound the position by a box: that of
    the parallelogram which they leave without the shift, plus the shift along each axis.

    Parameters
    ----------
    found : tuple of Correspondence
        Of one scan; any of those of one facade will do, as they are from starts that are parts of one.
    walls : WallLines
        The map.
    layers : sequence of Layer
        Where the body may be, by increasing cost.
    settings : FeasibleSettings
        Sizes of the cells, and what of the costs is remembered.
    """

    def __init__(
        self, found: tuple[Correspondence, ...], walls: WallLines, layers: Sequence[Layer], settings: FeasibleSettings
    ) -> None:
        self.layers = tuple(layers)
        self.costs = [round(PARTS * settings.memory * layer.cost) for layer in layers]
        whole = hull_of_layers(layers)
        corners = whole.polygons[0]
        middle = 0.5 * (corners.min(0) + corners.max(0))
        self.lines = LineGroups.of(found)
        axis = np.array([1.0, 0.0])
        if found:
            axis = walls.along[max(self.lines.lines[: self.lines.count], key=lambda one: one.votes).facade]
        self.frame = Frame(middle, axis)
        local = self.frame.into(corners)
        low, high = local.min(0) - SLACK, local.max(0) + SLACK
        self.low, self.step = low, float((high - low).max()) / settings.cells
        self.shape = np.maximum(np.ceil((high - low) / self.step).astype(np.int64), 1)
        slices = max(math.ceil((whole.orientation[1] - whole.orientation[0]) / settings.slice), 1)
        self.edges = np.linspace(whole.orientation[0], whole.orientation[1], slices + 1)
        self.satisfied = np.zeros((slices, self.shape[1], self.shape[0]), np.int32)
        if found:
            self._weigh(walls, settings, float(np.hypot(*(0.5 * (high - low)))))
        self.sums = np.full(self.satisfied.shape, _IMPOSSIBLE, np.int32)
        for layer, cost in reversed(list(zip(self.layers, self.costs, strict=True))):
            met = self._met_by(layer.slices)
            self.sums[met] = self.satisfied[met] - cost

    def _weigh(self, walls: WallLines, settings: FeasibleSettings, radius: float) -> None:
        """Strips of all lines and cores, and the weight that every cell satisfies."""
        lines = self.lines
        strips = Strips(lines.lines, walls, self.frame, self.edges, radius)
        self.across = strips.along_walls(walls, settings.orthogonal == "chain")
        self.normal = strips.widened(strips.shift)
        pairs, boxes = strips.of_buildings(walls, lines.count)
        owner = np.searchsorted(lines.facades, lines.sources[pairs])
        # Which of several lines of a facade a box is of, no cell could tell.
        alone = (np.diff(lines.groups)[owner] == 1).all(1) if len(pairs) else np.empty(0, np.bool_)
        room = np.empty((2, len(lines.lines)), np.int64), np.empty(self.shape[0] + 1, np.int32)
        weigh_satisfied(
            self.normal, self.across, np.ascontiguousarray(boxes[:, alone]), np.concatenate([pairs, owner], 1)[alone],
            lines.groups, lines.weights, self.low[0], self.low[1], self.step, *room[0], room[1], self.satisfied,
        )  # fmt: skip

    @property
    def best(self) -> int:
        """The largest sum of weights, less costs."""
        return int(self.sums.max())

    @property
    def failing(self) -> int:
        """Weight of the facades whose lines do not hold where the sum is largest, as if they had no cores."""
        return int(weights_of(self.lines.doubts)[np.isin(self.lines.facades, self.conflicts)].sum())

    def odds(self, best: int) -> Array:
        """Volumes of the cells (m^2 rad) by how far their sums are below the best of all pieces."""
        depth = best - self.sums[self.sums > _IMPOSSIBLE]
        volume = self.step**2 * (self.edges[1] - self.edges[0])
        return np.asarray(np.bincount(depth) * volume)

    def slices_above(self, level: int) -> list[Bounds]:
        """Poses with at least a sum, by slices of headings; none where there is none.

        Parameters
        ----------
        level : int
            The sum.
        """
        kept, slices = self.sums >= level, list[Bounds]()
        able = self._able(level)
        for j in np.flatnonzero(kept.any((1, 2))):
            limits = float(self.edges[j]), float(self.edges[j + 1])
            before = [polygon for one in able if _meet(one.orientation, limits) for polygon in one.polygons]
            slices.append(Bounds(limits, _cut(self._polygons(kept[j]), np.concatenate(before))))
        return slices

    def bounds_above(self, level: int) -> Bounds | None:
        """The same in one: all headings, and polygons of all positions.

        Parameters
        ----------
        level : int
            The sum.
        """
        kept = self.sums >= level
        turns = np.flatnonzero(kept.any((1, 2)))
        if not len(turns):
            return None
        corners = np.concatenate([polygon for one in self._able(level) for polygon in one.polygons])
        orientation = float(self.edges[turns[0]]), float(self.edges[turns[-1] + 1])
        return Bounds(orientation, _cut(self._polygons(np.asarray(kept.any(0))), corners))

    def _able(self, level: int) -> list[Bounds]:
        """Slices of the layers that are not too costly for a sum, whatever holds there."""
        most = int(self.satisfied[self.sums > _IMPOSSIBLE].max())
        costs = zip(self.layers, self.costs, strict=True)
        return [one for layer, cost in costs if most - cost >= level for one in layer.slices]

    @cached_property
    def conflicts(self) -> tuple[int, ...]:
        """Facades whose strips do not meet the best cell."""
        lines = self.lines
        if not lines.count:
            return ()
        j, y, x = np.unravel_index(int(np.argmax(self.sums)), self.sums.shape)
        centre = self.low + self.step * (np.array([x, y]) + 0.5)
        fails = np.zeros(lines.count, np.bool_)
        for strips in (self.normal[j, : lines.count], self.across[j, : lines.count]):
            value = strips[:, :2] @ centre
            radius = 0.5 * self.step * np.abs(strips[:, :2]).sum(1)
            fails |= (strips[:, 2] > strips[:, 3]) | (value - radius > strips[:, 3]) | (value + radius < strips[:, 2])
        whole = np.logical_and.reduceat(fails, lines.groups[: len(lines.facades)])
        return tuple(int(facade) for facade in lines.facades[whole])

    def _met_by(self, given: Sequence[Bounds]) -> npt.NDArray[np.bool_]:
        """Cells that meet a polygon of some slices, whose headings meet those of the cells; shape (J, Y, X)."""
        met = np.zeros(self.sums.shape, np.bool_)
        flags = np.empty(self.sums.shape[1:], np.bool_)
        for one in given:
            first = max(int(np.searchsorted(self.edges, one.orientation[0] - SLACK, "right")) - 1, 0)
            last = int(np.searchsorted(self.edges, one.orientation[1] + SLACK, "left"))
            flags[:] = False
            for polygon in one.polygons:
                mark_polygon(self.frame.into(polygon), self.low[0], self.low[1], self.step, SLACK, flags)
            met[first:last] |= flags
        return met

    def _polygons(self, kept: npt.NDArray[np.bool_]) -> tuple[Array, ...]:
        labels, number = ndimage.label(kept, _NEIGHBOURS)
        polygons = []
        for one in range(1, number + 1):
            cells = _outermost(labels == one)
            corners = np.concatenate([cells[:, ::-1] + np.array(at) for at in ((0, 0), (0, 1), (1, 0), (1, 1))])
            hull = hull_of_points(corners.astype(np.float64)) * self.step + self.low
            # Rounding moves corners by less than the slack; the frame keeps the order.
            outward = hull + SLACK * np.sign(hull - hull.mean(0))
            polygons.append(self.frame.out(outward))
        return tuple(polygons)


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


def _outermost(cells: npt.NDArray[np.bool_]) -> npt.NDArray[np.int64]:
    """First and last cell of every row."""
    rows = np.flatnonzero(cells.any(1))
    first, last = cells[rows].argmax(1), cells.shape[1] - 1 - cells[rows, ::-1].argmax(1)
    return np.concatenate([np.stack([rows, first], -1), np.stack([rows, last], -1)])
