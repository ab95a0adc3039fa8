"""Extrusion: outlines of any map become a world."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import shapely

from factorloc.datasets import read_buildings
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


NODES = "".join(
    f'<node id="{k + 1}" version="1" lon="{8.4 + 3e-4 * (k in (1, 2)):.4f}" lat="{49 + 1e-4 * (k > 1):.4f}"/>'
    for k in range(4)
)
WAY = "".join(f'<nd ref="{k}"/>' for k in (1, 2, 3, 4, 1))
TAGS = '<tag k="building" v="yes"/><tag k="height" v="11"/>'
OSM = f'<osm version="0.6">{NODES}<way id="1" version="1">{WAY}{TAGS}</way></osm>'
RING = [[8.4, 49.0], [8.4003, 49.0], [8.4003, 49.0001], [8.4, 49.0001], [8.4, 49.0]]
GEOJSON = {"type": "Feature", "properties": {"height": 11}, "geometry": {"type": "Polygon", "coordinates": [RING]}}
FLOOR = [(0, 0, 0), (22, 0, 0), (22, 11, 0), (0, 11, 0)]
CITY = {
    "type": "CityJSON",
    "metadata": {"referenceSystem": "EPSG:25832"},
    "vertices": [(460_000 + x, 5_430_000 + y, z) for x, y, z in FLOOR],
    "CityObjects": {
        "hall": {
            "type": "Building",
            "attributes": {"measuredHeight": 11},
            "geometry": [{"type": "MultiSurface", "lod": "1", "boundaries": [[[0, 1, 2, 3]]]}],
        }
    },
}


@pytest.mark.parametrize(
    ("name", "text"),
    [("map.osm", OSM), ("map.geojson", json.dumps(GEOJSON)), ("map.city.json", json.dumps(CITY))],
)
def test_maps_of_any_format_become_worlds(tmp_path: Path, name: str, text: str) -> None:
    pytest.importorskip("osmium")
    (tmp_path / name).write_text(text)
    scene = extrude(read_buildings(tmp_path / name))
    (house,) = scene.buildings
    assert house.footprint.area == pytest.approx(242, rel=0.02)
    assert house.mesh.bounds[1, 2] == pytest.approx(11, abs=0.5)  # a cornice apart
    ahead = scene.world.cast(np.array([[0.0, -20, 2]]), np.array([0, 1.0, 0]), None).ranges
    assert ahead == pytest.approx([20 - 11 / 2], abs=0.4)


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
