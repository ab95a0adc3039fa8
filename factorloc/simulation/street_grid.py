"""StreetGrid: where streets run, what they are bordered by, and how one drives along them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import shapely
from pydantic import Field

from factorloc.config import Block
from factorloc.errors import SimulationError
from factorloc.simulation.frontage import Frontage
from factorloc.simulation.ground import Ground
from factorloc.simulation.route import Route

__all__ = ["Node", "StreetGrid", "StreetProfile"]

Node = tuple[int, int]
"""A crossing: number of the street along y and of the one along x."""

_BEYOND = 40.0  # m of ground around everything
_TURN = 5.0  # m; radius of the arcs a car drives at crossings
_BODY = 1.0  # m; half the width of a car


class StreetProfile(Block):
    """Cross-section of a street: two lanes, two rows to park in, two pavements.

    Parameters
    ----------
    lane_width, parking_width, pavement_width : float
        Widths of one of each, m.
    kerb_height : float
        Height of the pavements, m.
    """

    lane_width: float = Field(3.0, gt=2.2)
    parking_width: float = Field(2.2, gt=2.15)
    pavement_width: float = Field(3.5, gt=2.5)
    kerb_height: float = Field(0.12, gt=0)

    @property
    def half_road(self) -> float:
        """From the middle of the road to the kerb, m."""
        return self.lane_width + self.parking_width


@dataclass(frozen=True)
class StreetGrid:
    """Straight streets that cross at right angles.

    Parameters
    ----------
    xs, ys : tuple of float
        Middle of the streets along y, and of those along x, in ascending order, m.
    bounds : (float, float, float, float)
        Lowest x, lowest y, highest x and highest y of the built-up area, m.
    profile : StreetProfile
        Cross-section of all streets.
    slope : (float, float)
        Rise of the ground per metre along x and y.

    Raises
    ------
    SimulationError
        If there is no street, or streets leave no room for houses between them.
    """

    xs: tuple[float, ...]
    ys: tuple[float, ...]
    bounds: tuple[float, float, float, float]
    profile: StreetProfile = field(default_factory=StreetProfile)
    slope: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if not self.xs or not self.ys:
            raise SimulationError("street grid: needs at least one street along x and one along y")
        for name, low, lines, high in (
            ("x", self.bounds[0], self.xs, self.bounds[2]),
            ("y", self.bounds[1], self.ys, self.bounds[3]),
        ):
            room = np.diff([low, *lines, high]) - self.profile.half_road - self.profile.pavement_width
            if room.min() < self.profile.half_road + self.profile.pavement_width:
                raise SimulationError(
                    f"street grid: streets across {name} are too close to one another or to the bounds"
                )

    @cached_property
    def blocks(self) -> tuple[shapely.Polygon, ...]:
        """What lies behind the building lines, one rectangle a block."""
        return tuple(shapely.box(*corners) for _, _, corners in self._cells())

    @cached_property
    def frontages(self) -> tuple[Frontage, ...]:
        """All building lines along streets."""
        columns, rows = len(self.xs), len(self.ys)
        frontages = []
        for i, j, (x0, y0, x1, y1) in self._cells():
            south, east, north, west = j > 0, i < columns, j < rows, i > 0
            nodes = {"sw": (i - 1, j - 1), "se": (i, j - 1), "ne": (i, j), "nw": (i - 1, j)}
            if south:
                street = (nodes["sw"], nodes["se"]) if west and east else None
                frontages.append(Frontage((x0, y0), 0.0, x1 - x0, street=street))
            if east:
                street = (nodes["se"], nodes["ne"]) if south and north else None
                frontages.append(Frontage((x1, y0), np.pi / 2, y1 - y0, (south, north), street))
            if north:
                street = (nodes["ne"], nodes["nw"]) if west and east else None
                frontages.append(Frontage((x1, y1), np.pi, x1 - x0, street=street))
            if west:
                street = (nodes["nw"], nodes["sw"]) if south and north else None
                frontages.append(Frontage((x0, y1), -np.pi / 2, y1 - y0, (north, south), street))
        return tuple(frontages)

    @cached_property
    def open_space(self) -> shapely.Geometry:
        """Roads and pavements: what is not behind a building line."""
        space = shapely.box(*self.bounds).difference(shapely.union_all(self.blocks))
        shapely.prepare(space)
        return space

    @cached_property
    def lanes(self) -> shapely.Geometry:
        """Where cars drive; nothing but they may stand there."""
        x0, y0, x1, y1 = self.bounds
        w = self.profile.lane_width
        along_y = [shapely.box(x - w, y0, x + w, y1) for x in self.xs]
        return shapely.union_all(along_y + [shapely.box(x0, y - w, x1, y + w) for y in self.ys])

    @cached_property
    def ground(self) -> Ground:
        """Road everywhere, and a raised pavement around and under each block."""
        area = shapely.box(*self.bounds).buffer(_BEYOND, join_style="mitre")
        w, inside = self.profile.pavement_width, shapely.box(*self.bounds)
        pavements = [block.buffer(w, join_style="mitre").intersection(inside) for block in self.blocks]
        return Ground(area, tuple(pavements), self.profile.kerb_height, self.slope)

    @property
    def nodes(self) -> tuple[Node, ...]:
        """All crossings."""
        return tuple(itertools.product(range(len(self.xs)), range(len(self.ys))))

    def position(self, node: Node) -> tuple[float, float]:
        """Middle of a crossing, m."""
        return self.xs[node[0]], self.ys[node[1]]

    def neighbours(self, node: Node) -> tuple[Node, ...]:
        """Crossings one block away."""
        i, j = node
        around = ((i + 1, j), (i, j + 1), (i - 1, j), (i, j - 1))
        return tuple((a, b) for a, b in around if 0 <= a < len(self.xs) and 0 <= b < len(self.ys))

    def route(self, nodes: Sequence[Node], speed: float = 8.0) -> Route:
        """Drive from crossing to crossing in the right-hand lane.

        Parameters
        ----------
        nodes : sequence of (int, int)
            Crossings, each a neighbour of the one before; no turning back.
        speed : float
            Speed, m/s.

        Raises
        ------
        SimulationError
            If the crossings are no such path.
        """
        steps = list(itertools.pairwise(nodes))
        if not steps or any(b not in self.neighbours(a) for a, b in steps):
            raise SimulationError(f"route over crossings {list(nodes)}: each must be a neighbour of the one before")
        if any(a == c for (a, _), (_, c) in itertools.pairwise(steps)):
            raise SimulationError(f"route over crossings {list(nodes)}: turns back; drive around a block")
        ahead = [np.subtract(self.position(b), self.position(a)) for a, b in steps]
        # To the right of each leg by half a lane: where two legs meet, both offsets apply unless it goes straight on.
        right = [np.array([d[1], -d[0]]) / np.hypot(*d) * self.profile.lane_width / 2 for d in ahead]
        points = [self.position(nodes[0]) + right[0]]
        for node, (a, b) in zip(nodes[1:-1], itertools.pairwise(right), strict=True):
            if not np.array_equal(a, b):
                points.append(self.position(node) + a + b)
        points.append(self.position(nodes[-1]) + right[-1])
        return Route(tuple((float(x), float(y)) for x, y in points), _TURN, speed, _BODY)

    def _cells(self) -> list[tuple[int, int, tuple[float, float, float, float]]]:
        """Column, row and corners of each block, those at the bounds included."""
        d = self.profile.half_road + self.profile.pavement_width

        def spans(low: float, lines: tuple[float, ...], high: float) -> list[tuple[float, float]]:
            ends = itertools.pairwise([low - d, *lines, high + d])
            return [(a + d, b - d) for a, b in ends]

        x0, y0, x1, y1 = self.bounds
        columns, rows = spans(x0, self.xs, x1), spans(y0, self.ys, y1)
        cells = itertools.product(enumerate(columns), enumerate(rows))
        return [(i, j, (a, c, b, e)) for (i, (a, b)), (j, (c, e)) in cells]
