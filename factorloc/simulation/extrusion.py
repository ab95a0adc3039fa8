"""Extrusion: the world above the outlines of buildings, of any map a reader knows."""

from __future__ import annotations

import math

import shapely

from factorloc.errors import SimulationError
from factorloc.mapping import BuildingOutlines
from factorloc.simulation.buildings import building
from factorloc.simulation.facades import FacadeSettings
from factorloc.simulation.ground import Ground
from factorloc.simulation.scene import Scene
from factorloc.simulation.streams import stream

__all__ = ["extrude"]

_ROOM = 30.0  # m of ground around the outermost building


def extrude(
    buildings: BuildingOutlines, default_height: float = 9.0, facade: FacadeSettings | None = None, seed: int = 0
) -> Scene:
    """Raise buildings to their heights; walls have windows wherever nothing stands close before them.

    Outlines inside others are left out first, as parts of buildings mostly are.

    Parameters
    ----------
    buildings : BuildingOutlines
        What a reader found, for example ``factorloc.datasets.read_buildings("map.osm")``.
    default_height : float
        Height of buildings that have none, m.
    facade : FacadeSettings, optional
        How facades are built.
    seed : int
        Chooses doors and balconies, for each building on its own.

    Raises
    ------
    SimulationError
        If there is no building, or the default height is not positive.
    """
    if not 0 < default_height < math.inf:
        raise SimulationError(f"default_height: {default_height} m; must be positive and finite")
    whole = buildings.whole().outlines
    if not whole:
        raise SimulationError(f"{buildings.source or 'outlines'}: no building to extrude")
    outlines = shapely.union_all([outline.polygon for outline in whole])
    x0, y0, x1, y1 = outlines.bounds
    area = shapely.box(x0 - _ROOM, y0 - _ROOM, x1 + _ROOM, y1 + _ROOM)
    open_space = area.difference(outlines)
    shapely.prepare(open_space)
    raised = (
        building(
            outline.polygon,
            default_height if outline.height is None else outline.height,
            stream(seed, "house", n),
            facade,
            0.0,
            open_space,
            outline.name or f"house {n}",
        )
        for n, outline in enumerate(whole)
    )
    return Scene(Ground(area), tuple(raised))
