"""OpenStreetMap: buildings of an XML or PBF extract."""

from __future__ import annotations

import bz2
import gzip
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any, cast

import shapely

from factorloc.datasets.building_features import BuildingFeatures, checked_size, height_of, optional
from factorloc.errors import DataError
from factorloc.files import MAX_DECOMPRESSED_BYTES

__all__ = ["OSM_ATTRIBUTION", "OsmBuildings", "read_osm_buildings"]

OSM_ATTRIBUTION = "© OpenStreetMap contributors, ODbL"
"""What has to be shown wherever data of OpenStreetMap are."""

MAX_PBF_BYTES = 2**30
"""A PBF file may unfold to this many bytes: some hundred million nodes."""

_MAX_BLOB = 32 * 2**20  # of the format: what a block may unfold to
_NO_WALLS = frozenset({"roof", "carport", "canopy"})


class OsmBuildings:
    """Reads OpenStreetMap extracts."""

    name = "OpenStreetMap (.osm, .osm.gz, .osm.bz2, .osm.pbf)"

    def matches(self, path: Path) -> bool:
        """Tell by the name."""
        return path.name.lower().endswith((".osm", ".osm.xml", ".osm.gz", ".osm.bz2", ".osm.pbf", ".pbf"))

    def read(self, path: Path) -> BuildingFeatures:
        """Read the buildings; see :func:`read_osm_buildings`."""
        return read_osm_buildings(path)


def read_osm_buildings(path: Path | str) -> BuildingFeatures:
    """Read what is tagged ``building`` or ``building:part``: closed ways, and multipolygons with their holes.

    Roofs and carports have no walls, and what is underground is not seen: they are counted, not used. So are buildings
    whose outline the extract cuts, and those that are mere points.

    Parameters
    ----------
    path : Path or str
        An extract of some towns at most.

    Raises
    ------
    DataError
        If the file is missing, damaged, or larger than any extract of a place.
    MissingLibraryError
        If osmium is not installed.
    """
    path = Path(path)
    checked_size(path)
    _check_unfolding(path)
    osmium = optional("osmium")
    found = BuildingFeatures(crs="EPSG:4326", attribution=OSM_ATTRIBUTION)
    tagged = osmium.filter.KeyFilter("building", "building:part")
    drawn: set[tuple[bool, int]] = set()  # whether a way, and its number
    assembled: set[tuple[bool, int]] = set()
    try:
        for thing in osmium.FileProcessor(str(path)).with_areas(tagged).with_filter(tagged):
            tags = dict(thing.tags)
            kinds = {tags.get(key, "no") for key in ("building", "building:part")} - {"no"}
            if not kinds:
                continue
            if kinds <= _NO_WALLS or _is_underground(tags):
                found.left_out["roofs and what is underground"] += int(not thing.is_area())
            elif thing.is_area():
                assembled.add((thing.from_way(), thing.orig_id()))
                found.add(_polygons(thing), height_of(tags), tags.get("name", ""), _is_part(tags))
            elif thing.is_node():
                found.left_out["buildings that are points"] += 1
            elif thing.is_way() or tags.get("type") in ("multipolygon", "boundary"):
                drawn.add((thing.is_way(), thing.id))
    except (RuntimeError, OSError, ValueError, osmium.InvalidLocationError) as error:
        reason = " ".join(str(error).split())[:160]
        raise DataError(f"{path}: damaged, or no OpenStreetMap file ({reason}); fetch it again") from error
    if cut := len(drawn - assembled):
        found.left_out["outlines that are cut or not closed"] += cut
    return found


def _is_underground(tags: dict[str, str]) -> bool:
    return tags.get("location") == "underground" or tags.get("layer", "0").startswith("-")


def _is_part(tags: dict[str, str]) -> bool:
    return tags.get("building", "no") == "no"


def _polygons(area: Any) -> shapely.Geometry:
    polygons = []
    for outer in area.outer_rings():
        holes = [[(node.lon, node.lat) for node in hole] for hole in area.inner_rings(outer)]
        polygons.append(shapely.Polygon([(node.lon, node.lat) for node in outer], holes))
    return polygons[0] if len(polygons) == 1 else shapely.MultiPolygon(polygons)


def _check_unfolding(path: Path) -> None:
    """Refuse a file that would unfold beyond all measure, before anything is kept of it."""
    if path.suffix.lower() == ".pbf":
        _check_blocks(path)
        return
    openers: dict[str, Callable[[Path], object]] = {".gz": gzip.GzipFile, ".bz2": bz2.BZ2File}
    if (opener := openers.get(path.suffix.lower())) is None:
        return
    try:
        with cast("IO[bytes]", opener(path)) as stream:
            total = 0
            while piece := stream.read(1 << 20):
                total += len(piece)
                if total > MAX_DECOMPRESSED_BYTES:
                    raise DataError(f"{path}: unfolds beyond {MAX_DECOMPRESSED_BYTES >> 20} MiB; cut out one place")
    except (OSError, EOFError) as error:
        raise DataError(f"{path}: damaged or cut short ({error}); fetch it again") from error


def _check_blocks(path: Path) -> None:
    """Add up what the blocks of a PBF file declare to unfold to; osmium holds them to it."""
    total = 0
    with path.open("rb") as stream:
        while head := stream.read(4):
            header = stream.read(min(int.from_bytes(head, "big"), 1 << 16))
            size = _field(header, 3)  # BlobHeader.datasize
            start = stream.read(min(size, 64))
            # Blob.raw_size stands before the data, which are the rest; a block without one is not compressed.
            total += max(_field(start, 2), size)
            if len(head) < 4 or size > _MAX_BLOB or (size and not start):
                raise DataError(f"{path}: damaged, or no PBF file; fetch it again")
            if total > MAX_PBF_BYTES:
                raise DataError(f"{path}: unfolds beyond {MAX_PBF_BYTES >> 20} MiB; cut out one place")
            stream.seek(size - len(start), 1)


def _field(message: bytes, wanted: int) -> int:
    """Whole number of a field of a protocol buffer message; 0 if it is not there."""
    at = 0

    def number() -> int:
        nonlocal at
        value = shift = 0
        while at < len(message) and shift < 64:
            byte = message[at]
            at, value, shift = at + 1, value | (byte & 127) << shift, shift + 7
            if byte < 128:
                break
        return value

    while at < len(message):
        key = number()
        if key & 7 == 0:
            value = number()
            if key >> 3 == wanted:
                return value
        elif key & 7 == 2:
            length = number()
            at += length
        else:
            break
    return 0
