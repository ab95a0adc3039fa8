"""Files of facade maps: equal to the last bit, and no damage goes unnoticed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import shapely

from factorloc.errors import MapError, MapFormatError
from factorloc.mapping import (
    BuildingOutlines,
    FacadeMap,
    LocalFrame,
    MapUncertainty,
    Outline,
    is_facade_map,
    read_facade_map,
    read_map_info,
    write_facade_geojson,
    write_facade_map,
)


def town(frame: LocalFrame | None = None) -> FacadeMap:
    court = shapely.box(0, 0, 40, 30).difference(shapely.box(10, 10, 30, 20))
    outlines = (
        Outline(court, 12.0, "court"),
        Outline(shapely.box(60, 0, 70.1, 9)),
        Outline(shapely.box(70.1, 0, 80, 9)),
    )
    buildings = BuildingOutlines(outlines, frame, "© somebody", "town.osm", {"roofs": 2})
    return FacadeMap.from_outlines(buildings, MapUncertainty(1.5, 0.25))


def assert_equal(a: FacadeMap, b: FacadeMap) -> None:
    for name in ("segments", "buildings", "shifts", "vertex_errors"):
        assert (getattr(a.facades, name) == getattr(b.facades, name)).all()
    assert [p.wkb for p in a.outlines] == [p.wkb for p in b.outlines]
    assert np.array_equal(a.heights, b.heights, equal_nan=True)
    assert (a.uncertainty, a.frame, a.attribution) == (b.uncertainty, b.frame, b.attribution)
    assert (a.provenance, a.left_out) == (b.provenance, b.left_out)


@pytest.mark.parametrize("frame", [None, LocalFrame(8.4, 49.0, accuracy=1.0), LocalFrame(8.4, 49.0, "EPSG:4258")])
def test_what_is_written_is_read(tmp_path: Path, frame: LocalFrame | None) -> None:
    path, made = tmp_path / "facades.h5", town(frame)
    write_facade_map(path, made)
    assert is_facade_map(path)
    assert_equal(read_facade_map(path), made)
    with pytest.raises(MapFormatError, match="holds 'factorloc facade map'"):
        read_map_info(path)


def test_no_facade_is_a_map_too(tmp_path: Path) -> None:
    made = town()
    bare = replace(made, facades=made.facades.select(np.zeros(len(made), np.bool_)), attribution="")
    write_facade_map(tmp_path / "bare.h5", bare)
    assert len(read_facade_map(tmp_path / "bare.h5")) == 0


def change(path: Path, **attributes: object) -> None:
    with h5py.File(path, "r+", libver=("v110", "v110")) as file:
        for name, value in attributes.items():
            file.attrs[name] = value


@pytest.mark.parametrize(
    ("attributes", "word"),
    [
        ({"format": np.int64(2)}, "update factorloc"),
        ({"facade_count": np.int64(3)}, "'segments'"),
        ({"facade_count": np.int64(2**40)}, "declares"),
        ({"building_count": np.int64(1)}, "'outlines'"),
        ({"declared": np.array([-1.0, 0.0])}, "shift"),
        ({"accuracy": np.float64(np.nan)}, "accuracy"),
        ({"origin": np.array([8.0, 99.0])}, "degrees on earth"),
        ({"provenance": np.bytes_(b"[]")}, "provenance"),
    ],
)
def test_false_declarations_are_refused(tmp_path: Path, attributes: dict[str, object], word: str) -> None:
    path = tmp_path / "facades.h5"
    write_facade_map(path, town(LocalFrame(8.4, 49.0)))
    change(path, **attributes)
    with pytest.raises(MapFormatError, match=word) as error:
        read_facade_map(path)
    assert "\n" not in str(error.value)


def test_no_flipped_bit_goes_unnoticed(tmp_path: Path) -> None:
    path, made = tmp_path / "facades.h5", town()
    write_facade_map(path, made)
    image = path.read_bytes()
    rng = np.random.default_rng(0)
    unnoticed = 0
    for place in rng.integers(0, len(image), 300).tolist():
        broken = bytearray(image)
        broken[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(broken)
        try:
            assert_equal(read_facade_map(path), made)
        except MapFormatError:
            continue
        except AssertionError:
            unnoticed += 1
    assert unnoticed == 0


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(MapFormatError, match="no such file"):
        read_facade_map(tmp_path / "none.h5")
    text = tmp_path / "text.h5"
    text.write_text("facades")
    with pytest.raises(MapFormatError, match="no HDF5 file"):
        is_facade_map(text)


def test_geojson_holds_buildings_and_facades(tmp_path: Path) -> None:
    path, made = tmp_path / "facades.geojson", town(LocalFrame(8.4, 49.0))
    write_facade_geojson(path, made)
    document = json.loads(path.read_text(encoding="utf-8"))
    kinds = [feature["properties"]["kind"] for feature in document["features"]]
    assert (kinds.count("building"), kinds.count("facade")) == (3, len(made))
    assert document["attribution"] == "© somebody"
    first = next(f for f in document["features"] if f["properties"]["kind"] == "facade")
    assert first["properties"]["shift"] == 1.5
    assert made.frame is not None
    back = made.frame.from_geographic(first["geometry"]["coordinates"])
    assert back == pytest.approx(made.facades.segments[0], abs=1e-6)


@pytest.mark.parametrize("frame", [None, LocalFrame(8.4, 49.0, "EPSG:4258")])
def test_geojson_is_in_wgs84_only(tmp_path: Path, frame: LocalFrame | None) -> None:
    with pytest.raises(MapError, match="WGS 84"):
        write_facade_geojson(tmp_path / "facades.geojson", town(frame))
    assert not (tmp_path / "facades.geojson").exists()
