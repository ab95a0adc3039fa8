import json

import numpy as np
import pyproj
import pytest
import shapely

from factorloc.errors import DataError, FactorlocWarning, SimulationError
from factorloc.simulation.footprints import read_footprints

LON, LAT = 8.42, 49.01


def square(size_deg=2e-4, lon=LON, lat=LAT):
    a = size_deg
    return [[[lon, lat], [lon + a, lat], [lon + a, lat + a], [lon, lat + a], [lon, lat]]]


def feature(coordinates, kind="Polygon", **properties):
    return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}


def write(tmp_path, features, **members):
    path = tmp_path / "houses.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features, **members}))
    return path


def test_geographic_outlines_become_metres(tmp_path):
    path = write(tmp_path, [feature(square(), name="hall"), feature(square(lon=LON + 4e-4))])
    places = read_footprints(path)
    hall, other = places.buildings
    geod = pyproj.Geod(ellps="WGS84")
    area, _ = geod.geometry_area_perimeter(shapely.Polygon(square()[0]))
    assert hall.name == "hall"
    assert hall.polygon.area == pytest.approx(area, rel=1e-6)
    _, _, apart = geod.inv(LON, LAT, LON + 4e-4, LAT)
    corners = [np.array(f.polygon.exterior.coords[0]) for f in (hall, other)]
    assert corners[1] - corners[0] == pytest.approx([apart, 0], abs=1e-4)
    assert places.crs == "EPSG:4326"
    assert places.origin == pytest.approx((LON + 3e-4, LAT + 1e-4))
    north_east = read_footprints(path, origin=(LON, LAT)).buildings[0].polygon
    assert north_east.bounds[:2] == pytest.approx((0, 0), abs=1e-4)


@pytest.mark.parametrize(
    ("properties", "height"),
    [
        ({"height": 12.5}, 12.5),
        ({"height": "14 m", "building:levels": 2}, 14),
        ({"building:levels": "4"}, 12),
        ({"height": "tall", "building:levels": 3}, 9),
        ({"height": -3}, 7.5),
        ({"height": None}, 7.5),
        ({}, 7.5),
    ],
)
def test_heights_come_from_properties(tmp_path, properties, height):
    path = write(tmp_path, [feature(square(), **properties)])
    assert read_footprints(path, default_height=7.5).buildings[0].height == height


def test_metric_systems_are_only_shifted(tmp_path):
    ring = [[[450000, 5430000], [450020, 5430000], [450020, 5430010], [450000, 5430010], [450000, 5430000]]]
    utm = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::25832"}}
    places = read_footprints(write(tmp_path, [feature(ring)], crs=utm))
    assert places.origin == (450010, 5430005)
    assert places.buildings[0].polygon.bounds == (-10, -5, 10, 5)
    with pytest.raises(DataError, match="no longitudes"):
        read_footprints(write(tmp_path, [feature(ring)]))


def test_what_is_left_out_or_mended_is_counted(tmp_path):
    bow = [[[LON, LAT], [LON + 1e-4, LAT + 1e-4], [LON + 1e-4, LAT], [LON, LAT + 1e-4], [LON, LAT]]]
    path = write(tmp_path, [feature(square()), feature([LON, LAT], "Point"), {"type": "Feature"}, feature(bow)])
    with pytest.warns(FactorlocWarning, match="left out 2 features that are no polygons, mended 1 crossing"):
        places = read_footprints(path)
    assert len(places.buildings) == 3
    assert all(f.polygon.is_valid for f in places.buildings)


def test_courtyards_and_many_parts_are_kept(tmp_path):
    outer, hole = square(4e-4)[0], square(1e-4, LON + 1e-4, LAT + 1e-4)[0]
    path = write(tmp_path, [feature([[outer, hole[::-1]], square(lon=LON + 1e-3)], "MultiPolygon", height=10)])
    court, other = read_footprints(path).buildings
    assert len(court.polygon.interiors) == 1
    assert other.height == court.height == 10


def test_they_are_extruded_into_a_world(tmp_path):
    # Two houses that share a wall, and one apart.
    rows = [
        feature(square(height := 2e-4)),
        feature(square(lon=LON + height)),
        feature(square(lon=LON + 8e-4), height=20),
    ]
    places = read_footprints(write(tmp_path, rows))
    scene = places.scene(seed=4)
    assert [len(b.facades) for b in scene.buildings] == [3, 3, 4]
    world = scene.world
    # Rays from above end on roofs, 9 and 20 m high, and on the ground.
    centres = [f.polygon.centroid for f in places.buildings]
    origins = np.array([(c.x, c.y, 50) for c in centres] + [(centres[2].x - 25, centres[2].y, 50)])
    ranges = world.cast(origins, np.array([0, 0, -1.0]), None).ranges
    assert ranges == pytest.approx([41, 41, 30, 50])
    assert all(b.mesh.is_watertight for b in scene.buildings)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not GeoJSON"),
        ("[1]", "not GeoJSON"),
        ('{"type": "FeatureCollection"}', "no list"),
        ('{"type": "FeatureCollection", "features": [3]}', "feature 0 is no object"),
        ('{"type": "FeatureCollection", "features": []}', "no building outline"),
        ('{"type": "Polygon", "coordinates": [[[0, 0], [1, 1]]]}', "coordinates of feature 0"),
        ('{"type": "Polygon", "coordinates": "here"}', "coordinates of feature 0"),
        ('{"type": "Polygon"}', "coordinates of feature 0"),
        ('{"type": "Polygon", "coordinates": [[[0, 0], [NaN, 1], [1, 1], [0, 0]]]}', "coordinates of feature 0"),
        ('{"type": "Polygon", "coordinates": [[[0, 0], [9, 0], [9, 9], [0, 0]]]}', "100 km"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path, text, message):
    path = tmp_path / "bad.geojson"
    path.write_text(text)
    with pytest.raises(DataError, match=message) as error:
        read_footprints(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_other_faults_are_named(tmp_path):
    with pytest.raises(DataError, match="cannot be read"):
        read_footprints(tmp_path / "none.geojson")
    with pytest.raises(DataError, match="unknown"):
        read_footprints(write(tmp_path, [feature(square())], crs={"properties": {"name": "EPSG:99999"}}))
    with pytest.raises(DataError, match="names no coordinate system"):
        read_footprints(write(tmp_path, [feature(square())], crs="here"))
    with pytest.raises(SimulationError, match="default_height"):
        read_footprints(write(tmp_path, [feature(square())]), default_height=0)
