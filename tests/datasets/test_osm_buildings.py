"""OpenStreetMap: which buildings are taken, what is counted, and what is refused."""

from __future__ import annotations

import bz2
import gzip
import zlib
from pathlib import Path

import numpy as np
import pytest
import shapely

from factorloc.datasets import osm_buildings, read_buildings
from factorloc.datasets.osm_buildings import OSM_ATTRIBUTION, read_osm_buildings
from factorloc.errors import DataError, FactorlocWarning
from factorloc.mapping import FacadeMap

osmium = pytest.importorskip("osmium")

LON, LAT = 8.42, 49.01
STEP = 1e-4


def xml(*parts: str) -> str:
    return '<?xml version="1.0" encoding="UTF-8"?>\n<osm version="0.6">' + "".join(parts) + "</osm>"


def nodes(first: int, x: float, y: float, size: float = 2.0) -> str:
    """Four corners of a square, counted from a number."""
    corners = [(x, y), (x + size, y), (x + size, y + size), (x, y + size)]
    return "".join(
        f'<node id="{first + k}" version="1" lon="{LON + a * STEP:.7f}" lat="{LAT + b * STEP:.7f}"/>'
        for k, (a, b) in enumerate(corners)
    )


def way(number: int, refs: list[int], **tags: str) -> str:
    inside = "".join(f'<nd ref="{ref}"/>' for ref in refs)
    return f'<way id="{number}" version="1">{inside}{tagged(tags)}</way>'


def tagged(tags: dict[str, str]) -> str:
    return "".join(f'<tag k="{key.replace("__", ":")}" v="{value}"/>' for key, value in tags.items())


def square(number: int, x: float, y: float, size: float = 2.0, **tags: str) -> tuple[str, str]:
    first = 10 * number
    return nodes(first, x, y, size), way(number, [first, first + 1, first + 2, first + 3, first], **tags)


def save(folder: Path, *pairs: tuple[str, str], more: str = "", name: str = "map.osm") -> Path:
    path = folder / name
    path.write_text(xml("".join(pair[0] for pair in pairs), "".join(pair[1] for pair in pairs), more))
    return path


def test_buildings_parts_and_multipolygons_are_read(tmp_path: Path) -> None:
    court = (
        '<relation id="7" version="1"><member type="way" ref="3" role="outer"/>'
        '<member type="way" ref="4" role="inner"/>'
        + tagged({"type": "multipolygon", "building": "yes", "name": "court", "building:levels": "4"})
        + "</relation>"
    )
    path = save(
        tmp_path,
        square(1, 0, 0, building="house", height="8.5"),
        square(2, 10, 0, building__part="yes"),
        square(3, 20, 0, 6.0),
        square(4, 22, 2, 2.0),
        square(5, 40, 0, landuse="grass"),
        square(6, 50, 0, building="no"),
        more=court,
    )
    found = {outline.name or str(outline.height): outline for outline in read_buildings(path).outlines}
    assert set(found) == {"8.5", "None", "court"}
    assert found["None"].is_part
    assert found["court"].height == 12
    assert len(found["court"].polygon.interiors) == 1
    assert found["court"].polygon.area == pytest.approx(8 * found["8.5"].polygon.area, rel=1e-4)
    assert read_buildings(path).attribution == OSM_ATTRIBUTION == "© OpenStreetMap contributors, ODbL"


def test_what_is_not_used_is_counted(tmp_path: Path) -> None:
    point = f'<node id="900" version="1" lon="{LON}" lat="{LAT}"><tag k="building" v="yes"/></node>'
    path = save(
        tmp_path,
        square(1, 0, 0, building="yes"),
        square(2, 10, 0, building="roof"),
        square(3, 20, 0, building="yes", layer="-1"),
        (point, way(4, [10, 11, 999, 10], building="yes")),
        ("", way(5, [10, 11, 12], building="yes")),
        more='<relation id="6" version="1"><member type="way" ref="77" role="outer"/>'
        + tagged({"type": "multipolygon", "building": "yes"})
        + "</relation>",
    )
    with pytest.warns(FactorlocWarning, match="3 outlines that are cut or not closed"):
        places = read_buildings(path)
    assert len(places) == 1
    assert places.left_out == {
        "roofs and what is underground": 2,
        "buildings that are points": 1,
        "outlines that are cut or not closed": 3,
    }


