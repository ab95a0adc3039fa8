"""GeoJSON, GeoPackage and Shapefile: metres, heights, and one line for each fault."""

from __future__ import annotations

import json
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest
import shapely

from factorloc.datasets import read_buildings
from factorloc.errors import DataError, FactorlocWarning, MissingLibraryError

pyogrio = pytest.importorskip("pyogrio")

LON, LAT = 8.42, 49.01


def square(size: float = 2e-4, lon: float = LON, lat: float = LAT) -> list[list[list[float]]]:
    a = size
    return [[[lon, lat], [lon + a, lat], [lon + a, lat + a], [lon, lat + a], [lon, lat]]]


def feature(coordinates: Any, kind: str = "Polygon", **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}


def write(folder: Path, features: list[Any], **members: Any) -> Path:
    path = folder / "houses.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features, **members}))
    return path


def test_geographic_outlines_become_metres(tmp_path: Path) -> None:
    path = write(tmp_path, [feature(square(), name="hall"), feature(square(lon=LON + 4e-4))])
    places = read_buildings(path)
    hall, other = places.outlines
    geod = pyproj.Geod(ellps="WGS84")
    area, _ = geod.geometry_area_perimeter(shapely.Polygon(square()[0]))
    assert hall.name == "hall"
    assert hall.polygon.area == pytest.approx(area, rel=1e-6)
    _, _, apart = geod.inv(LON, LAT, LON + 4e-4, LAT)
    corners = [np.array(f.polygon.exterior.coords[0]) for f in (hall, other)]
    assert corners[1] - corners[0] == pytest.approx([apart, 0], abs=1e-4)
    assert places.frame is not None
    assert (places.frame.longitude, places.frame.latitude) == pytest.approx((LON + 3e-4, LAT + 1e-4))
    assert places.frame.accuracy == 0
    north_east = read_buildings(path, origin=(LON, LAT)).outlines[0].polygon
    assert north_east.bounds[:2] == pytest.approx((0, 0), abs=1e-4)


@pytest.mark.parametrize(
    ("properties", "height"),
    [
        ({"height": 12.5}, 12.5),
        ({"height": "14 m", "building:levels": 2}, 14),
        ({"building:levels": "4"}, 12),
        ({"height": "tall", "building:levels": 3}, 9),
        ({"height": -3}, None),
        ({"height": None}, None),
        ({}, None),
    ],
)
def test_heights_come_from_properties(tmp_path: Path, properties: dict[str, Any], height: float | None) -> None:
    assert read_buildings(write(tmp_path, [feature(square(), **properties)])).outlines[0].height == height


@pytest.mark.parametrize(("ending", "driver"), [(".gpkg", "GPKG"), (".shp", "ESRI Shapefile"), (".geojson", "GeoJSON")])
def test_metric_systems_become_true_to_scale(tmp_path: Path, ending: str, driver: str) -> None:
    """20 m of the ground are 20 m in the frame, though the grid of UTM shortens them by 0.04 %."""
    path = tmp_path / f"houses{ending}"
    house = shapely.box(500000, 5430000, 500020, 5430010)
    pyogrio.raw.write(
        path, shapely.to_wkb(np.array([house])), [np.array([7.5])], ["height"],
        geometry_type="Polygon", crs="EPSG:25832", driver=driver,
    )  # fmt: skip
    places = read_buildings(path, datum="file")
    (found,) = places.outlines
    assert found.height == 7.5
    assert found.polygon.area == pytest.approx(200 / 0.9996**2, rel=1e-5)
    assert places.frame is not None
    assert places.frame.accuracy == 0
    moved = read_buildings(path)
    assert moved.frame is not None
    if driver != "GeoJSON":  # which is always in WGS 84
        assert moved.frame.accuracy == 1.0
        assert "to 1 m" in str(moved)


def test_what_is_left_out_or_mended_is_counted(tmp_path: Path) -> None:
    bow = [[[LON, LAT], [LON + 1e-4, LAT + 1e-4], [LON + 1e-4, LAT], [LON, LAT + 1e-4], [LON, LAT]]]
    path = write(tmp_path, [feature(square()), feature([LON, LAT], "Point"), {"type": "Feature", "properties": {}, "geometry": None}, feature(bow)])  # noqa: E501  # fmt: skip
    with pytest.warns(FactorlocWarning, match="1 shapes without an area.*mended crossing outlines: 1"):
        places = read_buildings(path)
    assert len(places) == 3
    assert places.left_out == {"shapes without an area": 1, "features without a shape": 1}
    assert places.mended == {"mended crossing outlines": 1}
    assert all(outline.polygon.is_valid for outline in places.outlines)
    assert "left out 1" in str(places)


