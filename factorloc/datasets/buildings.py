"""Open a building map without knowing its format, and bring it into a local metric frame."""

from __future__ import annotations

import warnings
from collections import Counter
from pathlib import Path
from typing import Protocol

import numpy as np
import shapely

from factorloc.datasets.axis_order import look_swapped
from factorloc.datasets.building_features import BuildingFeature, BuildingFeatures
from factorloc.datasets.citygml import CityGmlBuildings
from factorloc.datasets.cityjson import CityJsonBuildings
from factorloc.datasets.map_projection import Projection, coordinate_system
from factorloc.datasets.osm_buildings import OsmBuildings
from factorloc.datasets.vector_buildings import VectorBuildings
from factorloc.errors import DataError, FactorlocWarning
from factorloc.mapping import BuildingOutlines, Outline

__all__ = ["BUILDING_READERS", "BuildingReader", "read_buildings"]

_SMALLEST = 1.0  # m^2; less is no building


class BuildingReader(Protocol):
    """What reads the buildings of one format."""

    @property
    def name(self) -> str:
        """The format and its file endings, as named in messages."""

    def matches(self, path: Path) -> bool:
        """Tell from a path, without opening a file, whether this reader is meant."""

    def read(self, path: Path) -> BuildingFeatures:
        """Read the buildings in the coordinates of the file, x (longitude, easting) first where it tells the order.

        Raises
        ------
        DataError
            If it cannot be read.
        """


BUILDING_READERS: tuple[BuildingReader, ...] = (
    OsmBuildings(),
    CityJsonBuildings(),
    CityGmlBuildings(),
    VectorBuildings(),
)
"""Every format known, in the order they are asked."""


def read_buildings(
    path: Path | str,
    *,
    crs: str | None = None,
    swap_axes: bool = False,
    origin: tuple[float, float] | None = None,
    datum: str = "EPSG:4326",
    attribution: str | None = None,
) -> BuildingOutlines:
    """Read the buildings of a map into a local metric frame: OpenStreetMap, GeoJSON, GeoPackage, Shapefile, CityGML.

    The frame is a transverse Mercator map about the origin (see :class:`factorloc.mapping.LocalFrame`). The stated
    accuracy of the way there is part of it, and so becomes part of the uncertainty of a facade map.

    Parameters
    ----------
    path : Path or str
        The file.
    crs : str, optional
        Coordinate system, as ``EPSG:25832``, instead of what the file says, if it says anything.
    swap_axes : bool
        Whether the file has its coordinates in the other order than its system.
    origin : (float, float), optional
        Longitude and latitude of the local origin, degrees; the middle of all outlines by default.
    datum : str
        Geographic system that the frame is tied to: WGS 84 by default, as satellite receivers; ``file`` keeps that of
        the file, and then nothing is lost to a transformation.
    attribution : str, optional
        Whom every picture and report has to name, instead of what the file tells.

    Warns
    -----
    FactorlocWarning
        With counts, if outlines were mended or shapes left out, or if a datum grid is missing.

    Raises
    ------
    DataError
        If no format fits, the file cannot be read, names no coordinate system, has latitudes and longitudes swapped,
        coordinates that are no places, or no building.
    MissingLibraryError
        If a library of the extra ``gis`` is not installed.
    """
    path = Path(path)
    reader = next((known for known in BUILDING_READERS if known.matches(path)), None)
    if reader is None:
        formats = "; ".join(known.name for known in BUILDING_READERS)
        raise DataError(f"{path}: no known format of building maps; known are: {formats}")
    found = reader.read(path)
    if attribution is not None:
        found.attribution = attribution
    name = crs or found.crs
    if name is None:
        raise DataError(f"{path}: names no coordinate system; give it with --crs, as EPSG:25832")
    if crs is not None and found.crs is not None and coordinate_system(path, crs) != coordinate_system(path, found.crs):
        found.notes.append(f"taken to be in {crs} instead of {found.crs}")
    if not found.features:
        counts = ", ".join(f"{count} {reason}" for reason, count in found.left_out.items()) or "nothing at all"
        raise DataError(f"{path}: no building outline, but {counts}; export another place, or with its buildings")
    return _localized(path, found, name, swap_axes, origin, datum)