@pytest.mark.parametrize(("ending", "pack"), [(".osm.gz", gzip.compress), (".osm.bz2", bz2.compress)])
def test_compressed_files_are_read_and_bombs_are_not(
    tmp_path: Path, ending: str, pack, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"map{ending}"
    path.write_bytes(pack(save(tmp_path, square(1, 0, 0, building="yes")).read_bytes()))
    assert len(read_buildings(path)) == 1
    monkeypatch.setattr(osm_buildings, "MAX_DECOMPRESSED_BYTES", 2**20)
    path.write_bytes(pack(bytes(2**21)))
    with pytest.raises(DataError, match=r"unfolds beyond 1 MiB.*cut out one place"):
        read_buildings(path)
    path.write_bytes(pack(save(tmp_path, square(1, 0, 0, building="yes")).read_bytes())[:-20])
    with pytest.raises(DataError, match="damaged or cut short"):
        read_buildings(path)


def varint(number: int) -> bytes:
    out = b""
    while number > 127:
        out, number = out + bytes([number & 127 | 128]), number >> 7
    return out + bytes([number])


def block(kind: bytes, raw_size: int, packed: bytes) -> bytes:
    """A block of a PBF file: header length, header (type, size), and compressed data with their declared size."""
    blob = b"\x10" + varint(raw_size) + b"\x1a" + varint(len(packed)) + packed
    header = b"\x0a" + varint(len(kind)) + kind + b"\x18" + varint(len(blob))
    return len(header).to_bytes(4, "big") + header + blob


def test_bombs_of_blocks_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "map.osm.pbf"
    bomb = block(b"OSMData", 31 * 2**20, zlib.compress(bytes(31 * 2**20)))
    path.write_bytes(bomb * 40)
    with pytest.raises(DataError, match="unfolds beyond 1024 MiB"):
        read_buildings(path)
    path.write_bytes(b"no blocks at all")
    with pytest.raises(DataError, match="damaged, or no"):
        read_buildings(path)


def test_a_real_block_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "map.osm.pbf"
    source = save(tmp_path, square(1, 0, 0, building="yes"), square(2, 10, 0, building="yes"))
    with osmium.SimpleWriter(str(path)) as writer:
        for thing in osmium.FileProcessor(str(source)):
            writer.add(thing)
    assert len(read_buildings(path)) == 2


LAUGHS = (
    '<?xml version="1.0"?>\n<!DOCTYPE osm [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;">]>\n<osm version="0.6">&b;</osm>'
)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("<osm", "damaged, or no OpenStreetMap file"),
        ("<gpx/>", "damaged, or no OpenStreetMap file"),
        (LAUGHS, "damaged, or no OpenStreetMap file"),
        (xml(), "no building outline, but nothing at all"),
        (xml(square(1, 0, 0)[0]), "no building outline"),
        (xml(f'<node id="1" version="1" lon="{LON}" lat="x"/>'), "damaged"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "bad.osm"
    path.write_text(text)
    with pytest.raises(DataError, match=message) as error:
        read_buildings(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_crossing_outlines_are_counted(tmp_path: Path) -> None:
    corners, _ = square(1, 0, 0)
    bow = way(1, [10, 12, 11, 13, 10], building="yes")
    path = save(tmp_path, (corners, bow), square(2, 10, 0, building="yes"))
    with pytest.warns(FactorlocWarning, match="cut or not closed|crossing"):
        places = read_buildings(path)
    assert len(places) + sum(places.left_out.values()) + sum(places.mended.values()) >= 2


@pytest.mark.data
def test_the_extract_beside_drive_0005(data_dir: Path) -> None:
    path = data_dir / "kitti_raw_0005" / "2011_09_26_drive_0005_sync.osm"
    with pytest.warns(FactorlocWarning, match="left out 2 roofs"):
        places = read_buildings(path)
    # The file tags 173 closed ways as buildings or parts; two of them are roofs.
    assert len(places) == 171
    facades = FacadeMap.from_outlines(places)
    assert facades.attribution == OSM_ATTRIBUTION
    outlines = shapely.union_all(np.array(facades.outlines, dtype=object))
    lines = shapely.linestrings(facades.facades.segments)
    assert shapely.hausdorff_distance(shapely.union_all(lines), outlines.boundary) < 10
    assert lines.size > 800


@pytest.mark.data
def test_a_block_extract(data_dir: Path) -> None:
    found = read_osm_buildings(data_dir / "osm" / "test.osm.pbf")
    assert len(found.features) == 2170
    assert found.left_out["outlines that are cut or not closed"] == 48
