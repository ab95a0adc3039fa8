"""Barrel: construction barrels, which stand in rows and are moved together."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import shapely

from factorloc.errors import SimulationError
from factorloc.simulation.poles import Pole, PoleKind
from factorloc.simulation.primitives import box, cylinder, joined
from factorloc.simulation.solid import Solid
from factorloc.simulation.world import Surface

__all__ = ["BARREL_FOOT", "Barrel", "barrel_row", "moved"]

BARREL_FOOT = 0.60
"""Diameter of the rubber ring it stands on, m."""

_RISE = 0.08  # m; height of the ring
_BODY = (0.38, 0.92)  # diameter, height of the drum, m


@dataclass(frozen=True)
class Barrel:
    """A drum on a rubber ring.

    Parameters
    ----------
    id : int
        Identity, the same in all sessions of a town.
    x, y, z : float
        Centre of its foot, m.
    """

    id: int
    x: float
    y: float
    z: float = 0.0

    @property
    def pole(self) -> Pole:
        """What a pole detector should find: the drum above its ring."""
        bottom = self.z + _RISE
        return Pole(self.id, PoleKind.BARREL, self.x, self.y, _BODY[0], bottom, bottom + _BODY[1])

    @property
    def footprint(self) -> shapely.Polygon:
        """Where its foot stands, m."""
        footprint: shapely.Polygon = shapely.Point(self.x, self.y).buffer(BARREL_FOOT / 2)
        return footprint

    @property
    def solids(self) -> tuple[Solid, ...]:
        """What it adds to a world."""
        body, height = _BODY
        x, y, z = self.x, self.y, self.z
        # The foot reaches into the ground, so that it may slope.
        parts = [
            cylinder(BARREL_FOOT, _RISE + 0.1, (x, y, z - 0.1)),
            cylinder(body, height, (x, y, z + _RISE)),
            box((0.04, 0.2, 0.08), (x, y, z + _RISE + height)),
        ]
        return (Solid(joined(parts), Surface.BARREL, f"barrel {self.id}"),)


def barrel_row(points: npt.ArrayLike, heights: npt.ArrayLike, first_id: int = 0) -> tuple[Barrel, ...]:
    """Place barrels at points (N, 2) on ground of heights (N,), m, with consecutive identities.

    Raises
    ------
    SimulationError
        If the shapes disagree.
    """
    xy, z = np.asarray(points, np.float64), np.asarray(heights, np.float64)
    if xy.ndim != 2 or xy.shape[1] != 2 or z.shape != xy.shape[:1]:
        raise SimulationError(f"barrels: points {xy.shape}, heights {z.shape}; expected (N, 2) and (N,)")
    rows = zip(xy.tolist(), z.tolist(), strict=True)
    return tuple(Barrel(first_id + k, x, y, height) for k, ((x, y), height) in enumerate(rows))


def moved(row: tuple[Barrel, ...], vector: tuple[float, float, float]) -> tuple[Barrel, ...]:
    """Move all barrels of a row by the same vector, m."""
    dx, dy, dz = vector
    return tuple(replace(b, x=b.x + dx, y=b.y + dy, z=b.z + dz) for b in row)
