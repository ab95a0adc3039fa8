"""Storage of facade maps: one versioned HDF5 file, laid out as docs/formats.md says; and GeoJSON to look at."""

from __future__ import annotations

import json
import math
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely

from factorloc._version import __version__
from factorloc.errors import MapError, MapFormatError
from factorloc.files import atomic_path, write_text
from factorloc.mapping.facade_map import FacadeMap, MapUncertainty
from factorloc.mapping.facades import Facades
from factorloc.mapping.hdf5 import CheckedFile, create_array, create_text, creating, opening
from factorloc.mapping.local_frame import LocalFrame

__all__ = ["FACADE_KIND", "is_facade_map", "read_facade_map", "write_facade_geojson", "write_facade_map"]

FACADE_KIND = "factorloc facade map"
"""What the file of a facade map says it holds."""

_FORMAT = 1
_MEND = "make it anew with 'factorloc map facades'"
_MOST = 2**27  # facades, corners, rings or buildings
_COUNTS = ("facade_count", "corner_count", "ring_count", "building_count")


def write_facade_map(path: Path | str, facade_map: FacadeMap) -> None:
    """Write a facade map, whole or not at all.

    Raises
    ------
    MapError
        If a text is longer than a map file takes.
    FactorlocError
        If the target cannot be written; what was there stays.
    """
    facades, frame = facade_map.facades, facade_map.frame
    kind, corners, (rings, polygons) = shapely.to_ragged_array(list(facade_map.outlines) or [shapely.Polygon()])
    if kind != shapely.GeometryType.POLYGON:
        raise MapError("facade map: outlines are no polygons")
    arrays = {
        "segments": facades.segments.reshape(-1, 4),
        "buildings": facades.buildings,
        "shifts": facades.shifts,
        "vertex_errors": facades.vertex_errors,
        "heights": facade_map.heights,
        "corners": np.asarray(corners[:, :2], np.float64),
        "rings": np.asarray(rings, np.int64),
        "outlines": np.asarray(polygons, np.int64)[: len(facade_map.outlines) + 1],
    }
    texts = {
        "kind": FACADE_KIND,
        "factorloc": __version__,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "attribution": facade_map.attribution,
        "provenance": json.dumps(dict(facade_map.provenance)),
        "left_out": json.dumps(dict(facade_map.left_out)),
        "datum": "" if frame is None else frame.datum,
    }
    with atomic_path(path) as temporary, creating(temporary) as file:
        for name, text in texts.items():
            create_text(file, name, text)
        counts = (len(facades), len(corners), len(rings) - 1, len(facade_map.outlines))
        for name, count in zip(_COUNTS, counts, strict=True):
            file.attrs[name] = np.int64(count)
        file.attrs["format"] = np.int64(_FORMAT)
        file.attrs["declared"] = np.array([facade_map.uncertainty.shift, facade_map.uncertainty.vertex])
        file.attrs["origin"] = np.array([0.0, 0.0] if frame is None else [frame.longitude, frame.latitude])
        file.attrs["accuracy"] = np.float64(0.0 if frame is None else frame.accuracy)
        for name, values in arrays.items():
            create_array(file, name, np.ascontiguousarray(values))


def is_facade_map(path: Path | str) -> bool:
    """Whether an HDF5 file of this package says that it holds a facade map.

    Raises
    ------
    MapFormatError
        If it is missing, no HDF5 file, or damaged.
    """
    with opening(Path(path), _MEND) as file:
        return "kind" in file.file.attrs and file.text("kind") == FACADE_KIND


def read_facade_map(path: Path | str) -> FacadeMap:
    """Read a facade map; equal to the last bit to what was written.

    Raises
    ------
    MapFormatError
        If the file is missing, damaged, of another kind or newer.
    """
    with opening(Path(path), _MEND) as file:
        if "kind" not in file.file.attrs or file.text("kind") != FACADE_KIND:
            raise file.refused("holds no facade map")
        if (version := file.integer("format")) != _FORMAT:
            raise MapFormatError(
                f"{file.path}: facade map format {version}, this factorloc reads {_FORMAT}; update factorloc"
            )
        try:
            return _facade_map(file)
        except MapFormatError:
            raise
        except MapError as error:
            raise file.refused(str(error)) from error


