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

    def cast(self, origins: npt.ArrayLike, directions: npt.ArrayLike, rng: np.random.Generator) -> Hits:
        """Send rays from origins (..., D) along unit directions (..., D), which broadcast."""
        ...

    def clearance(self, points: npt.ArrayLike) -> Array:
        """Distance from points (..., D) to the nearest thing a vehicle can touch, m; 0 inside of it."""
        ...
