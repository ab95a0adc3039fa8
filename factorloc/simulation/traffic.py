"""Traffic: cars and people on their way, who meet neither the driven car nor one another."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from factorloc.simulation.route import Route
from factorloc.simulation.street_grid import StreetGrid
from factorloc.simulation.vehicles import Pedestrian, Vehicle

__all__ = ["Traffic"]

Array = npt.NDArray[np.float64]

_STEP = 0.25  # s between the times at which distances are compared
_CAR, _PERSON = 3.0, 0.6  # m of room about the middle of each
_WALK = 0.8  # m from the building line to where people walk
_TRIES = 20  # attempts to find somebody who meets nobody


class Traffic:
    """Others on the way during one drive, at constant velocities.

    Parameters
    ----------
    grid : StreetGrid
        Where they go.
    route : Route
        The drive they keep clear of.
    """

    def __init__(self, grid: StreetGrid, route: Route) -> None:
        self._grid = grid
        self._times = np.arange(0.0, route.duration + _STEP, _STEP)
        driven = route.poses_at(np.minimum(self._times * route.speed, route.length))[:, :2]
        self._tracks: list[tuple[Array, float]] = [(driven, _CAR)]

    def cars(self, count: int, rng_of: Callable[[int], np.random.Generator]) -> tuple[Vehicle, ...]:
        """Add cars in the right-hand lanes, straight through the town; one that finds no room is left out.

        Parameters
        ----------
        count : int
            How many to try.
        rng_of : callable
            Returns the random stream of each.
        """
        cars = []
        for rng in map(rng_of, range(count)):
            for car in (self._car(rng) for _ in range(_TRIES)):
                if self._joins((car.x, car.y), car.velocity, _CAR):
                    cars.append(car)
                    break
        return tuple(cars)

    def people(self, count: int, rng_of: Callable[[int], np.random.Generator]) -> tuple[Pedestrian, ...]:
        """Add people who walk along houses; see :meth:`cars`."""
        people = []
        for rng in map(rng_of, range(count)):
            for person in (self._person(rng) for _ in range(_TRIES)):
                if self._joins((person.x, person.y), person.velocity, _PERSON):
                    people.append(person)
                    break
        return tuple(people)

    def _car(self, rng: np.random.Generator) -> Vehicle:
        grid = self._grid
        x0, y0, x1, y1 = grid.bounds
        along_x, direction = rng.random() < 0.5, float(rng.choice([-1.0, 1.0]))
        lines, low, high = (grid.ys, x0, x1) if along_x else (grid.xs, y0, y1)
        line, start = float(rng.choice(lines)), float(rng.uniform(low, high))
        # They keep to the right: going along x that is -y, along y it is +x.
        side = direction * grid.profile.lane_width / 2
        position, yaw = ((start, line - side), 0.0) if along_x else ((line + side, start), np.pi / 2)
        yaw += 0.0 if direction > 0 else np.pi
        z = float(grid.ground.elevation(position))
        return Vehicle.drawn(position, z, yaw, rng, float(rng.uniform(5.0, 11.0)))

    def _person(self, rng: np.random.Generator) -> Pedestrian:
        frontage = self._grid.frontages[rng.integers(len(self._grid.frontages))]
        x, y = frontage.points(rng.uniform(0, frontage.length), _WALK).tolist()
        yaw = frontage.heading + (np.pi if rng.random() < 0.5 else 0.0)
        z = float(self._grid.ground.elevation((x, y)))
        return Pedestrian(x, y, z, yaw, float(rng.uniform(1.5, 1.95)), float(rng.uniform(0.9, 1.6)))

    def _joins(self, start: tuple[float, float], velocity: tuple[float, float, float], room: float) -> bool:
        track = np.array(start) + self._times[:, None] * np.array(velocity[:2])
        is_free = all(np.hypot(*(track - other).T).min() > room + taken for other, taken in self._tracks)
        if is_free:
            self._tracks.append((track, room))
        return is_free
