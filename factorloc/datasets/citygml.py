"""CityGML 1 and 2: buildings in LOD 0 to 2, read without entities, schemas or network."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from factorloc.datasets.building_features import BuildingFeatures, checked_size, optional
from factorloc.datasets.map_projection import coordinate_system, is_north_first
from factorloc.datasets.surface_footprint import Surface, footprint_of, rise_of
from factorloc.errors import DataError

__all__ = ["CityGmlBuildings", "read_citygml"]

Array = npt.NDArray[np.float64]

_BUILDING = tuple(f"{{http://www.opengis.net/citygml/building/{version}}}" for version in ("1.0", "2.0"))
_GML = "{http://www.opengis.net/gml}"
_MEMBERS = (
    *(f"{{http://www.opengis.net/citygml/{version}}}cityObjectMember" for version in ("1.0", "2.0")),
    _GML + "featureMember",
)
_KINDS = frozenset({"GroundSurface", "WallSurface", "RoofSurface", "OuterFloorSurface", "OuterCeilingSurface",
                    "ClosureSurface", "InteriorWallSurface", "FloorSurface", "CeilingSurface"})  # fmt: skip
_INDOORS = frozenset({"InteriorWallSurface", "FloorSurface", "CeilingSurface"})


class CityGmlBuildings:
    """Reads CityGML."""

    name = "CityGML (.gml, .citygml, .xml)"

    def matches(self, path: Path) -> bool:
        """Tell by the name."""
        return path.suffix.lower() in (".gml", ".citygml", ".xml") and not path.name.lower().endswith(".osm.xml")

    def read(self, path: Path) -> BuildingFeatures:
        """Read the buildings; see :func:`read_citygml`."""
        return read_citygml(path)


def read_citygml(path: Path | str) -> BuildingFeatures:
    """Read all ``Building`` and ``BuildingPart`` features.

    Their footprint follows from ground surfaces, else from wall surfaces, else from all surfaces (a block model). The
    height is the measured one, else that of the surfaces. Where ``srsName`` is a URN or URL, coordinates are in the
    order of the authority; where it is short, as ``EPSG:31467``, the easting is first.

    Parameters
    ----------
    path : Path or str
        The file.

    Raises
    ------
    DataError
        If the file is missing, damaged, no CityGML, declares a document type, or is larger than any place.
    MissingLibraryError
        If lxml is not installed.
    """
    path = Path(path)
    checked_size(path)
    etree = optional("lxml.etree")
    found = BuildingFeatures()
    systems: dict[str, int] = {}
    kinds = [space + kind for space in _BUILDING for kind in ("Building", "BuildingPart")]
    root = ""
    try:
        events = etree.iterparse(
            str(path), ("end",), tag=[*kinds, *_MEMBERS, _GML + "Envelope"],
            resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False, remove_comments=True,
        )  # fmt: skip
        for _, element in events:
            if element.getroottree().docinfo.doctype:
                raise DataError(f"{path}: declares a document type, which CityGML has not; export it again")
            if (name := element.get("srsName")) is not None:
                systems[name] = systems.get(name, 0) + 1
            if element.tag in kinds:
                _keep(element, found, systems)
                element.clear()
            elif element.tag in _MEMBERS:
                _forget(element)
        root = etree.QName(events.root).localname if events.root is not None else ""
    except etree.XMLSyntaxError as error:
        reason = " ".join(str(error).split())[:160]
        raise DataError(f"{path}: damaged, or no XML ({reason}); export it again") from error
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error}); export it again") from error
    if not found.features and not found.left_out:
        raise DataError(f"{path}: holds no building of CityGML 1 or 2 (its root is '{root}'); export it as one of them")
    _name_system(path, found, systems)
    return found


def _forget(member: Any) -> None:
    """Let go of a member and of those before it, buildings or not: a city is larger than what is kept of it."""
    member.clear()
    while member.getprevious() is not None:
        del member.getparent()[0]


def _keep(element: Any, found: BuildingFeatures, systems: dict[str, int]) -> None:
    surfaces: list[Surface] = []
    for kind, polygon in _polygons(element, ""):
        for carrier in polygon.iter():
            if isinstance(carrier.tag, str) and (name := carrier.get("srsName")) is not None:
                systems[name] = systems.get(name, 0) + 1
        try:
            rings = tuple(_points(ring) for ring in polygon.iter(_GML + "LinearRing"))
        except ValueError:
            found.left_out["surfaces whose coordinates are no numbers"] += 1
            continue
        if rings and len(rings[0]) >= 3:
            surfaces.append(Surface(kind, rings))
        else:
            found.left_out["surfaces without an outline"] += 1
    is_part = element.tag.endswith("BuildingPart")
    has_parts = any(element.find(f"{space}consistsOfBuildingPart") is not None for space in _BUILDING)
    if not surfaces:
        # What consists of parts has been read with them.
        found.left_out["buildings without surfaces"] += int(not has_parts)
        return
    name = element.findtext(_GML + "name") or element.get(_GML + "id") or ""
    found.add(footprint_of(surfaces), _measured(element) or rise_of(surfaces), name.strip(), is_part)


def _polygons(element: Any, kind: str) -> Iterator[tuple[str, Any]]:
    """Polygons of an element with the kind of their surface, without those of its parts, openings and rooms."""
    for child in element:
        if not isinstance(child.tag, str):
            continue
        local = child.tag.rpartition("}")[2]
        if child.tag == _GML + "Polygon":
            yield kind, child
        elif local in ("consistsOfBuildingPart", "opening", "interiorRoom", "outerBuildingInstallation", "address"):
            continue
        elif local not in _INDOORS:
            yield from _polygons(child, "FootPrint" if local == "lod0FootPrint" else local if local in _KINDS else kind)


def _points(ring: Any) -> Array:
    """Corners of a ring, shape (N, 3); heights are 0 in the plane."""
    text, dimension = [], 0
    for element in ring:
        local = element.tag.rpartition("}")[2]
        if local in ("posList", "pos", "coordinates"):
            text.append((element.text or "").replace(",", " "))
            dimension = int(element.get("srsDimension") or dimension)
    values = np.array(" ".join(text).split(), np.float64)
    single = all(element.tag.rpartition("}")[2] == "pos" for element in ring) and len(text) > 0
    dimension = dimension or (len(values) // len(text) if single else 3)
    if dimension not in (2, 3) or len(values) % dimension:
        raise ValueError("coordinates")
    points = values.reshape(-1, dimension)
    return points if dimension == 3 else np.column_stack([points, np.zeros(len(points))])


def _measured(element: Any) -> float | None:
    for space in _BUILDING:
        text = element.findtext(space + "measuredHeight")
        try:
            height = float(text) if text is not None else 0.0
        except ValueError:
            height = 0.0
        if 0 < height < np.inf:
            return height
    return None


def _name_system(path: Path, found: BuildingFeatures, systems: dict[str, int]) -> None:
    """Take over the coordinate system, and put the easting first."""
    if len(systems) > 1:
        resolved = {coordinate_system(path, name).to_wkt() for name in systems}
        if len(resolved) > 1:
            raise DataError(f"{path}: names {len(resolved)} coordinate systems ({', '.join(systems)[:120]}); split it")
    if not systems:
        return
    found.crs = next(iter(systems))
    if not is_north_first(coordinate_system(path, found.crs)):
        return
    if ":def:" in found.crs or "/def/" in found.crs:
        found.swap_axes()
    else:
        found.notes.append(f"{found.crs} is taken to have the easting first; --swap-axes turns it round")
