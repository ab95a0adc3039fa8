"""World: what a simulated lidar asks of its surroundings, in the plane and in space."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

__all__ = ["Hits", "Surface", "World"]

Array = npt.NDArray[np.float64]


class Surface(enum.IntEnum):
    """What reflected a ray."""

    NOTHING = 0
    """It left the world."""
    WALL = 1
    """An opaque surface."""
    GLASS = 2
    """A pane, which reflects with some probability."""
    FOLIAGE = 3
    """A semi-transparent region, in which free paths are exponentially distributed."""
    GROUND = 4
    """Road, pavement, lawn: what a vehicle stands on."""
    FACADE = 5
    """Outside of a building."""
    POLE = 6
    """Lamp post, traffic sign, traffic light."""
    TRUNK = 7
    """Stem of a tree."""
    HEDGE = 8
    """Clipped greenery, as good as opaque."""
    VEHICLE = 9
    """Car, bus or lorry, parked or driving."""
    PEDESTRIAN = 10
    """Somebody on foot."""
    BARREL = 11
    """Waste bin, bollard, hydrant: a low cylinder."""
    FENCE = 12
    """Fence, railing or barrier."""
    FURNITURE = 13
    """Bench, letter box, cabinet, bus shelter: anything else that stands in a street."""


@dataclass(frozen=True)
class Hits:
    """Where rays end, and on what.

    Parameters
    ----------
    ranges : ndarray, shape (...)
        Exact distance from origin to reflection, m; infinite for a ray that leaves the world.
    surfaces : ndarray of uint8, shape (...)
        :class:`Surface` of each reflection.
    """

    ranges: Array
    surfaces: npt.NDArray[np.uint8]


class World(Protocol):
    """Surroundings of known geometry.

    Shapes are given for D dimensions, 2 or 3; all coordinates are in the world frame, in metres.
    """

    @property
    def dimension(self) -> int:
        """2 or 3."""
        ...

    def cast(
        self,
        origins: npt.ArrayLike,
        directions: npt.ArrayLike,
        rng: np.random.Generator | None,
        times: npt.ArrayLike | None = None,
    ) -> Hits:
        """Send rays from origins (..., D) along unit directions (..., D) at times (...), s, which broadcast.

        Without a generator, rays pass whatever is not opaque. What moves is where it is at the time of the ray, 0 by
        default; a world at rest takes no notice of times.
        """
        ...

    def clearance(self, points: npt.ArrayLike) -> Array:
        """Distance from points (..., D) to the nearest thing a vehicle can touch, m; 0 inside of it."""
        ...
