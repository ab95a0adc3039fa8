"""GeoJSON of pole maps: points on Earth for map programs, and the exact local coordinates beside them.

RFC 7946 knows one coordinate system, WGS 84 longitude and latitude. The points are written so, to a tenth of a
millimetre; a map without georeference has features without geometry, as the standard provides. What we read again are
the properties: ``x`` and ``y`` in the frame of the map, m, to the last bit. The member ``factorloc`` of the collection
names frame, metric CRS and the pose of the map in it.
"""

from __future__ import annotations

import json
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from factorloc.errors import MapError, MapFormatError
from factorloc.files import write_text
from factorloc.mapping.georeference import WGS84, Georeference, convert
from factorloc.mapping.pole_map import PoleMap
from factorloc.mapping.poles import Poles

__all__ = ["holds_no_outlines", "read_geojson", "write_geojson"]

Array = npt.NDArray[np.float64]

_FORMAT = 1
_DECIMALS = 9  # degrees: 0.1 mm
_MOST_BYTES = 2**28
_DEFAULTS = {"width": 0.2, "bottom": 0.0, "top": 2.0, "score": 1.0}  # what points of another source may not say


def write_geojson(path: Path, pole_map: PoleMap) -> None:
    """Write a map of poles as a collection of GeoJSON points.

    Raises
    ------
    FactorlocError
        If the file cannot be written; what was there stays.
    MapError
        If a pole lies where the coordinate system is not defined.
    """
    poles, place = pole_map.poles, pole_map.georeference
    points: Any = repeat(None)
    if place is not None:
        lonlat = np.round(place.to_lonlat(poles.positions), _DECIMALS).tolist()
        points = [{"type": "Point", "coordinates": pair} for pair in lonlat]
    rows = zip(
        poles.positions.tolist(), poles.widths.tolist(), poles.spans.tolist(), poles.scores.tolist(),
        pole_map.seen.tolist(), pole_map.in_view.tolist(), points, strict=False,
    )  # fmt: skip
    features = [
        {
            "type": "Feature",
            "geometry": point,
            "properties": {
                "x": x, "y": y, "width": width, "bottom": bottom, "top": top, "score": score,
                "seen": seen, "in_view": in_view,
            },
        }
        for (x, y), width, (bottom, top), score, seen, in_view, point in rows
    ]  # fmt: skip
    account: dict[str, Any] = {"format": _FORMAT, "frame": pole_map.frame, "sessions": list(pole_map.sessions)}
    if place is not None:
        account |= {"crs": place.crs, "T_crs_map": place.T_crs_map.tolist()}
    account["provenance"] = pole_map.provenance
    head = json.dumps(account, allow_nan=False)
    lines = ",\n".join(json.dumps(feature, allow_nan=False) for feature in features)
    write_text(path, f'{{"type": "FeatureCollection", "factorloc": {head}, "features": [\n{lines}\n]}}\n')


def read_geojson(path: Path) -> PoleMap:
    """Read a map of poles from GeoJSON, our own or points of another source.

    Points of another source are placed in a local frame, x east and y north, around their middle. Their properties
    ``width``, ``bottom``, ``top`` (m) and ``score`` are taken where they are there. A ``crs`` member, which GeoJSON had
    before RFC 7946, is followed.

    Raises
    ------
    MapFormatError
        If the file is missing, no GeoJSON, damaged or newer, or has something else than points.
    """
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise MapFormatError(f"{path}: larger than {_MOST_BYTES >> 20} MiB; is it a map of poles?")
        collection = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise MapFormatError(f"{path}: no such file; name a map of poles") from error
    except OSError as error:
        raise MapFormatError(f"{path}: cannot be read ({error.strerror})") from error
    except (ValueError, RecursionError) as error:
        raise MapFormatError(f"{path}: no GeoJSON ({error}); export it again") from error
    try:
        if collection["type"] != "FeatureCollection":
            raise MapFormatError(f"{path}: holds a {collection['type']!s:.40}; expected a FeatureCollection")
        features = list(collection["features"])
        if "factorloc" in collection:
            return _own(path, collection["factorloc"], features)
        return _foreign(path, collection, features)
    except MapFormatError:
        raise
    except MapError as error:
        raise MapFormatError(f"{path}: {error}") from error
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        reason = f"lacks {error}" if isinstance(error, KeyError) else str(error)
        raise MapFormatError(f"{path}: no map of poles ({reason}); export it again") from error


