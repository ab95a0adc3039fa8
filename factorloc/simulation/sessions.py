"""Session: a town in one of many months; poles, cars and leaves change from one to the next."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc.config import Block
from factorloc.errors import SimulationError
from factorloc.simulation.barrels import BARREL_FOOT, Barrel, barrel_row, moved
from factorloc.simulation.furnishing import BARREL_IDS
from factorloc.simulation.mesh_world import MeshWorld
from factorloc.simulation.poles import Pole
from factorloc.simulation.route import Route
from factorloc.simulation.scene import Scene
from factorloc.simulation.streams import stream
from factorloc.simulation.town import Town
from factorloc.simulation.traffic import Traffic
from factorloc.simulation.vehicles import Vehicle

__all__ = ["Session", "SessionSettings", "Sessions"]

Array = npt.NDArray[np.float64]

_APPEARED_IDS = 100_000_000  # identities of poles of session k begin at k times this
_BARREL_LINE = 1.6  # m from the building line to the barrels at first: moved by 3 m they are beside the lanes


class SessionSettings(Block):
    """What changes from session to session.

    Parameters
    ----------
    first_month : float
        Time of the year of session 0; 0 is the first of January.
    months_between : float
        Time between two sessions, months.
    vanish_rate : float
        Probability of a pole to vanish from one session to the next.
    appear_rate : float
        Mean number of poles that appear from one session to the next, per pole that stood at the beginning.
    parking_turnover : float
        Share of parking places where cars have come or gone between two sessions.
    barrels_from, barrels_moved : int
        Session in which the construction barrels are set up, and in which they are found moved.
    barrel_spacing : float
        Distance between barrels, m.
    barrel_shift : float
        How far all of them are moved towards the street, m.
    survey_length, route_length : float
        About how far session 0 drives, and all others, m.
    speed : float
        Speed of the driven car, m/s.
    moving_cars, pedestrians : int
        How many others are on the way; fewer where the streets have no room for them.
    """

    first_month: float = Field(5.0, ge=0, lt=12)
    months_between: float = Field(1.0, gt=0)
    vanish_rate: float = Field(0.02, ge=0, le=1)
    appear_rate: float = Field(0.02, ge=0, le=1)
    parking_turnover: float = Field(0.8, ge=0, le=1)
    barrels_from: int = Field(1, ge=0)
    barrels_moved: int = Field(3, ge=0)
    barrel_spacing: float = Field(3.0, ge=1, le=10)
    barrel_shift: float = Field(3.0, gt=0, le=3.2)
    survey_length: float = Field(3500.0, gt=0)
    route_length: float = Field(1200.0, gt=0)
    speed: float = Field(8.0, gt=0)
    moving_cars: int = Field(6, ge=0)
    pedestrians: int = Field(20, ge=0)


@dataclass(frozen=True)
class Session:
    """One drive through a town as it is at the time.

    Parameters
    ----------
    number : int
        Which of the sessions.
    month : float
        Time of the year, 0 to 12 months.
    scene : Scene
        What stands where.
    route : Route
        What is driven.
    """

    number: int
    month: float
    scene: Scene
    route: Route

    @property
    def world(self) -> MeshWorld:
        """The world a lidar sees."""
        return self.scene.world

    @property
    def poles(self) -> tuple[Pole, ...]:
        """All true poles that are present, trunks and barrels included, by identity."""
        return self.scene.true_poles


@dataclass(frozen=True)
class Sessions:
    """All sessions of a town; each follows from settings and seed alone, whichever others were asked for.

    Parameters
    ----------
    town : Town
        Where they are driven.
    settings : SessionSettings
        What changes.

    Raises
    ------
    SimulationError
        If the barrels were moved into the lanes.
    """

    town: Town
    settings: SessionSettings = field(default_factory=SessionSettings)

    def __post_init__(self) -> None:
        profile = self.town.settings.profile
        reach = _BARREL_LINE + self.settings.barrel_shift + BARREL_FOOT / 2
        if reach > profile.pavement_width + profile.parking_width:
            raise SimulationError(
                f"sessions: barrel_shift {self.settings.barrel_shift} m moves barrels into the lanes; lower it or "
                "widen pavements"
            )

    def session(self, number: int) -> Session:
        """Build a session.

        Parameters
        ----------
        number : int
            Which, from 0 on.

        Raises
        ------
        SimulationError
            If the number is negative.
        """
        if number < 0:
            raise SimulationError(f"session {number}: negative; count from 0")
        s, town = self.settings, self.town
        month = (s.first_month + number * s.months_between) % 12.0
        length = s.survey_length if number == 0 else s.route_length
        route = town.tour(length, self._stream("route", number), s.speed)
        traffic = Traffic(town.grid, route)
        moving = traffic.cars(s.moving_cars, lambda n: self._stream("moving car", number, n))
        people = traffic.people(s.pedestrians, lambda n: self._stream("pedestrian", number, n))
        scene = Scene(
            ground=town.grid.ground,
            buildings=town.buildings,
            hedges=tuple(hedge.at(month) for hedge in town.hedges),
            trees=tuple(tree.at(month) for tree in town.trees),
            poles=self._poles(number),
            barrels=self._barrels(number),
            vehicles=self._parked(number) + moving,
            pedestrians=people,
        )
        return Session(number, month, scene, route)

    @property
    def barrel_vector(self) -> tuple[float, float, float]:
        """By what all barrels are moved, m: sideways and down the kerb."""
        frontage, profile = self.town.bare_frontage, self.town.settings.profile
        dx, dy = (self.settings.barrel_shift * frontage.outwards).tolist()
        falls = _BARREL_LINE + self.settings.barrel_shift > profile.pavement_width
        return dx, dy, -profile.kerb_height if falls else 0.0

    @cached_property
    def _row(self) -> tuple[Barrel, ...]:
        frontage, length = self.town.bare_frontage, self.town.settings.bare_length
        along = self.settings.barrel_spacing * np.arange(int(length / self.settings.barrel_spacing + 1e-9) + 1)
        points = frontage.points(along + (frontage.length - along[-1]) / 2, _BARREL_LINE)
        return barrel_row(points, self.town.grid.ground.elevation(points), BARREL_IDS)

    def _barrels(self, number: int) -> tuple[Barrel, ...]:
        if number < self.settings.barrels_from:
            return ()
        return self._row if number < self.settings.barrels_moved else moved(self._row, self.barrel_vector)

    def _poles(self, number: int) -> tuple[Pole, ...]:
        first, spares = self.town.poles, self.town.spare_sites
        stands: list[Pole | None] = [*first, *(None for _ in spares)]
        appear = min(self.settings.appear_rate * len(first) / max(len(spares), 1), 1.0)
        for k in range(1, number + 1):
            vanish_lots, appear_lots = self._stream("pole changes", k).random((2, len(stands)))
            for n, pole in enumerate(stands):
                if pole is not None:
                    stands[n] = None if vanish_lots[n] < self.settings.vanish_rate else pole
                elif n >= len(first) and appear_lots[n] < appear:
                    site = spares[n - len(first)]
                    stands[n] = site.pole(self._stream("new pole", k, site.id), _APPEARED_IDS * k + site.id)
        return tuple(pole for pole in stands if pole is not None)

    def _parked(self, number: int) -> tuple[Vehicle, ...]:
        places = self.town.parking_places
        since = np.zeros(len(places), np.int64)
        taken = np.zeros(len(places), np.bool_)
        for k in range(number + 1):
            changes, occupied = self._stream("parked", k).random((2, len(places)))
            changed = (changes < self.settings.parking_turnover) | (k == 0)
            since[changed] = k
            taken[changed] = occupied[changed] < self.town.settings.furniture.parked_share
        ground = self.town.grid.ground
        parked = np.flatnonzero(taken).tolist()
        return tuple(places[n].car(ground, self._stream("parked car", int(since[n]), n)) for n in parked)

    def _stream(self, *path: str | int) -> np.random.Generator:
        return stream(self.town.seed, "sessions", *path)
