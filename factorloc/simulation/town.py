"""Town: a grid of streets with all that stays from session to session."""

from __future__ import annotations

import itertools
from collections import deque
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import shapely
from pydantic import Field

from factorloc.config import Block
from factorloc.errors import SimulationError
from factorloc.simulation import furnishing
from factorloc.simulation.buildings import Building
from factorloc.simulation.frontage import Frontage, RowSettings
from factorloc.simulation.furnishing import FurnitureSettings, ParkingPlace, PoleSite
from factorloc.simulation.poles import Pole
from factorloc.simulation.route import Route
from factorloc.simulation.streams import stream
from factorloc.simulation.street_grid import Node, StreetGrid, StreetProfile
from factorloc.simulation.trees import Hedge, Tree

__all__ = ["Town", "TownSettings"]

_OUTSKIRTS = 30.0  # m of built-up area outside of the outermost streets
_STRETCH_MARGIN = 1.0  # m that the bare stretch reaches beyond what will stand in it


class TownSettings(Block):
    """A town of streets at right angles; its south-western crossing is at the origin.

    Parameters
    ----------
    columns, rows_of_blocks : int
        Blocks along x and y.
    block_length, block_depth : float
        Distance of neighbouring streets along x and y, m.
    bare_length : float
        Length of the stretch of one street, along x, that has no poles, trees or parked cars, m.
    profile : StreetProfile
        Cross-section of all streets.
    rows : RowSettings
        Houses.
    furniture : FurnitureSettings
        Poles, trees, hedges and parked cars.
    """

    columns: int = Field(4, ge=1, le=20)
    rows_of_blocks: int = Field(3, ge=1, le=20)
    block_length: float = Field(100.0, ge=90, le=400)
    block_depth: float = Field(100.0, ge=60, le=400)
    bare_length: float = Field(63.0, ge=60)
    profile: StreetProfile = StreetProfile()
    rows: RowSettings = RowSettings()
    furniture: FurnitureSettings = FurnitureSettings()


