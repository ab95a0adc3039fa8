"""Footprints: outlines of buildings from a file, in a local metric frame, and the world extruded from them."""

from __future__ import annotations

import json
import math
import re
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import shapely.geometry
import shapely.ops

from factorloc.errors import DataError, FactorlocWarning, SimulationError
from factorloc.simulation.buildings import building
from factorloc.simulation.facades import FacadeSettings
from factorloc.simulation.ground import Ground
from factorloc.simulation.scene import Scene
from factorloc.simulation.streams import stream

__all__ = ["Footprint", "Footprints", "read_footprints"]

_STOREY = 3.0  # m of height for each of building:levels
_ROOM = 30.0  # m of ground around the outermost building
_LARGEST = 100_000.0  # m; a transverse Mercator frame that reaches farther bends distances by more than 0.01 %
_NUMBER = re.compile(r"\s*([0-9]+(?:\.[0-9]*)?|\.[0-9]+)\s*(?:m|metres|meters)?\s*")


@dataclass(frozen=True)
class Footprint:
    """Outline of one building.

    Parameters
    ----------
    polygon : shapely.Polygon
        Outline in the local frame, m; may have courtyards.
    height : float
        Height of the building, m.
    name : str
        What the file calls it.
    """

    polygon: shapely.Polygon
    height: float
    name: str = ""


@dataclass(frozen=True)
class Footprints:
    """Buildings of a place.

    Parameters
    ----------
    buildings : tuple of Footprint
        Their outlines, x east and y north of the origin.
    origin : (float, float)
        Longitude and latitude of the local frame's origin, degrees; of a file in metric coordinates, easting and
        northing, m.
    crs : str
        Coordinate system of the file.
    """

    buildings: tuple[Footprint, ...]
    origin: tuple[float, float]
    crs: str

    def scene(self, facade: FacadeSettings | None = None, seed: int = 0) -> Scene:
        """Extrude the buildings; walls have windows wherever nothing stands close before them.

        Parameters
        ----------
        facade : FacadeSettings, optional
            How facades are built.
        seed : int
            Chooses doors and balconies, for each building on its own.
        """
        outlines = shapely.union_all([footprint.polygon for footprint in self.buildings])
        x0, y0, x1, y1 = outlines.bounds
        area = shapely.box(x0 - _ROOM, y0 - _ROOM, x1 + _ROOM, y1 + _ROOM)
        open_space = area.difference(outlines)
        shapely.prepare(open_space)
        raised = (
            building(f.polygon, f.height, stream(seed, "house", n), facade, 0.0, open_space, f.name or f"house {n}")
            for n, f in enumerate(self.buildings)
        )
        return Scene(Ground(area), tuple(raised))


def read_footprints(
    path: Path | str, default_height: float = 9.0, origin: tuple[float, float] | None = None
) -> Footprints:
    """Read a GeoJSON file (RFC 7946).

    Heights come from the properties ``height`` (metres), else ``building:levels`` times 3 m, else the default.
    Geographic coordinates, the format's default, are projected by a transverse Mercator map about the origin; a file
    that names a projected system in the old member ``crs`` is only shifted.

    Parameters
    ----------
    path : Path or str
        The file.
    default_height : float
        Height of buildings that have none, m.
    origin : (float, float), optional
        Longitude and latitude, degrees, or easting and northing, m, of the local origin; the middle of all outlines by
        default.

    Warns
    -----
    FactorlocWarning
        With counts, if features that are no polygons were left out or crossing outlines mended.

    Raises
    ------
    DataError
        If the file is missing, not GeoJSON, has no polygon, or coordinates that are no places.
    SimulationError
        If the default height is not positive.
    """
    path = Path(path)
    if not 0 < default_height < math.inf:
        raise SimulationError(f"default_height: {default_height} m; must be positive and finite")
    document = _document(path)
    found: list[tuple[shapely.Polygon, float, str]] = []
    left_out = mended = 0
    for number, (geometry, properties) in enumerate(_features(path, document)):
        if geometry is None or geometry.get("type") not in ("Polygon", "MultiPolygon"):
            left_out += 1
            continue
        shape = _shape(path, number, geometry)
        if not shape.is_valid:
            mended += 1
            shape = shapely.make_valid(shape)
        name, height = str(properties.get("name") or properties.get("id") or ""), _height(properties, default_height)
        parts = [part for part in shapely.get_parts(shapely.get_parts(shape)) if isinstance(part, shapely.Polygon)]
        found += [(part, height, name) for part in parts if not part.is_empty]
    if not found:
        raise DataError(f"{path}: no building outline among {left_out} features; export polygons")
    if left_out or mended:
        warnings.warn(
            f"{path}: left out {left_out} features that are no polygons, mended {mended} crossing outlines",
            FactorlocWarning,
            stacklevel=2,
        )
    crs = _crs(path, document)
    projected, origin = _local(path, [polygon for polygon, _, _ in found], crs, origin)
    rows = zip(projected, found, strict=True)
    return Footprints(tuple(Footprint(polygon, height, name) for polygon, (_, height, name) in rows), origin, crs)


