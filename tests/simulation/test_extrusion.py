"""Extrusion: outlines of any map become a world."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from factorloc.errors import SimulationError
from factorloc.mapping import BuildingOutlines, Outline
from factorloc.simulation import extrude


def outlines(*rows: tuple[float, float | None]) -> BuildingOutlines:
    """Houses of 15 m x 20 m that begin at x, with their heights."""
    return BuildingOutlines(tuple(Outline(shapely.box(x, 0, x + 15, 20), height) for x, height in rows), source="row")


def test_they_are_extruded_into_a_world() -> None:
    # Two houses that share a wall, and one apart; a part inside the first one tells how high it is.
    part = Outline(shapely.box(2, 2, 8, 8), 12.0, is_part=True)
    row = outlines((0, None), (15, None), (60, 20.0))
    scene = extrude(BuildingOutlines((*row.outlines, part)), seed=4)
    assert [len(b.facades) for b in scene.buildings] == [3, 3, 4]
    # Rays from above end on roofs and on the ground.
    centres = [b.footprint.centroid for b in scene.buildings]
    origins = np.array([(c.x, c.y, 50) for c in centres] + [(centres[2].x - 25, centres[2].y, 50)])
    ranges = scene.world.cast(origins, np.array([0, 0, -1.0]), None).ranges
    assert ranges == pytest.approx([38, 41, 30, 50])
    assert all(b.mesh.is_watertight for b in scene.buildings)


def test_courtyards_stay_open() -> None:
    court = shapely.box(0, 0, 40, 40).difference(shapely.box(10, 10, 30, 30))
    world = extrude(BuildingOutlines((Outline(court),)), default_height=8.0).world
    ranges = world.cast(np.array([(20.0, 20, 50), (5, 20, 50)]), np.array([0, 0, -1.0]), None).ranges
    assert ranges == pytest.approx([50, 42])


def test_nothing_is_not_extruded() -> None:
    with pytest.raises(SimulationError, match="no building"):
        extrude(BuildingOutlines(()))
    with pytest.raises(SimulationError, match="default_height"):
        extrude(outlines((0, None)), default_height=0)