@dataclass(frozen=True)
class Town:
    """A town, and what never changes in it.

    Parameters
    ----------
    settings : TownSettings
        What it is like.
    seed : int
        Which of all such towns.

    Raises
    ------
    SimulationError
        If no street is long enough for the bare stretch.
    """

    settings: TownSettings = field(default_factory=TownSettings)
    seed: int = 0

    def __post_init__(self) -> None:
        free = self.bare_frontage.length - 2 * furnishing.CORNER
        if self.settings.bare_length > free:
            raise SimulationError(
                f"town: bare_length {self.settings.bare_length} m, but blocks leave {free:.1f} m between corners; "
                "lengthen block_length"
            )

    @cached_property
    def grid(self) -> StreetGrid:
        """Where its streets run."""
        s = self.settings
        xs = tuple(s.block_length * k for k in range(s.columns + 1))
        ys = tuple(s.block_depth * k for k in range(s.rows_of_blocks + 1))
        bounds = (-_OUTSKIRTS, -_OUTSKIRTS, xs[-1] + _OUTSKIRTS, ys[-1] + _OUTSKIRTS)
        return StreetGrid(xs, ys, bounds, s.profile)

    @cached_property
    def bare_frontage(self) -> Frontage:
        """The frontage along the bare stretch: of the streets along x, the one nearest to the middle of the town."""
        x0, y0, x1, y1 = self.grid.bounds
        # It has its street in the south, so that it runs along x.
        candidates = [f for f in self.grid.frontages if f.street is not None and f.heading == 0.0]
        middle = ((x0 + x1) / 2, (y0 + y1) / 2)
        return min(candidates, key=lambda f: float(np.hypot(*(f.points(f.length / 2, 0.0) - middle))))

    @cached_property
    def bare_stretch(self) -> shapely.Polygon:
        """Where no pole, tree or parked car stands, on either side of the street."""
        frontage, profile = self.bare_frontage, self.settings.profile
        half = self.settings.bare_length / 2 + _STRETCH_MARGIN
        across = 2 * (profile.half_road + profile.pavement_width)
        return frontage.rectangle(frontage.length / 2 - half, frontage.length / 2 + half, 0.0, across)

    @cached_property
    def buildings(self) -> tuple[Building, ...]:
        """All houses."""
        return self._houses[0]

    @property
    def hedges(self) -> tuple[Hedge, ...]:
        """All hedges, in summer."""
        return self._houses[1]

    @cached_property
    def trees(self) -> tuple[Tree, ...]:
        """All trees, in summer."""
        return furnishing.trees(self.grid, self.settings.furniture, self.seed, self.bare_stretch)

    @cached_property
    def poles(self) -> tuple[Pole, ...]:
        """The poles that stand from the beginning."""
        sites = furnishing.pole_sites(self.grid, self.settings.furniture, self.seed, self.bare_stretch)
        return tuple(site.pole(stream(self.seed, "pole", site.id)) for site in sites)

    @cached_property
    def spare_sites(self) -> tuple[PoleSite, ...]:
        """Where poles may appear later."""
        return furnishing.spare_sites(self.grid, self.settings.furniture, self.seed, self.bare_stretch)

    @cached_property
    def parking_places(self) -> tuple[ParkingPlace, ...]:
        """Where cars may be parked."""
        return furnishing.parking_places(self.grid, self.bare_stretch)

    def tour(self, length: float, rng: np.random.Generator, speed: float = 8.0) -> Route:
        """Drive through the town, preferring streets that were driven least; past the bare stretch at least once.

        Parameters
        ----------
        length : float
            About how far, m; not less than it takes to pass the bare stretch.
        rng : numpy.random.Generator
            Chooses where to begin and to turn.
        speed : float
            Speed, m/s.
        """
        nodes = self.grid.nodes
        via = self.bare_frontage.street
        assert via is not None  # it was chosen so
        start = nodes[rng.integers(len(nodes))]
        around = self.grid.neighbours(start)
        path = [start, around[rng.integers(len(around))]]
        visits: dict[frozenset[Node], int] = {}
        while (driven := self._count(path, visits)) < length or frozenset(via) not in visits:
            if driven > 0.5 * length and frozenset(via) not in visits:
                path += self._way(path[-2], path[-1], frozenset(via))
                continue
            onwards = [node for node in self.grid.neighbours(path[-1]) if node != path[-2]]
            lots = rng.random(len(onwards))
            wear = [visits.get(frozenset((path[-1], node)), 0) + lot for node, lot in zip(onwards, lots, strict=True)]
            path.append(onwards[int(np.argmin(wear))])
        return self.grid.route(path, speed)

    @cached_property
    def _houses(self) -> tuple[tuple[Building, ...], tuple[Hedge, ...]]:
        return furnishing.houses(self.grid, self.settings.rows, self.settings.furniture.hedge_share, self.seed)

    def _count(self, path: list[Node], visits: dict[frozenset[Node], int]) -> float:
        """Length of a path, m; counts how often each street was driven."""
        visits.clear()
        length = 0.0
        for a, b in itertools.pairwise(path):
            visits[frozenset((a, b))] = visits.get(frozenset((a, b)), 0) + 1
            length += float(np.hypot(*np.subtract(self.grid.position(b), self.grid.position(a))))
        return length

    def _way(self, before: Node, here: Node, street: frozenset[Node]) -> list[Node]:
        """Fewest crossings on from here, without turning back, until a street has been driven."""
        queue: deque[tuple[Node, Node, list[Node]]] = deque([(before, here, [])])
        seen = {(before, here)}
        while queue:
            a, b, way = queue.popleft()
            if way and frozenset((a, b)) == street:
                return way
            for c in self.grid.neighbours(b):
                if c != a and (b, c) not in seen:
                    seen.add((b, c))
                    queue.append((b, c, [*way, c]))
        raise SimulationError("town: its streets do not lead past the bare stretch; add a block")
