"""Buildings as a file has them: shapes in its own coordinates, and the account of what it holds besides."""

from __future__ import annotations

import importlib
import math
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from factorloc.errors import DataError, MissingLibraryError

__all__ = ["MAX_MAP_BYTES", "BuildingFeature", "BuildingFeatures", "checked_size", "height_of", "optional"]

MAX_MAP_BYTES = 2 * 2**30
"""A building map may have this many bytes; more is no place that a vehicle is localized in."""

_STOREY = 3.0  # m of height for each of building:levels
_NUMBER = re.compile(r"\s*([0-9]+(?:\.[0-9]*)?|\.[0-9]+)\s*(?:m|metres|meters)?\s*")


@dataclass(frozen=True)
class BuildingFeature:
    """A building, or a part of one.

    Parameters
    ----------
    shape : shapely.Geometry
        Its outline or outlines, in the coordinates of the file, x before y (longitude before latitude); may cross
        itself.
    height : float, optional
        Height, m.
    name : str
        What the file calls it.
    is_part : bool
        Whether the file calls it a part of a building.
    """

    shape: shapely.Geometry
    height: float | None = None
    name: str = ""
    is_part: bool = False


@dataclass
class BuildingFeatures:
    """All buildings of a file.

    Parameters
    ----------
    features : list of BuildingFeature
        They.
    crs : str, optional
        Coordinate system, as pyproj takes it; None where the file names none.
    attribution : str
        Whom every picture and report has to name.
    left_out : Counter
        What was not used, by reason.
    notes : list of str
        Assumptions made where the file is silent.
    """

    features: list[BuildingFeature] = field(default_factory=list)
    crs: str | None = None
    attribution: str = ""
    left_out: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)

    def add(self, shape: shapely.Geometry, height: float | None, name: str, is_part: bool = False) -> None:
        """Keep a shape with an area whose coordinates are numbers; count any other."""
        coordinates = shapely.get_coordinates(shape)
        if shape.geom_type not in ("Polygon", "MultiPolygon") or not len(coordinates):
            self.left_out["shapes without an area"] += 1
        elif not np.isfinite(coordinates).all():
            self.left_out["shapes whose coordinates are not finite"] += 1
        else:
            self.features.append(BuildingFeature(shapely.force_2d(shape), height, name, is_part))

    def swap_axes(self) -> None:
        """Exchange x and y of all shapes."""
        swapped = shapely.transform([feature.shape for feature in self.features], lambda xy: xy[:, ::-1])
        self.features = [replace(f, shape=shape) for f, shape in zip(self.features, swapped, strict=True)]


def height_of(properties: Mapping[str, Any]) -> float | None:
    """Height, m, from ``height``, else ``building:levels`` times 3 m; what is no positive length counts as missing."""
    for key, unit in (("height", 1.0), ("building:levels", _STOREY)):
        value = properties.get(key)
        match = _NUMBER.fullmatch(str(value)) if value is not None else None
        if match and 0 < float(match[1]) * unit < math.inf:
            return float(match[1]) * unit
    return None


def optional(library: str) -> Any:
    """Import a library of the extra ``gis``.

    Raises
    ------
    MissingLibraryError
        If it is not installed.
    """
    try:
        return importlib.import_module(library)
    except ImportError as error:
        package = library.partition(".")[0]
        raise MissingLibraryError(
            f"{package} is not installed, and building maps need it: pip install 'factorloc[gis]'"
        ) from error


def checked_size(path: Path, limit: int = MAX_MAP_BYTES) -> int:
    """Size of a file, bytes.

    Raises
    ------
    DataError
        If there is none, it is empty, or larger than the limit.
    """
    if not path.is_file():
        raise DataError(f"{path}: {'is a folder; name a file' if path.is_dir() else 'no such file'}")
    size = path.stat().st_size
    if size == 0:
        raise DataError(f"{path}: is empty; export it again")
    if size > limit:
        raise DataError(f"{path}: {size >> 20} MiB, more than {limit >> 20}; cut out the place that is driven through")
    return size
