"""CityJSON 1 and 2: buildings in LOD 0 to 2."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from factorloc.datasets.building_features import BuildingFeatures, checked_size
from factorloc.datasets.surface_footprint import Surface, footprint_of, rise_of
from factorloc.errors import DataError

__all__ = ["CityJsonBuildings", "read_cityjson"]

Array = npt.NDArray[np.float64]

_MOST_BYTES = 512 * 2**20
_DEPTH = {"MultiSurface": 1, "CompositeSurface": 1, "Solid": 2, "MultiSolid": 3, "CompositeSolid": 3}
"""How many lists stand around the surfaces of a geometry."""


class CityJsonBuildings:
    """Reads CityJSON."""

    name = "CityJSON (.city.json, .cityjson, .json)"

    def matches(self, path: Path) -> bool:
        """Tell by the name; a plain ``.json`` says at its beginning what it is."""
        if path.name.lower().endswith((".city.json", ".cityjson")):
            return True
        if path.suffix.lower() != ".json" or not path.is_file():
            return False
        with path.open("rb") as stream:
            return b'"CityJSON"' in stream.read(4096)

    def read(self, path: Path) -> BuildingFeatures:
        """Read the buildings; see :func:`read_cityjson`."""
        return read_cityjson(path)


def read_cityjson(path: Path | str) -> BuildingFeatures:
    """Read all ``Building`` and ``BuildingPart`` objects, from the geometry of the highest level of detail up to 2.

    Footprints and heights follow from surfaces as in CityGML. Vertices have the easting first.

    Parameters
    ----------
    path : Path or str
        The file.

    Raises
    ------
    DataError
        If the file is missing, damaged, no CityJSON, or larger than any place.
    """
    path = Path(path)
    checked_size(path, _MOST_BYTES)
    try:
        document = json.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:
        raise DataError(f"{path}: no CityJSON ({' '.join(str(error).split())[:160]}); export it again") from error
    if not isinstance(document, dict) or document.get("type") != "CityJSON":
        raise DataError(f"{path}: no CityJSON; expected an object of the type 'CityJSON'")
    objects = document.get("CityObjects")
    if not isinstance(objects, dict):
        raise DataError(f"{path}: member 'CityObjects' is missing or no object; export it again")
    vertices = _vertices(path, document)
    found = BuildingFeatures(crs=_system(document))
    for name, thing in objects.items():
        if not isinstance(thing, dict) or thing.get("type") not in ("Building", "BuildingPart"):
            found.left_out["objects that are no buildings"] += 1
            continue
        try:
            surfaces = list(_surfaces(thing, vertices))
        except (TypeError, ValueError, LookupError, AttributeError):
            found.left_out["buildings whose surfaces are damaged"] += 1
            continue
        if not surfaces:
            found.left_out["buildings without surfaces"] += int(not thing.get("children"))
            continue
        height = _measured(thing) or rise_of(surfaces)
        found.add(footprint_of(surfaces), height, str(name), thing["type"] == "BuildingPart")
    return found


def _vertices(path: Path, document: dict[str, Any]) -> Array:
    try:
        vertices = np.array(document["vertices"], np.float64).reshape(-1, 3)
        if (transform := document.get("transform")) is not None:
            vertices = vertices * np.array(transform["scale"], np.float64) + np.array(
                transform["translate"], np.float64
            )
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(f"{path}: 'vertices' or 'transform' are no numbers (x, y, z); export it again") from error
    if vertices.ndim != 2 or not np.isfinite(vertices).all():
        raise DataError(f"{path}: member 'vertices' holds values that are not finite; export it again")
    return vertices


def _system(document: dict[str, Any]) -> str | None:
    metadata = document.get("metadata")
    name = metadata.get("referenceSystem") if isinstance(metadata, dict) else None
    return name if isinstance(name, str) and name else None


def _surfaces(thing: dict[str, Any], vertices: Array) -> Iterator[Surface]:
    geometries = [g for g in thing.get("geometry", []) if g.get("type") in _DEPTH and float(str(g["lod"])[:3]) < 3]
    if not geometries:
        return
    geometry = max(geometries, key=lambda g: float(str(g["lod"])[:3]))
    semantics = geometry.get("semantics") or {}
    kinds = [str(surface.get("type", "")) for surface in semantics.get("surfaces", [])]
    depth = _DEPTH[geometry["type"]]
    boundaries = _flat(geometry["boundaries"], depth - 1)
    values = _flat(semantics["values"], depth - 1) if kinds else [None] * len(boundaries)
    for rings, value in zip(boundaries, values, strict=True):
        corners = tuple(vertices[_indices(ring, len(vertices))] for ring in rings)
        if corners and len(corners[0]) >= 3:
            yield Surface(kinds[value] if value is not None else "", corners)


def _flat(nested: Any, times: int) -> list[Any]:
    for _ in range(times):
        nested = [inner for outer in nested for inner in (outer if outer is not None else [])]
    return list(nested)


def _indices(ring: Any, count: int) -> npt.NDArray[np.int64]:
    indices = np.array(ring, np.int64)
    if indices.ndim != 1 or (indices < 0).any() or (indices >= count).any():
        raise ValueError("vertex index")
    return indices


def _measured(thing: dict[str, Any]) -> float | None:
    attributes = thing.get("attributes")
    value = attributes.get("measuredHeight") if isinstance(attributes, dict) else None
    return float(value) if isinstance(value, int | float) and 0 < value < np.inf else None
