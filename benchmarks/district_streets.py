"""Streets of a district as lines: where cars drive, park and are looked for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt
import shapely
from scipy.ndimage import gaussian_filter1d

from factorloc.datasets.building_features import optional
from factorloc.errors import SimulationError
from factorloc.mapping import LocalFrame

__all__ = ["PATH_STEP", "Streets", "read_streets"]

Array = npt.NDArray[np.float64]

_DRIVEN = frozenset({"residential", "secondary", "tertiary", "unclassified", "living_street"})
PATH_STEP = 0.5
"""Distance of points of a path, m."""

_ROUNDING = 3.0  # m; standard deviation of the filter that rounds corners
_ATTEMPTS = 400

Node = tuple[float, float]


def read_streets(path: Path, frame: LocalFrame) -> list[shapely.LineString]:
    """Middle lines of the streets of an OpenStreetMap extract that cars drive through, in a local frame."""
    osmium = optional("osmium")
    lines = []
    highways = osmium.filter.KeyFilter("highway")
    for way in osmium.FileProcessor(str(path)).with_locations().with_filter(highways):
        if way.is_way() and way.tags["highway"] in _DRIVEN:
            points = [(node.lon, node.lat) for node in way.nodes if node.location.valid()]
            if len(points) > 1:
                lines.append(shapely.LineString(frame.from_geographic(points)))
    return lines


@dataclass(frozen=True)
class Streets:
    """Middle lines of streets, m.

    Parameters
    ----------
    lines : tuple of shapely.LineString
        They meet at their ends.
    """

    lines: tuple[shapely.LineString, ...]

    @classmethod
    def within(cls, lines: list[shapely.LineString], area: shapely.Polygon) -> Streets:
        """Cut lines to an area, and at all crossings; what is cut off from the largest net is left out."""
        pieces = shapely.get_parts(shapely.node(shapely.union_all(lines).intersection(area)))
        pieces = [piece for piece in pieces if piece.length > 0.1]
        nets = shapely.get_parts(shapely.line_merge(shapely.union_all(pieces)).buffer(0.01))
        largest = max(nets, key=lambda net: net.area).buffer(0.1)
        return cls(tuple(piece for piece in pieces if largest.contains(piece)))

    @property
    def length(self) -> float:
        """Of all streets, m."""
        return float(sum(line.length for line in self.lines))

    def spots(self, pitch: float) -> Array:
        """Places along all streets every so many metres: x, y and direction (N, 3)."""
        found = [np.empty((0, 3))]
        for line in self.lines:
            found += [_at(line, s)[None] for s in np.arange(0.5 * pitch, line.length, pitch).tolist()]
        return np.concatenate(found)

    def spot(self, rng: np.random.Generator) -> Array:
        """A place on a street, each metre as likely as any other: x, y and direction."""
        lengths = np.array([line.length for line in self.lines])
        line = self.lines[int(rng.choice(len(lengths), p=lengths / lengths.sum()))]
        return _at(line, float(rng.uniform(0, line.length)))

    def tour(self, length: float, lane: float, blocked: shapely.Geometry, rng: np.random.Generator) -> Array:
        """Drive in the right-hand lane, preferring streets driven least; turn at dead ends.

        Parameters
        ----------
        length : float
            How far, m.
        lane : float
            Distance from the middle of the street, m.
        blocked : shapely.Geometry
            Where the path must not lead.
        rng : numpy.random.Generator
            Chooses where to begin and to turn.

        Returns
        -------
        ndarray, shape (N, 3)
            x, y and heading every 0.5 m.

        Raises
        ------
        SimulationError
            If no such path is found.
        """
        shapely.prepare(blocked)
        for _ in range(_ATTEMPTS):
            path = self._path(length + 30.0, lane, rng)
            free = ~shapely.intersects_xy(blocked, path[:, 0], path[:, 1])
            # The longest stretch without an obstacle will do.
            ends = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]]).astype(np.int8)))
            first, last = max(
                zip(ends[::2], ends[1::2], strict=True), key=lambda span: span[1] - span[0], default=(0, 0)
            )
            if last - first > length / PATH_STEP + 2:
                return path[first : first + int(length / PATH_STEP) + 3]  # arcs are longer than their chords
        raise SimulationError(f"streets: no free tour of {length} m was found; cut out a larger place")

    @cached_property
    def _ways(self) -> dict[Node, list[tuple[Node, Array]]]:
        """From each node to its neighbours, with the way there."""
        ways: dict[Node, list[tuple[Node, Array]]] = {}
        for line in self.lines:
            points = shapely.get_coordinates(line)
            for way in (points, points[::-1]):
                ways.setdefault(_node(way[0]), []).append((_node(way[-1]), way))
        return ways

    def _path(self, length: float, lane: float, rng: np.random.Generator) -> Array:
        nodes = sorted(self._ways)
        here, before = nodes[int(rng.integers(len(nodes)))], None
        wear: dict[frozenset[Node], int] = {}
        legs: list[Array] = []
        driven = 0.0
        while driven < length:
            choices = self._ways[here]
            onwards = [way for way in choices if way[0] != before] or choices
            lots = rng.random(len(onwards))
            costs = [wear.get(frozenset((here, way[0])), 0) + lot for way, lot in zip(onwards, lots, strict=True)]
            there, points = onwards[int(np.argmin(costs))]
            wear[frozenset((here, there))] = wear.get(frozenset((here, there)), 0) + 1
            side = shapely.offset_curve(shapely.LineString(points), -lane, join_style="mitre")
            if side.geom_type == "LineString" and side.length > 0:
                legs.append(shapely.get_coordinates(side))
                driven += side.length
            here, before = there, here
        rough = _resampled(np.concatenate(legs))
        path = _resampled(gaussian_filter1d(rough, _ROUNDING / PATH_STEP, axis=0, mode="nearest"))
        along = np.gradient(path, axis=0)
        return np.column_stack([path, np.unwrap(np.arctan2(along[:, 1], along[:, 0]))])


def _resampled(points: Array) -> Array:
    line = shapely.LineString(points)
    return np.asarray(
        shapely.get_coordinates(shapely.line_interpolate_point(line, np.arange(0, line.length, PATH_STEP)))
    )


def _at(line: shapely.LineString, s: float) -> Array:
    a, b = (shapely.get_coordinates(line.interpolate(np.clip(d, 0, line.length)))[0] for d in (s - 0.25, s + 0.25))
    x, y = shapely.get_coordinates(line.interpolate(s))[0]
    return np.array([x, y, np.arctan2(b[1] - a[1], b[0] - a[0])])


def _node(point: Array) -> Node:
    return round(float(point[0]), 2), round(float(point[1]), 2)
