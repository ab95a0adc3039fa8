"""Files of pole maps: equal to the last bit when read again, and one clear line for whatever is no map."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from factorloc.errors import FactorlocWarning, MapError, MapFormatError
from factorloc.mapping.georeference import Georeference
from factorloc.mapping.pole_map import PoleMap
from factorloc.mapping.pole_map_storage import is_pole_map, read_pole_map, write_pole_map
from factorloc.mapping.poles import Poles

PLACE = Georeference("EPSG:32632", [456_789.123, 5_432_100.987, 0.3])


def a_map(seed: int = 0, count: int = 7, sessions: int = 2, place: Georeference | None = PLACE) -> PoleMap:
    rng = np.random.default_rng(seed)
    bottom = rng.normal(size=count)
    poles = Poles(
        rng.uniform(-300, 300, (count, 2)),
        rng.uniform(0.05, 1, count),
        np.stack([bottom, bottom + rng.uniform(1, 5, count)], 1),
        rng.uniform(0.6, 1, count),
    )
    in_view = rng.integers(1, 20, (count, sessions))
    names = tuple(f"session {k}" for k in range(sessions))
    return PoleMap(poles, rng.integers(0, in_view + 1), in_view, names, "town", place, {"recording": "tôwn"})


def assert_equal(one: PoleMap, other: PoleMap) -> None:
    for name in ("positions", "widths", "spans", "scores"):
        assert np.array_equal(getattr(one.poles, name), getattr(other.poles, name))
    for name in ("seen", "in_view"):
        assert np.array_equal(getattr(one, name), getattr(other, name))
    for name in ("sessions", "frame", "georeference", "provenance"):
        assert getattr(one, name) == getattr(other, name)


@pytest.mark.parametrize("ending", ["h5", "geojson"])
@pytest.mark.parametrize(
    ("count", "sessions", "place"), [(9, 1, PLACE), (9, 3, None), (1, 2, PLACE), (0, 1, PLACE), (0, 2, None)]
)
def test_a_map_read_again_is_equal_to_the_last_bit(
    count: int, sessions: int, place: Georeference | None, ending: str, tmp_path: Path
) -> None:
    pole_map, path = a_map(count, count, sessions, place), tmp_path / f"map.{ending}"
    write_pole_map(path, pole_map)
    assert_equal(read_pole_map(path), pole_map)
    assert is_pole_map(path)


def test_geojson_is_what_the_standard_says(tmp_path: Path) -> None:
    pole_map = a_map()
    write_pole_map(tmp_path / "map.geojson", pole_map)
    collection = json.loads((tmp_path / "map.geojson").read_text(encoding="utf-8"))
    assert collection["type"] == "FeatureCollection"
    assert "crs" not in collection  # RFC 7946 forbids it
    lonlat = [feature["geometry"]["coordinates"] for feature in collection["features"]]
    assert np.abs(PLACE.from_lonlat(lonlat) - pole_map.positions).max() < 1e-4
    write_pole_map(tmp_path / "plain.geojson", replace(pole_map, georeference=None))
    plain = json.loads((tmp_path / "plain.geojson").read_text(encoding="utf-8"))
    assert {str(feature["geometry"]) for feature in plain["features"]} == {"None"}


def points(*coordinates: list[float], **members: object) -> dict[str, object]:
    features = [
        {"type": "Feature", "geometry": {"type": "Point", "coordinates": pair}, "properties": None}
        for pair in coordinates
    ]
    return {"type": "FeatureCollection", "features": features, **members}


@pytest.mark.parametrize("crs", [None, "EPSG:32632"])
def test_points_of_another_source_come_into_a_local_frame(crs: str | None, tmp_path: Path) -> None:
    if crs is None:
        collection = points([8.4, 49.0], [8.4, 49.0009])
    else:
        named = {"type": "name", "properties": {"name": crs}}
        collection = points([456_111.0, 5_427_600.0], [456_111.0, 5_427_700.0], crs=named)
    features = collection["features"]
    assert isinstance(features, list)
    features[0]["properties"] = {"width": 0.4, "kind": "lamp"}
    (tmp_path / "poles.json").write_text(json.dumps(collection), encoding="utf-8")
    pole_map = read_pole_map(tmp_path / "poles.json")
    assert pole_map.poles.widths.tolist() == [0.4, 0.2]
    assert np.allclose(pole_map.positions.mean(0), 0, atol=1e-3)
    assert np.linalg.norm(np.diff(pole_map.positions, axis=0)) == pytest.approx(100.05, abs=0.05)


def test_poles_that_stand_twice_are_left_out_and_counted(tmp_path: Path) -> None:
    np.savez(tmp_path / "twice.npz", poleparams=[[0.0, 0.0], [5.0, 0.0], [0.001, 0.0]])
    with pytest.warns(FactorlocWarning, match="1 poles stand twice"):
        pole_map = read_pole_map(tmp_path / "twice.npz")
    assert len(pole_map) == 2


@pytest.mark.data
@pytest.mark.parametrize(("sequence", "count"), [("05", 321), ("06", 236), ("07", 136)])
def test_published_maps_are_read_whole(sequence: str, count: int, data_dir: Path) -> None:
    pole_map = read_pole_map(data_dir / "kitti_poles" / f"{sequence}.npz")
    assert len(pole_map) == count
    assert np.ptp(pole_map.positions, axis=0).min() > 80


@pytest.mark.parametrize(
    ("name", "content", "word"),
    [
        ("a.geojson", "{", "no GeoJSON"),
        ("a.geojson", '{"type": "Feature"}', "expected a FeatureCollection"),
        ("a.geojson", '{"type": "FeatureCollection"}', "lacks 'features'"),
        ("a.geojson", "[1]", "no map of poles"),
        ("a.geojson", json.dumps(points([500.0, 49.0])), "no longitudes and latitudes"),
        ("a.geojson", json.dumps(points([8.0, 49.0], crs={"properties": {"name": "EPSG:0"}})), "unknown"),
        ("a.geojson", json.dumps(points()), "holds no points"),
        ("a.geojson", '{"type": "FeatureCollection", "factorloc": {"format": 9}, "features": []}', "update factorloc"),
        ("a.h5", "no HDF5", "no HDF5 file"),
        ("a.npz", "no archive", "damaged"),
        ("a.csv", "", "end in .geojson"),
    ],
)
def test_files_that_are_no_maps_are_refused_in_one_line(name: str, content: str, word: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(content, encoding="utf-8")
    with pytest.raises(MapFormatError, match=word) as error:
        read_pole_map(tmp_path / name)
    assert str(tmp_path / name) in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["no.geojson", "no.h5", "no.npz"])
def test_a_missing_file_is_named(name: str, tmp_path: Path) -> None:
    with pytest.raises(MapFormatError, match="no such file"):
        read_pole_map(tmp_path / name)


def test_damage_within_a_file_is_found(tmp_path: Path) -> None:
    path = tmp_path / "map.h5"
    write_pole_map(path, a_map())
    whole = path.read_bytes()
    middle = whole.find(b"town")
    path.write_bytes(whole[:middle] + b"t\xffwn" + whole[middle + 4 :])
    with pytest.raises(MapFormatError, match=r"map\.h5"):
        read_pole_map(path)
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(MapFormatError, match="damaged"):
        read_pole_map(path)


def test_wrong_values_and_newer_formats_are_refused(tmp_path: Path) -> None:
    for name, value, word in (("format", np.int64(2), "update factorloc"), ("pole_count", np.int64(8), "shape")):
        path = tmp_path / f"{name}.h5"
        write_pole_map(path, a_map())
        with h5py.File(path, "r+", libver=("v110", "v110")) as file:
            file.attrs[name] = value
        with pytest.raises(MapFormatError, match=word):
            read_pole_map(path)
    collection = tmp_path / "wrong.geojson"
    write_pole_map(collection, a_map())
    collection.write_text(collection.read_text(encoding="utf-8").replace('"width": 0', '"width": -0'), encoding="utf-8")
    with pytest.raises(MapFormatError, match="widths must be positive"):
        read_pole_map(collection)


def test_archives_without_poles_and_endings_unknown_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "other.npz", points=np.zeros((3, 2)))
    with pytest.raises(MapFormatError, match="neither 'poleparams' nor 'polemeans'"):
        read_pole_map(tmp_path / "other.npz")
    np.savez(tmp_path / "flat.npz", polemeans=np.zeros(3))
    with pytest.raises(MapFormatError, match="shape"):
        read_pole_map(tmp_path / "flat.npz")
    with pytest.raises(MapError, match="end the name so"):
        write_pole_map(tmp_path / "map.csv", a_map())


def test_outlines_of_buildings_are_no_map_of_poles(tmp_path: Path) -> None:
    path = tmp_path / "town.geojson"
    square = {"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [1, 1], [0, 0]]]}
    feature = {"type": "Feature", "geometry": square, "properties": {}}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    assert not is_pole_map(path)
