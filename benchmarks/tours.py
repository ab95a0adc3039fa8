"""Tours: drives of any length through a floor plan, each by other ways and from another place."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from factorloc.config import Block
from factorloc.errors import SimulationError
from factorloc.simulation import FloorPlan, Route

__all__ = ["Roadmap", "TourSettings"]

Array = npt.NDArray[np.float64]
_BODY = Route(((0.0, 0.0), (1.0, 0.0))).body_radius
Index = npt.NDArray[np.int64]

_STEP = 0.05  # m between points of a leg that are checked, and of the raster they are looked up in


class TourSettings(Block):
    """What tours are like.

    Parameters
    ----------
    places : int
        Places of the roadmap, uniform over what is free.
    clearance : float
        What the body keeps from everything, m.
    legs : (float, float)
        Shortest and longest way between two places, m.
    radius : float
        Of the arcs at places, m.
    sharpest : float
        Sharpest turn at a place, deg.
    survey : float
        A survey passes every place at most so far away, m.

    Raises
    ------
    ConfigError
        If the shortest legs have no room for arcs at both ends.
    """

    places: int = Field(gt=10)
    clearance: float = Field(ge=0)
    legs: tuple[float, float]
    radius: float = Field(gt=0)
    sharpest: float = Field(gt=0, lt=180)
    survey: float = Field(gt=0)

    @model_validator(mode="after")
    def _arcs_have_room(self) -> TourSettings:
        least = 2 * self.radius * np.tan(np.radians(self.sharpest) / 2)
        if not least <= self.legs[0] < self.legs[1]:
            raise ValueError(f"legs {self.legs} m: must increase, from {least:.2f} m at least for the arcs")
        return self


class Roadmap:
    """Places of a floor plan and the ways between them (a probabilistic roadmap), driven forwards only.

    Parameters
    ----------
    plan : FloorPlan
        The surroundings.
    bounds : (float, float)
        It begins at the origin and has this size, m.
    settings : TourSettings
        What tours are like.
    seed : int
        Of the places.

    Raises
    ------
    SimulationError
        If there are hardly any ways.
    """

    def __init__(self, plan: FloorPlan, bounds: tuple[float, float], settings: TourSettings, seed: int) -> None:
        self.settings = settings
        shape = np.rint(np.divide(bounds, _STEP)).astype(np.int64)
        self._raster = plan.clearance(_STEP * np.moveaxis(np.indices(tuple(shape.tolist())), 0, -1))
        rng = np.random.default_rng([seed, 0])
        drawn = rng.uniform(0, 1, (20 * settings.places, 2)) * bounds
        self.places = drawn[self._free(drawn)][: settings.places]
        self.ways = self._legs()
        if len(self.ways) == 0:
            raise SimulationError(
                f"tours: no ways between {len(self.places)} places; allow longer legs or less clearance"
            )
        before, after = self._turns()
        size = len(self.ways)
        lengths = np.linalg.norm(self.places[self.ways[after, 1]] - self.places[self.ways[after, 0]], axis=1)
        self._graph = csr_array((lengths, (before, after)), (size, size))
        _, part = connected_components(self._graph, connection="strong")
        # Ways from which every other one can be reached, and that can be reached from every other one.
        self.usable = np.flatnonzero(part == np.argmax(np.bincount(part)))
        if len(self.usable) < settings.places:
            raise SimulationError(f"tours: {len(self.usable)} ways between {len(self.places)} places; allow more")

    def tour(self, length: float, rng: np.random.Generator) -> Route:
        """Drive from a random place to random others, by the shortest ways, until it is long enough.

        Parameters
        ----------
        length : float
            At least, m.
        rng : numpy.random.Generator
            Source of the places.
        """
        ends = np.unique(self.ways[self.usable, 0])
        first = int(rng.choice(self.usable[self.ways[self.usable, 0] == rng.choice(ends)]))
        way = [first]
        while self._route(way).length < length:
            way += self._shortest(way[-1], int(rng.choice(ends)))
        return self._route(way)

    def survey(self, rng: np.random.Generator) -> Route:
        """Drive until every place has been passed; always on to the one that is farthest from all that was driven."""
        way = [int(rng.choice(self.usable))]
        ends = np.unique(self.ways[self.usable, 1])
        while True:
            seen = self.places[self.ways[way, 1]]
            apart = np.linalg.norm(self.places[ends, None] - seen, axis=-1).min(1)
            if apart.max() <= self.settings.survey:
                return self._route(way)
            way += self._shortest(way[-1], int(ends[np.argmax(apart)]))

    def _free(self, points: Array) -> npt.NDArray[np.bool_]:
        """Whether the body stands free at points (..., 2)."""
        x, y = np.moveaxis(np.rint(points / _STEP).astype(np.int64), -1, 0)
        nearest = self._raster[np.clip(x, 0, len(self._raster) - 1), np.clip(y, 0, len(self._raster[0]) - 1)]
        return np.asarray(nearest > _BODY + self.settings.clearance)

    def _legs(self) -> Index:
        """Pairs of places with a free straight way between them, shape (W, 2)."""
        shortest, longest = self.settings.legs
        apart = np.linalg.norm(self.places[:, None] - self.places, axis=-1)
        pairs = np.argwhere((apart >= shortest) & (apart <= longest))
        shares = np.linspace(0, 1, int(longest / _STEP))
        first, last = self.places[pairs].transpose(1, 0, 2)[:, :, None]
        along = first + shares[:, None] * (last - first)
        return pairs[self._free(along).all(1)]

    def _turns(self) -> tuple[Index, Index]:
        """Pairs of ways that can be driven one after the other: ends meet, and the arc between them is free."""
        order = np.argsort(self.ways[:, 0], kind="stable")
        starts = np.searchsorted(self.ways[order, 0], np.arange(len(self.places) + 1))
        ends = self.ways[:, 1]
        counts = starts[ends + 1] - starts[ends]
        rows = np.repeat(np.arange(len(ends)), counts)
        following = order[np.repeat(starts[ends] - np.cumsum(counts) + counts, counts) + np.arange(counts.sum())]
        unit = np.diff(self.places[self.ways], axis=1)[:, 0]
        unit /= np.linalg.norm(unit, axis=1, keepdims=True)
        turn = np.arccos(np.clip((unit[rows] * unit[following]).sum(1), -1, 1))
        good = turn <= np.radians(self.settings.sharpest)
        rows, following, turn = rows[good], following[good], turn[good]
        # Arcs are least free where they are farthest from the corner they cut.
        inwards = unit[following] - unit[rows]
        inwards /= np.maximum(np.linalg.norm(inwards, axis=1, keepdims=True), 1e-12)
        cut = self.settings.radius * (1 / np.cos(turn / 2) - 1)
        corner = self.places[self.ways[rows, 1]]
        free = self._free(corner + cut[:, None] * inwards)
        return rows[free], following[free]

    def _shortest(self, way: int, place: int) -> list[int]:
        """Ways after one, to a place; none if that ends there."""
        distances, previous = dijkstra(self._graph, indices=np.array([way]), return_predecessors=True)
        arriving = self.usable[self.ways[self.usable, 1] == place]
        at = int(arriving[np.argmin(distances[0, arriving])])
        found: list[int] = []
        while at != way:
            found.append(at)
            at = int(previous[0, at])
        return found[::-1]

    def _route(self, ways: list[int]) -> Route:
        corners = self.places[[*self.ways[ways, 0], self.ways[ways[-1], 1]]]
        return Route(tuple((float(x), float(y)) for x, y in corners), radius=self.settings.radius)
