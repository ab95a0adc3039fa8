"""Building: a footprint raised to walls, with facades towards the open."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely

from factorloc.errors import SimulationError
from factorloc.simulation.facades import Facade, FacadeSettings, openings_of, ornaments, wall_triangles
from factorloc.simulation.primitives import joined, triangulated, welded
from factorloc.simulation.solid import Solid
from factorloc.simulation.world import Surface

if TYPE_CHECKING:
    import trimesh

__all__ = ["Building", "building"]

_FOUNDATION = 1.0  # m; walls reach below the ground, so that it may slope
_LOOK = 3.0  # m; how far before a wall one stands to see it


@dataclass(frozen=True)
class Building:
    """A building with exact truth.

    Parameters
    ----------
    footprint : shapely.Polygon
        Outline of its walls, m.
    mesh : trimesh.Trimesh
        Its surface, in closed parts, m.
    facades : tuple of Facade
        Its outer walls that face the open, with windows.
    name : str
        What it is called.
    """

    footprint: shapely.Polygon
    mesh: trimesh.Trimesh
    facades: tuple[Facade, ...]
    name: str = ""

    @property
    def solids(self) -> tuple[Solid, ...]:
        """What it adds to a world."""
        return (Solid(self.mesh, Surface.FACADE, self.name),)


def building(
    footprint: shapely.Polygon,
    height: float,
    rng: np.random.Generator,
    settings: FacadeSettings | None = None,
    bottom: float = 0.0,
    open_space: shapely.Geometry | None = None,
    name: str = "",
) -> Building:
    """Raise a building with a flat roof.

    Parameters
    ----------
    footprint : shapely.Polygon
        Outline of its walls, m; courtyards have plain walls.
    height : float
        Height of the roof above the bottom, m.
    rng : numpy.random.Generator
        Chooses doors and balconies.
    settings : FacadeSettings, optional
        How its facades are built.
    bottom : float
        Height of the ground, m; the walls reach 1 m deeper.
    open_space : shapely.Geometry, optional
        Where facades are seen from: a wall has windows if the point 3 m before its middle lies there. All outer walls
        have them by default.
    name : str
        What it is called.

    Raises
    ------
    SimulationError
        If the footprint is empty or not valid, or the height is not positive.
    """
    settings = settings or FacadeSettings()
    if not 0 < height < np.inf:
        raise SimulationError(f"building {name!r}: height {height} m; must be positive and finite")
    points, triangles, rings = triangulated(footprint)
    low, high = bottom - _FOUNDATION, bottom + height
    corners = np.concatenate([np.column_stack([points, np.full(len(points), z)]) for z in (low, high)])
    parts = [corners[triangles[:, ::-1]], corners[triangles + len(points)]]
    facades, mounted = [], []
    for number, ring in enumerate(rings):
        ends = zip(points[ring].tolist(), points[np.roll(ring, -1)].tolist(), strict=True)
        for facade in (Facade((a, b), (c, d), low, high) for (a, b), (c, d) in ends):
            is_seen = number == 0 and _is_seen(facade, open_space)
            openings = openings_of(facade, bottom, settings, rng) if is_seen else np.zeros((0, 4))
            parts.append(wall_triangles(facade, openings, settings.recess))
            if is_seen:
                facades.append(facade)
            if len(openings):
                mounted.append(ornaments(facade, openings, bottom, settings, rng))
    body = welded(np.concatenate(parts))
    return Building(footprint, joined([body, *mounted]), tuple(facades), name)


def _is_seen(facade: Facade, open_space: shapely.Geometry | None) -> bool:
    if open_space is None:
        return True
    x, y, _ = facade.world_points([facade.length / 2, 0.0, _LOOK])
    return bool(shapely.intersects_xy(open_space, x, y))