def _localized(
    path: Path,
    found: BuildingFeatures,
    crs: str,
    swap_axes: bool,
    origin: tuple[float, float] | None,
    datum: str,
) -> BuildingOutlines:
    system = coordinate_system(path, crs)
    if swap_axes:
        found.swap_axes()
    pieces, mended = _polygons(found.features, found.left_out)
    if not pieces:
        raise DataError(f"{path}: none of {len(found.features)} outlines encloses an area; export it again")
    polygons = [polygon for polygon, _ in pieces]
    bounds = np.asarray(shapely.total_bounds(np.array(polygons, dtype=object)), np.float64)
    if system.is_geographic:
        _check_degrees(path, polygons, bounds)
    projection = Projection.about(path, system, bounds, origin, datum)
    outlines = []
    together = shapely.transform(np.array(polygons, dtype=object), lambda xy: projection.local(path, xy))
    for moved, (_, feature) in zip(together, pieces, strict=True):
        if not moved.is_valid:  # rounding, where an outline all but touches itself
            moved = max(shapely.get_parts(shapely.make_valid(moved)), key=lambda part: part.area)
        if moved.geom_type != "Polygon" or moved.area < _SMALLEST:
            found.left_out[f"outlines of less than {_SMALLEST:g} m²"] += 1
        else:
            outlines.append(Outline(moved, feature.height, feature.name, feature.is_part))
    if not outlines:
        raise DataError(
            f"{path}: all {len(pieces)} outlines are smaller than {_SMALLEST:g} m²; is --crs the right one?"
        )
    left_out = {reason: count for reason, count in found.left_out.items() if count}
    deeds = {"mended crossing outlines": mended} if mended else {}
    notes = (*found.notes, *projection.notes)
    result = BuildingOutlines(tuple(outlines), projection.frame, found.attribution, path.name, left_out, deeds, notes)
    if left_out or deeds:
        said = [f"left out {count} {reason}" for reason, count in left_out.items()]
        said += [f"{deed}: {count}" for deed, count in deeds.items()]
        warnings.warn(f"{path}: {', '.join(said)}", FactorlocWarning, stacklevel=3)
    return result


def _polygons(
    features: list[BuildingFeature], left_out: Counter[str]
) -> tuple[list[tuple[shapely.Polygon, BuildingFeature]], int]:
    """Valid polygons of all features, and how many outlines crossed themselves."""
    pieces = []
    mended = 0
    for feature in features:
        shape = feature.shape
        if not shape.is_valid:
            mended += 1
            shape = shapely.make_valid(shape)
        parts = [part for part in shapely.get_parts(shapely.get_parts(shape)) if isinstance(part, shapely.Polygon)]
        parts = [part for part in parts if part.area > 0]
        if not parts:
            left_out["outlines without an area"] += 1
        pieces += [(part, feature) for part in parts]
    return pieces, mended


def _check_degrees(path: Path, polygons: list[shapely.Polygon], bounds: np.ndarray) -> None:
    x0, y0, x1, y1 = bounds.tolist()
    if max(abs(x0), abs(x1)) > 180 or max(abs(y0), abs(y1)) > 90:
        far = max(abs(y0), abs(y1)) > 90 and max(abs(x0), abs(x1)) <= 90 and max(abs(y0), abs(y1)) <= 180
        hint = "latitude and longitude are swapped: --swap-axes mends that" if far else "name their system with --crs"
        raise DataError(f"{path}: coordinates up to ({x1:g}, {y1:g}) are no longitudes and latitudes; {hint}")
    if look_swapped(polygons):
        raise DataError(
            f"{path}: around ({x1:g}, {y1:g}) buildings have no right angles, but they do with latitude and longitude "
            "swapped; give --swap-axes"
        )
