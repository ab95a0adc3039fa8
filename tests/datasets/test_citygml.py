"""CityGML and CityJSON: footprints along the walls, axis order, missing systems, and no entities."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from factorloc.datasets import read_buildings
from factorloc.datasets.citygml import read_citygml
from factorloc.datasets.surface_footprint import Surface, footprint_of
from factorloc.errors import DataError, FactorlocWarning

pytest.importorskip("lxml")

X, Y, Z = 460_000.0, 5_430_000.0, 110.0
FLOOR = [(0, 0), (12, 0), (12, 8), (0, 8)]


def ring(points: list[tuple[float, ...]], swap: bool = False) -> str:
    closed = [*points, points[0]]
    flat = [(y, x, *rest) if swap else (x, y, *rest) for x, y, *rest in closed]
    return " ".join(f"{value:.3f}" for point in flat for value in point)


def polygon(points: list[tuple[float, ...]], swap: bool = False) -> str:
    return (
        "<gml:Polygon><gml:exterior><gml:LinearRing><gml:posList>"
        f"{ring(points, swap)}</gml:posList></gml:LinearRing></gml:exterior></gml:Polygon>"
    )


def at(points: list[tuple[float, float]], z: float, x: float = X, y: float = Y) -> list[tuple[float, ...]]:
    return [(x + a, y + b, Z + z) for a, b in points]


def walls(height: float = 6.0) -> list[list[tuple[float, ...]]]:
    return [[*at([a, b], 0.0), *at([b, a], height)] for a, b in zip(FLOOR, FLOOR[1:] + FLOOR[:1], strict=True)]


def surface(kind: str, points: list[tuple[float, ...]], swap: bool = False) -> str:
    return (
        f"<bldg:boundedBy><bldg:{kind}><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember>"
        f"{polygon(points, swap)}</gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:{kind}>"
        "</bldg:boundedBy>"
    )


def city(*buildings: str, srs: str | None = "EPSG:25832", version: str = "2.0") -> str:
    name = f' srsName="{srs}"' if srs else ""
    return (
        '<?xml version="1.0" encoding="UTF-8"?><core:CityModel xmlns:gml="http://www.opengis.net/gml" '
        f'xmlns:core="http://www.opengis.net/citygml/{version}" '
        f'xmlns:bldg="http://www.opengis.net/citygml/building/{version}"><gml:boundedBy><gml:Envelope{name} '
        'srsDimension="3"/></gml:boundedBy>'
        + "".join(f"<core:cityObjectMember>{building}</core:cityObjectMember>" for building in buildings)
        + "</core:CityModel>"
    )


def house(*surfaces: str, name: str = "hall", facts: str = "") -> str:
    return f'<bldg:Building gml:id="b1"><gml:name>{name}</gml:name>{facts}{"".join(surfaces)}</bldg:Building>'


def save(folder: Path, text: str, name: str = "city.gml") -> Path:
    path = folder / name
    path.write_text(text)
    return path


OVERHANG = [(-1, -1), (13, -1), (13, 9), (-1, 9)]


@pytest.mark.parametrize("version", ["1.0", "2.0"])
@pytest.mark.parametrize("with_ground", [True, False])
def test_footprints_follow_the_walls_not_the_roof(tmp_path: Path, version: str, with_ground: bool) -> None:
    surfaces = [surface("WallSurface", wall) for wall in walls()] + [surface("RoofSurface", at(OVERHANG, 7.0))]
    if with_ground:
        surfaces.append(surface("GroundSurface", at(FLOOR, 0.0)))
    path = save(tmp_path, city(house(*surfaces), version=version))
    (found,) = read_buildings(path, datum="file").outlines
    assert found.polygon.area == pytest.approx(96, rel=1e-3)
    assert found.height == pytest.approx(7.0)
    assert found.name == "hall"


def test_measured_heights_and_parts(tmp_path: Path) -> None:
    part = (
        '<bldg:consistsOfBuildingPart><bldg:BuildingPart gml:id="p1"><bldg:measuredHeight uom="m">9.5'
        f"</bldg:measuredHeight>{surface('GroundSurface', at(FLOOR, 0.0, X + 12))}</bldg:BuildingPart>"
        "</bldg:consistsOfBuildingPart>"
    )
    ground = surface("GroundSurface", at(FLOOR, 0.0))
    both = read_buildings(save(tmp_path, city(house(ground, part))), datum="file").outlines
    assert [outline.is_part for outline in both] == [True, False]
    assert [outline.height for outline in both] == [9.5, None]
    only = read_citygml(save(tmp_path, city(house(part))))
    assert len(only.features) == 1
    assert sum(only.left_out.values()) == 0


def test_block_models_are_read(tmp_path: Path) -> None:
    faces = [at(FLOOR, 0.0), at(FLOOR, 5.0), *walls(5.0)]
    members = "".join(f"<gml:surfaceMember>{polygon(face)}</gml:surfaceMember>" for face in faces)
    solid = (
        "<bldg:lod1Solid><gml:Solid><gml:exterior><gml:CompositeSurface>"
        f"{members}</gml:CompositeSurface></gml:exterior></gml:Solid></bldg:lod1Solid>"
    )
    (found,) = read_buildings(save(tmp_path, city(house(solid))), datum="file").outlines
    assert found.polygon.area == pytest.approx(96, rel=1e-3)
    assert found.height == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("srs", "swap"),
    [
        ("urn:ogc:def:crs:EPSG::31467", True),
        ("http://www.opengis.net/def/crs/EPSG/0/31467", True),
        ("EPSG:31467", False),
        ("urn:adv:crs:ETRS89_UTM32*DE_DHHN2016_NH", False),
        ("urn:ogc:def:crs,crs:EPSG::25832,crs:EPSG::7837", False),
    ],
)
def test_the_axes_are_in_the_order_of_the_system(tmp_path: Path, srs: str, swap: bool) -> None:
    x = 3_460_000.0 if "31467" in srs else X
    path = save(tmp_path, city(house(surface("GroundSurface", at(FLOOR, 0.0, x), swap)), srs=srs))
    places = read_buildings(path, datum="file")
    x0, y0, x1, y1 = places.outlines[0].polygon.bounds
    assert (x1 - x0, y1 - y0) == pytest.approx((12, 8), abs=0.3)  # turned by the convergence of the grid
    assert places.frame is not None
    assert places.frame.latitude == pytest.approx(49.0, abs=0.1)
    assert ("easting first" in str(places)) == (srs == "EPSG:31467")


def test_a_missing_system_is_asked_for(tmp_path: Path) -> None:
    path = save(tmp_path, city(house(surface("GroundSurface", at(FLOOR, 0.0))), srs=None))
    with pytest.raises(DataError, match=r"names no coordinate system.*--crs"):
        read_buildings(path)
    assert len(read_buildings(path, crs="EPSG:25832")) == 1


def test_the_accuracy_of_the_way_to_wgs84_is_kept(tmp_path: Path) -> None:
    places = read_buildings(save(tmp_path, city(house(surface("GroundSurface", at(FLOOR, 0.0))))))
    assert places.frame is not None
    assert places.frame.accuracy == 1.0
    assert "moved from ETRS89 to WGS 84, to 1 m" in str(places)


LAUGHS = "<!DOCTYPE x [" + '<!ENTITY a "0 0 0 ">' + "".join(
    f'<!ENTITY {chr(98 + k)} "{f"&{chr(97 + k)};" * 10}">' for k in range(9)
) + "]>"  # fmt: skip


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("<core:CityModel", "damaged, or no XML"),
        ("<kml/>", "no building of CityGML 1 or 2 (its root is 'kml')"),
        (city(), "no building of CityGML"),
        (city(house()), "no building outline, but 1 buildings without surfaces"),
        (city(house(surface("GroundSurface", [(X, Y, Z), (X + 1, Y, Z)]))), "no building outline"),
        (city(house(surface("GroundSurface", at(FLOOR, 0.0)).replace("460012.000", "east"))), "no numbers"),
        (city(house(surface("GroundSurface", at(FLOOR, 0.0)))).replace("?><", f"?>{LAUGHS}<", 1), "document type"),
        (
            city(house(surface("GroundSurface", at(FLOOR, 0.0)).replace("460012.000", "&j;")))
            .replace("?><", f"?>{LAUGHS}<", 1),
            "document type|damaged",
        ),
        (
            city(house(surface("GroundSurface", at(FLOOR, 0.0))))
            .replace("?><", '?><!DOCTYPE x [<!ENTITY f SYSTEM "file:///etc/passwd">]><', 1),
            "document type",
        ),
        (city(house(surface("GroundSurface", at(FLOOR, 0.0))), srs="my grid"), "'my grid' is unknown"),
    ],
)  # fmt: skip
def test_bad_files_are_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = save(tmp_path, text)
    with pytest.raises(DataError) as error:
        read_buildings(path)
    assert any(part in str(error.value) for part in message.split("|"))
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_all_members_are_read_and_none_is_kept_in_memory(tmp_path: Path) -> None:
    ground = [surface("GroundSurface", at(FLOOR, 0.0, X + 20 * k)) for k in range(50)]
    road = "<tran:Road xmlns:tran='http://www.opengis.net/citygml/transportation/2.0'/>"
    text = city(*(member for one in ground for member in (house(one), road)))
    assert len(read_citygml(save(tmp_path, text)).features) == 50


def test_several_systems_are_refused(tmp_path: Path) -> None:
    ground = surface("GroundSurface", at(FLOOR, 0.0))
    other = ground.replace("<gml:Polygon>", '<gml:Polygon srsName="EPSG:25833">')
    with pytest.raises(DataError, match="2 coordinate systems"):
        read_buildings(save(tmp_path, city(house(ground), house(other))))


def document(**changes: Any) -> dict[str, Any]:
    """Two buildings of CityJSON, one with a part, in thousandths."""
    corners = [(*corner, z) for z in (0, 6) for corner in FLOOR]
    shell = [[[0, 3, 2, 1]], [[4, 5, 6, 7]], *([[[a, (a + 1) % 4, 4 + (a + 1) % 4, 4 + a]] for a in range(4)])]
    solid = {"type": "Solid", "lod": "1", "boundaries": [shell]}
    kinds = [{"type": "GroundSurface"}, {"type": "RoofSurface"}, {"type": "WallSurface"}]
    fine = {**solid, "lod": "2.2", "semantics": {"surfaces": kinds, "values": [[0, 1, 2, 2, 2, 2]]}}
    base = {
        "type": "CityJSON",
        "version": "2.0",
        "transform": {"scale": [0.001, 0.001, 0.001], "translate": [X, Y, Z]},
        "metadata": {"referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/25832"},
        "CityObjects": {
            "hall": {"type": "Building", "geometry": [solid, fine], "attributes": {"measuredHeight": 6.5}},
            "tree": {"type": "SolitaryVegetationObject"},
        },
        "vertices": [[round(1000 * value) for value in corner] for corner in corners],
    }
    return {**base, **changes}


def test_cityjson_is_read(tmp_path: Path) -> None:
    for name in ("city.city.json", "city.json"):
        path = save(tmp_path, json.dumps(document()), name)
        with pytest.warns(FactorlocWarning, match="1 objects that are no buildings"):
            (found,) = read_buildings(path, datum="file").outlines
        assert found.polygon.area == pytest.approx(96, rel=1e-3)
        assert (found.height, found.name) == (6.5, "hall")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"type": "Feature"}, "no CityJSON"),
        ({"CityObjects": []}, "'CityObjects'"),
        ({"CityObjects": {}}, "nothing at all"),
        ({"vertices": [[0, 0]]}, "'vertices'"),
        ({"vertices": [[0, 0, 0]]}, "1 buildings whose surfaces are damaged"),
        ({"transform": {"scale": 1}}, "'transform'"),
        ({"metadata": {}}, "names no coordinate system"),
    ],
)
def test_bad_cityjson_is_refused_in_one_line(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    path = save(tmp_path, json.dumps(document(**changes)), "city.city.json")
    with pytest.raises(DataError) as error:
        read_buildings(path)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_footprints_of_walls_that_meet_only_in_plan() -> None:
    """Walls of two heights close a footprint, gables included."""
    flat = [
        np.array([*at([a, b], 0.0), *at([b], 6.0 + k), *at([a], 6.0)])
        for k, (a, b) in enumerate(zip(FLOOR, FLOOR[1:] + FLOOR[:1], strict=True))
    ]
    found = footprint_of([Surface("WallSurface", (wall,)) for wall in flat])
    assert found.equals(shapely.box(X, Y, X + 12, Y + 8))
