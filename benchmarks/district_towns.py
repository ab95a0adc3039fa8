"""Towns of generated footprints, turned by any angle."""

from __future__ import annotations

import math

import shapely
import shapely.affinity

from benchmarks.district_settings import TownShape
from benchmarks.district_streets import Streets
from factorloc.mapping import BuildingOutlines, Outline
from factorloc.simulation import Town, TownSettings
from factorloc.simulation.streams import stream

__all__ = ["turned_town"]


def turned_town(shape: TownShape, seed: int) -> tuple[BuildingOutlines, Streets]:
    """Footprints and streets of a generated town, turned."""
    town = Town(
        TownSettings(
            columns=shape.blocks,
            rows_of_blocks=shape.blocks,
            block_length=shape.block_length,
            block_depth=shape.block_depth,
        ),
        seed,
    )
    angle = float(stream(seed, "turn of the town").uniform(-math.pi, math.pi))

    def turned(shape: shapely.Geometry) -> shapely.Geometry:
        return shapely.affinity.rotate(shape, angle, origin=(0, 0), use_radians=True)

    outlines = tuple(
        Outline(turned(house.footprint), float(house.mesh.bounds[1, 2]), house.name) for house in town.buildings
    )
    x0, y0, x1, y1 = town.grid.bounds
    lines = [shapely.LineString([(x, y0), (x, y1)]) for x in town.grid.xs]
    lines += [shapely.LineString([(x0, y), (x1, y)]) for y in town.grid.ys]
    streets = Streets.within([turned(line) for line in lines], turned(shapely.box(x0, y0, x1, y1)))
    return BuildingOutlines(outlines, source=f"town {seed}"), streets