def _facade_map(file: CheckedFile) -> FacadeMap:
    counts = [file.integer(name) for name in _COUNTS]
    if max(counts) > _MOST:
        raise file.refused(f"declares {max(counts)} facades, corners, rings or buildings")
    facade_count, corner_count, ring_count, building_count = counts

    def values(name: str, dtype: type, *shape: int) -> npt.NDArray[Any]:
        return np.asarray(file.array(name, np.dtype(dtype), shape)[()])

    segments = values("segments", np.float64, facade_count, 4).reshape(-1, 2, 2)
    facades = Facades(
        segments,
        values("buildings", np.int64, facade_count),
        values("shifts", np.float64, facade_count),
        values("vertex_errors", np.float64, facade_count),
    )
    rings = values("rings", np.int64, ring_count + 1)
    outlines = values("outlines", np.int64, building_count + 1)
    for name, offsets, count in (("rings", rings, corner_count), ("outlines", outlines, ring_count)):
        if offsets[0] != 0 or offsets[-1] != count or (np.diff(offsets) <= 0).any():
            raise file.refused(f"'{name}' does not cut up what it should")
    corners = values("corners", np.float64, corner_count, 2)
    polygons = shapely.from_ragged_array(shapely.GeometryType.POLYGON, corners, (rings, outlines))
    if not np.isfinite(corners).all() or not shapely.is_valid(polygons).all():
        raise file.refused("'corners' make outlines that are no polygons")
    shift, vertex = file.vector("declared", "f")
    longitude, latitude = file.vector("origin", "f")
    datum = file.text("datum")
    frame = LocalFrame(longitude, latitude, datum, file.number("accuracy")) if datum else None
    provenance, left_out = json.loads(file.text("provenance")), json.loads(file.text("left_out"))
    if not (isinstance(provenance, dict) and all(type(text) is str for text in provenance.values())):
        raise file.refused("attribute 'provenance' is no JSON object of texts")
    if not (isinstance(left_out, dict) and all(type(count) is int and count >= 0 for count in left_out.values())):
        raise file.refused("attribute 'left_out' is no JSON object of counts")
    return FacadeMap(
        facades,
        tuple(polygons),
        values("heights", np.float64, building_count),
        MapUncertainty(shift, vertex),
        frame,
        file.text("attribution"),
        provenance,
        left_out,
    )


def write_facade_geojson(path: Path | str, facade_map: FacadeMap) -> None:
    """Write buildings as polygons and facades as lines, with their errors, for geographic programs (RFC 7946).

    Parameters
    ----------
    path : Path or str
        Target; replaced when all is written.
    facade_map : FacadeMap
        A map that lies on earth.

    Raises
    ------
    MapError
        If the map has no place on earth, or not one in WGS 84, as the format wants it.
    FactorlocError
        If the target cannot be written.
    """
    frame = facade_map.frame
    if frame is None or frame.datum != "EPSG:4326":
        where = "no place on earth" if frame is None else f"its frame in {frame.datum[:40]}"
        raise MapError(
            f"{path}: GeoJSON is in WGS 84, and the map has {where}; write it as .h5, or with --datum EPSG:4326"
        )
    outlines = shapely.transform(np.array(facade_map.outlines, dtype=object), frame.to_geographic)
    features = []
    for number, (outline, height) in enumerate(zip(outlines, facade_map.heights.tolist(), strict=True)):
        known = {} if math.isnan(height) else {"height": height}
        features.append(_feature(outline, {"kind": "building", "building": number, **known}))
    ends = frame.to_geographic(facade_map.facades.segments.reshape(-1, 2)).reshape(-1, 2, 2)
    f = facade_map.facades
    columns = (ends, f.buildings.tolist(), f.shifts.tolist(), f.vertex_errors.tolist(), f.lengths.tolist())
    for segment, building, shift, vertex, length in zip(*columns, strict=True):
        facts = {"kind": "facade", "building": building, "shift": shift, "vertex_error": vertex, "length": length}
        features.append(_feature(shapely.LineString(segment), facts))
    document = {
        "type": "FeatureCollection",
        "factorloc": __version__,
        "attribution": facade_map.attribution,
        "provenance": dict(facade_map.provenance),
        "left_out": dict(facade_map.left_out),
        "features": features,
    }
    write_text(path, json.dumps(document, ensure_ascii=False, allow_nan=False) + "\n")


def _feature(shape: shapely.Geometry, properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "properties": properties, "geometry": json.loads(shapely.to_geojson(shape))}