def holds_no_outlines(path: Path) -> bool:
    """Whether a GeoJSON file may be a map of poles: it holds no lines and no polygons, as building maps do.

    A file that cannot be read may be one, too: its reader says what is wrong.
    """
    try:
        if path.stat().st_size > _MOST_BYTES:
            return False
        features = json.loads(path.read_text(encoding="utf-8"))["features"]
        kinds = {feature["geometry"]["type"] for feature in features if feature["geometry"] is not None}
    except (OSError, ValueError, RecursionError, KeyError, TypeError):
        return True
    return kinds <= {"Point"}


def _own(path: Path, account: dict[str, Any], features: list[Any]) -> PoleMap:
    if int(account["format"]) > _FORMAT:
        raise MapFormatError(
            f"{path}: pole map format {account['format']}, this factorloc reads up to {_FORMAT}; update factorloc"
        )
    properties = [feature["properties"] for feature in features]
    sessions = tuple(map(str, account["sessions"]))
    shape = (len(properties), len(sessions))
    poles = Poles(
        _table(properties, "x", "y"),
        _table(properties, "width")[:, 0],
        _table(properties, "bottom", "top"),
        _table(properties, "score")[:, 0],
    )
    seen, in_view = (
        np.array([row[name] for row in properties], np.int64).reshape(shape) for name in ("seen", "in_view")
    )
    place = Georeference(account["crs"], account["T_crs_map"]) if "crs" in account else None
    provenance = {str(name): str(text) for name, text in account["provenance"].items()}
    return PoleMap(poles, seen, in_view, sessions, str(account["frame"]), place, provenance)


def _foreign(path: Path, collection: dict[str, Any], features: list[Any]) -> PoleMap:
    geometries = [feature["geometry"] for feature in features]
    if any(geometry is None or geometry["type"] != "Point" for geometry in geometries):
        raise MapFormatError(f"{path}: holds something else than points; export the axes of poles as points")
    if not geometries:
        raise MapFormatError(f"{path}: holds no points; export the axes of poles as points")
    coordinates = np.array([geometry["coordinates"][:2] for geometry in geometries], np.float64)
    crs = str(collection["crs"]["properties"]["name"]) if collection.get("crs") else WGS84
    if crs == WGS84 and (np.abs(coordinates) > [180.0, 90.0]).any():
        raise MapFormatError(f"{path}: coordinates are no longitudes and latitudes; name their 'crs'")
    longitude, latitude = convert(coordinates, crs, WGS84).mean(0).tolist()
    place = Georeference.at(latitude, longitude)
    given = [
        {**_DEFAULTS, **{k: v for k, v in (f.get("properties") or {}).items() if k in _DEFAULTS}} for f in features
    ]
    poles = Poles(
        place.from_lonlat(convert(coordinates, crs, WGS84)),
        _table(given, "width")[:, 0],
        _table(given, "bottom", "top"),
        _table(given, "score")[:, 0],
    )
    return PoleMap.of(poles, session=path.stem, georeference=place, provenance={"points of": path.name})


def _table(rows: list[dict[str, Any]], *names: str) -> Array:
    """Columns of numbers; what is no number is refused rather than turned into one."""
    values = [[row[name] for name in names] for row in rows]
    for row in values:
        for name, value in zip(names, row, strict=True):
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                raise TypeError(f"property '{name}' is {value!r:.40}, no number")
    return np.array(values, np.float64).reshape(len(rows), len(names))