def _document(path: Path) -> Mapping[str, Any]:
    try:
        document = json.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror})") from error
    except (ValueError, RecursionError) as error:
        raise DataError(f"{path}: not GeoJSON ({error})") from error
    if not isinstance(document, dict) or "type" not in document:
        raise DataError(f"{path}: not GeoJSON; expected an object with a member 'type'")
    return document


def _features(path: Path, document: Mapping[str, Any]) -> Iterator[tuple[Mapping[str, Any] | None, Mapping[str, Any]]]:
    """Geometry and properties of each feature."""
    kind = document["type"]
    features = document.get("features") if kind == "FeatureCollection" else [document]
    if not isinstance(features, list):
        raise DataError(f"{path}: member 'features' is no list; export it as a FeatureCollection")
    for number, feature in enumerate(features):
        if not isinstance(feature, dict):
            raise DataError(f"{path}: feature {number} is no object; export it again")
        geometry = feature.get("geometry") if feature.get("type") == "Feature" else feature
        properties = feature.get("properties")
        yield geometry if isinstance(geometry, dict) else None, properties if isinstance(properties, dict) else {}


def _shape(path: Path, number: int, geometry: Mapping[str, Any]) -> shapely.Geometry:
    try:
        with np.errstate(invalid="ignore"):  # what is not finite is refused below
            shape = shapely.force_2d(shapely.geometry.shape(geometry))
    except (ValueError, TypeError, LookupError, AttributeError, shapely.errors.ShapelyError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise DataError(f"{path}: coordinates of feature {number} are no polygon ({reason})") from error
    if not np.isfinite(shapely.get_coordinates(shape)).all():
        raise DataError(f"{path}: coordinates of feature {number} are not finite; export it again")
    return shape


def _height(properties: Mapping[str, Any], default: float) -> float:
    """Height, m; what is no positive length counts as missing."""
    for key, unit in (("height", 1.0), ("building:levels", _STOREY)):
        match = _NUMBER.fullmatch(str(properties.get(key, "")))
        if match and 0 < float(match[1]) * unit < math.inf:
            return float(match[1]) * unit
    return default


def _crs(path: Path, document: Mapping[str, Any]) -> str:
    member = document.get("crs")
    if member is None:
        return "EPSG:4326"
    try:
        return str(member["properties"]["name"])
    except (TypeError, LookupError) as error:
        raise DataError(f"{path}: member 'crs' names no coordinate system; remove it or export in EPSG:4326") from error


def _local(
    path: Path, polygons: list[shapely.Polygon], crs: str, origin: tuple[float, float] | None
) -> tuple[list[shapely.Polygon], tuple[float, float]]:
    """Polygons in the local frame, m, and its origin in the coordinates of the file."""
    import pyproj  # costs a tenth of a second

    try:
        system = pyproj.CRS.from_user_input(crs)
    except pyproj.exceptions.CRSError as error:
        raise DataError(f"{path}: coordinate system {crs!r} is unknown; export in EPSG:4326") from error
    x0, y0, x1, y1 = shapely.total_bounds(polygons)
    origin = ((x0 + x1) / 2, (y0 + y1) / 2) if origin is None else origin
    origin = (float(origin[0]), float(origin[1]))
    if system.is_geographic:
        if max(abs(x0), abs(x1)) > 180 or max(abs(y0), abs(y1)) > 90:
            raise DataError(
                f"{path}: coordinates up to ({x1:g}, {y1:g}) are no longitudes and latitudes; name their 'crs'"
            )
        local = pyproj.CRS.from_proj4(f"+proj=tmerc +lon_0={origin[0]} +lat_0={origin[1]} +k=1 +ellps=WGS84 +units=m")
        # GeoJSON has the longitude first, whatever the order of axes in the system.
        to_local = pyproj.Transformer.from_crs(system, local, always_xy=True)
        moved = [
            shapely.transform(polygon, lambda xy: np.column_stack(to_local.transform(xy[:, 0], xy[:, 1])))
            for polygon in polygons
        ]
    else:
        unit = system.axis_info[0].unit_conversion_factor
        moved = [shapely.transform(polygon, lambda xy: (xy - origin) * unit) for polygon in polygons]
    coordinates = shapely.get_coordinates(moved)
    if not np.isfinite(coordinates).all() or np.abs(coordinates).max() > _LARGEST:
        raise DataError(f"{path}: outlines reach more than {_LARGEST / 1000:.0f} km from the origin; cut out one place")
    return moved, origin