def test_courtyards_and_many_parts_are_kept(tmp_path: Path) -> None:
    outer, hole = square(4e-4)[0], square(1e-4, LON + 1e-4, LAT + 1e-4)[0]
    path = write(tmp_path, [feature([[outer, hole[::-1]], square(lon=LON + 1e-3)], "MultiPolygon", height=10)])
    court, other = read_buildings(path).outlines
    assert len(court.polygon.interiors) == 1
    assert other.height == court.height == 10


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("{", "not GeoJSON"),
        ("[1]", "not GeoJSON"),
        ('{"type": "FeatureCollection"}', "no list"),
        ('{"type": "FeatureCollection", "features": []}', "no building outline"),
        (
            '{"type": "FeatureCollection", "features": [{"type": "Feature", "properties": {}, "geometry": null}]}',
            "1 fea",
        ),
        ('{"type": "Polygon", "coordinates": [[[0, 0], [NaN, 1], [1, 1], [0, 0]]]}', "NaN is no number"),
        ('{"type": "Polygon", "coordinates": [[[0, 0], [9, 0], [9, 9], [0, 0]]]}', "100 km"),
        ('{"type": "Polygon", "coordinates": [[[500, 0], [501, 0], [501, 1], [500, 0]]]}', "no longitudes"),
        ('{"type": "Polygon", "coordinates": [[[1, 1], [2, 2], [1, 1], [2, 2], [1, 1]]]}', "encloses an area"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "bad.geojson"
    path.write_text(text)
    with pytest.raises(DataError, match=message) as error:
        read_buildings(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_other_faults_are_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such file"):
        read_buildings(tmp_path / "none.geojson")
    with pytest.raises(DataError, match="unknown"):
        read_buildings(write(tmp_path, [feature(square())]), crs="EPSG:99999")
    with pytest.raises(DataError, match=r"no known format.*GeoPackage"):
        read_buildings(tmp_path / "houses.dwg")
    fake = tmp_path / "houses.gpkg"
    fake.write_bytes(b"SQLite format 3\0" + bytes(2000))
    with pytest.raises(DataError, match=r"houses\.gpkg: damaged"):
        read_buildings(fake)
    disguised = tmp_path / "other.gpkg"
    disguised.write_bytes(write(tmp_path, [feature(square())]).read_bytes())
    with pytest.raises(DataError, match=r"other\.gpkg"):
        read_buildings(disguised)


@pytest.mark.parametrize(("name", "library"), [("a.osm", "osmium"), ("a.gpkg", "pyogrio"), ("a.gml", "lxml")])
def test_a_missing_library_is_named_with_its_extra(
    tmp_path: Path, name: str, library: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / name).write_text("<osm/>")
    monkeypatch.setitem(sys.modules, library, None)
    monkeypatch.setitem(sys.modules, "lxml.etree", None)
    with pytest.raises(MissingLibraryError, match=rf"{library} is not installed.*factorloc\[gis\]"):
        read_buildings(tmp_path / name)


def test_a_file_without_a_coordinate_system_needs_one(tmp_path: Path) -> None:
    path = tmp_path / "bare.shp"
    house = shapely.box(450000, 5430000, 450020, 5430010)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        pyogrio.raw.write(path, shapely.to_wkb(np.array([house])), [], [], geometry_type="Polygon", crs=None)
    with pytest.raises(DataError, match=r"names no coordinate system.*--crs"):
        read_buildings(path)
    assert read_buildings(path, crs="EPSG:25832", datum="file").outlines[0].polygon.area == pytest.approx(200, rel=1e-3)


def town(turn: float) -> list[dict[str, Any]]:
    """Houses at right angles, turned by an angle, as a file with longitudes first has them."""
    rng = np.random.default_rng(0)
    rows = []
    for x, y in rng.uniform(-300, 300, (20, 2)):
        w, d = rng.uniform(8, 20, 2)
        ring = np.array([(0, 0), (w, 0), (w, d), (0, d), (0, 0)]) @ np.array(
            [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
        ) + (x, y)  # fmt: skip
        degrees = ring / [111_320 * np.cos(np.deg2rad(LAT)), 111_320] + (LON, LAT)
        rows.append(feature([degrees.tolist()]))
    return rows


def test_swapped_axes_are_told_by_right_angles(tmp_path: Path) -> None:
    rows = town(0.5)
    assert len(read_buildings(write(tmp_path, rows))) == 20
    for row in rows:
        row["geometry"]["coordinates"] = [[[lat, lon] for lon, lat in ring] for ring in row["geometry"]["coordinates"]]
    path = write(tmp_path, rows)
    with pytest.raises(DataError, match=r"no right angles.*--swap-axes"):
        read_buildings(path)
    swapped = read_buildings(path, swap_axes=True)
    assert swapped.frame is not None
    assert swapped.frame.latitude == pytest.approx(LAT, abs=0.01)


def test_swapped_axes_beyond_the_pole_are_told_at_once(tmp_path: Path) -> None:
    path = write(tmp_path, [feature(square(lon=35.0, lat=139.0))])
    with pytest.raises(DataError, match="swapped: --swap-axes"):
        read_buildings(path)
    assert len(read_buildings(path, swap_axes=True)) == 1


def test_a_missing_datum_grid_is_said(tmp_path: Path) -> None:
    path = tmp_path / "old.shp"
    house = shapely.box(3450000, 5430000, 3450020, 5430010)
    pyogrio.raw.write(path, shapely.to_wkb(np.array([house])), [], [], geometry_type="Polygon", crs="EPSG:31467")
    with pytest.warns(FactorlocWarning, match="datum grid de_adv_BETA2007.tif is missing.*to 3 m"):
        places = read_buildings(path)
    assert places.frame is not None
    assert places.frame.accuracy == 3.0
    assert read_buildings(path, datum="file").frame.accuracy == 0  # type: ignore[union-attr]
