"""GeoJSON, GeoPackage and Shapefile: buildings as polygons with properties, read by GDAL."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from factorloc.datasets.building_features import BuildingFeatures, checked_size, height_of, optional
from factorloc.datasets.osm_buildings import OSM_ATTRIBUTION
from factorloc.errors import DataError

__all__ = ["VectorBuildings", "read_vector_buildings"]

_DRIVERS = {".geojson": "GeoJSON", ".json": "GeoJSON", ".gpkg": "GPKG", ".shp": "ESRI Shapefile"}
_MOST = 5_000_000  # outlines
_MOST_TEXT = 512 * 2**20  # bytes of JSON, which unfold about tenfold
_NAMES = ("name", "Name", "NAME", "id", "gml_id", "osm_id")
_HEIGHTS = ("height", "HEIGHT", "Height", "building:height", "measuredHeight", "measuredheight")
_LEVELS = ("building:levels", "building_levels", "levels", "storeys", "storeysAboveGround")


class VectorBuildings:
    """Reads polygons of GeoJSON, GeoPackage and Shapefile."""

    name = "GeoJSON (.geojson, .json), GeoPackage (.gpkg), Shapefile (.shp)"

    def matches(self, path: Path) -> bool:
        """Tell by the name."""
        return path.suffix.lower() in _DRIVERS

    def read(self, path: Path) -> BuildingFeatures:
        """Read the buildings; see :func:`read_vector_buildings`."""
        return read_vector_buildings(path)


def read_vector_buildings(path: Path | str, layer: str | None = None) -> BuildingFeatures:
    """Read all polygons of a layer.

    Heights come from a property ``height`` (m), else from ``building:levels`` times 3 m, or from what other producers
    call them. Coordinates have the easting or the longitude first, as these formats want it.

    Parameters
    ----------
    path : Path or str
        The file. Only its own format is tried, so that it cannot pass for one that opens others.
    layer : str, optional
        Layer of a GeoPackage; the only one by default.

    Raises
    ------
    DataError
        If the file is missing, damaged, too large, or has several layers and none is named.
    MissingLibraryError
        If pyogrio is not installed.
    """
    path = Path(path)
    checked_size(path)
    pyogrio = optional("pyogrio")
    attribution = _checked_document(path) if path.suffix.lower() in (".geojson", ".json") else ""
    source: Any = path
    try:
        layers = pyogrio.list_layers(source)[:, 0].tolist()
        if layer is None and len(layers) != 1:
            raise DataError(f"{path}: has {len(layers)} layers ({', '.join(map(str, layers))[:200]}); export one alone")
        facts = pyogrio.read_info(source, layer=layer)
        if facts["driver"] != _DRIVERS[path.suffix.lower()]:
            raise DataError(f"{path}: is of the format {facts['driver']}, not what its ending says; rename it")
        if facts["features"] > _MOST:
            raise DataError(f"{path}: {facts['features']} features; cut out the place that is driven through")
        kept = [name for name in facts["fields"].tolist() if name in (*_NAMES, *_HEIGHTS, *_LEVELS)]
        meta, _, shapes, columns = pyogrio.raw.read(source, layer=layer, columns=kept)
    except (pyogrio.errors.DataSourceError, pyogrio.errors.DataLayerError, ValueError, OSError) as error:
        if isinstance(error, DataError):
            raise
        reason = " ".join(str(error).split())[:160]
        raise DataError(f"{path}: damaged, or not what its ending says ({reason}); export it again") from error
    found = BuildingFeatures(crs=meta["crs"], attribution=attribution or (OSM_ATTRIBUTION if _is_osm(facts) else ""))
    rows = dict(zip(meta["fields"].tolist(), columns, strict=True))
    if shapes is None:
        return found
    geometries = shapely.from_wkb(shapes, on_invalid="ignore")
    for number, shape in enumerate(geometries):
        if shape is None:
            found.left_out["features without a shape"] += 1
            continue
        properties = {name: values[number] for name, values in rows.items()}
        found.add(shape, _height(properties), _name(properties))
    return found


def _height(properties: dict[str, Any]) -> float | None:
    def first(names: tuple[str, ...]) -> Any:
        return next((v for n in names if (v := properties.get(n)) is not None and v == v), None)

    return height_of({"height": first(_HEIGHTS), "building:levels": first(_LEVELS)})


def _name(properties: dict[str, Any]) -> str:
    return next((str(v) for n in _NAMES if (v := properties.get(n)) is not None and v == v and str(v)), "")


def _is_osm(facts: dict[str, Any]) -> bool:
    """Whether the file is from OpenStreetMap: exports keep its identifiers or its tags."""
    fields = {str(name).lower() for name in np.asarray(facts["fields"]).tolist()}
    return bool(fields & {"osm_id", "osm_way_id", "osm_type", "@id", "building:levels"})


def _checked_document(path: Path) -> str:
    """Refuse what is no GeoJSON in words that name the fault, as GDAL passes over some; returns the attribution."""
    checked_size(path, _MOST_TEXT)
    try:
        document = json.loads(path.read_text(encoding="utf-8-sig"), parse_constant=_no_constant)
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror})") from error
    except (ValueError, RecursionError) as error:
        raise DataError(f"{path}: not GeoJSON ({' '.join(str(error).split())[:160]}); export it again") from error
    if not isinstance(document, dict) or "type" not in document:
        raise DataError(f"{path}: not GeoJSON; expected an object with a member 'type'")
    if document["type"] == "FeatureCollection" and not isinstance(document.get("features"), list):
        raise DataError(f"{path}: member 'features' is no list; export it as a FeatureCollection")
    named = document.get("attribution")
    return named if isinstance(named, str) else ""


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is no number of JSON")
