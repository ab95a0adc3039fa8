"""Map projection: from the coordinates of a file to a local metric frame, with the accuracy this has."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from factorloc.errors import DataError, FactorlocWarning
from factorloc.mapping import LocalFrame

__all__ = ["Projection", "coordinate_system", "is_north_first"]

Array = npt.NDArray[np.float64]

_LARGEST = 100_000.0  # m; a transverse Mercator frame that reaches farther bends distances by more than 0.01 %
_ADV_UTM = re.compile(r"(?:urn:adv:crs:)?ETRS89_UTM(\d\d)(?:\*.*)?", re.IGNORECASE)  # as German surveys write it


def coordinate_system(path: Path, name: str) -> Any:
    """Horizontal part of a coordinate system, as a pyproj.CRS.

    Raises
    ------
    DataError
        If it is unknown, or no system of places on earth.
    """
    import pyproj  # costs a tenth of a second

    if match := _ADV_UTM.fullmatch(name.strip()):
        name = f"EPSG:258{match[1]}"
    try:
        system = pyproj.CRS.from_user_input(name)
    except pyproj.exceptions.CRSError as error:
        short = " ".join(name.split())[:80]
        raise DataError(f"{path}: coordinate system {short!r} is unknown; name it with --crs, as EPSG:25832") from error
    if system.is_compound:
        system = system.sub_crs_list[0]
    if not (system.is_geographic or system.is_projected):
        raise DataError(f"{path}: coordinate system {system.name!r} is not one of a map; name another with --crs")
    return system.to_2d()


def is_north_first(system: Any) -> bool:
    """Whether the authority puts the northing or the latitude first."""
    return bool(system.axis_info and system.axis_info[0].direction.lower() in ("north", "south"))


@dataclass(frozen=True)
class Projection:
    """From coordinates of a file, x before y, to a local frame.

    Parameters
    ----------
    frame : LocalFrame
        With its stated accuracy.
    transformer : pyproj.Transformer
        What does it.
    notes : tuple of str
        What has to be said about it.
    """

    frame: LocalFrame
    transformer: Any
    notes: tuple[str, ...] = ()

    @classmethod
    def about(
        cls, path: Path, system: Any, bounds: Array, origin: tuple[float, float] | None, datum: str
    ) -> Projection:
        """Find the best transformation for a place.

        Parameters
        ----------
        path : Path
            The file, for messages.
        system : pyproj.CRS
            Horizontal system of the file.
        bounds : ndarray, shape (4,)
            Lowest x and y, highest x and y in it.
        origin : (float, float), optional
            Longitude and latitude of the origin in the datum, degrees; the middle of the bounds by default.
        datum : str
            Geographic system of the local frame; ``file`` for that of the file, which needs no transformation.

        Raises
        ------
        DataError
            If the coordinates are no places in the system, or there is no transformation of a stated accuracy.

        Warns
        -----
        FactorlocWarning
            If a grid of corrections is missing, with the accuracy that is left.
        """
        import pyproj
        from pyproj.transformer import AreaOfInterest, TransformerGroup

        geographic = system.geodetic_crs.to_2d()
        target = geographic if datum == "file" else coordinate_system(path, datum).geodetic_crs.to_2d()
        corners = np.array([bounds[[0, 1]], bounds[[2, 3]], (bounds[:2] + bounds[2:]) / 2])
        to_degrees = pyproj.Transformer.from_crs(system, geographic, always_xy=True)
        (west, east, lon), (south, north, lat) = to_degrees.transform(corners[:, 0], corners[:, 1])
        if not np.isfinite([west, east, south, north]).all() or not (abs(lon) <= 180 and abs(lat) < 90):
            raise DataError(f"{path}: coordinates are no places in {system.name!r}; name their system with --crs")
        if origin is None:
            x, y = pyproj.Transformer.from_crs(geographic, target, always_xy=True).transform(lon, lat)
            origin = (float(x), float(y))
        if not (abs(origin[0]) <= 180 and abs(origin[1]) < 90):
            raise DataError(f"{path}: origin {origin}; give longitude and latitude, degrees, longitude first")
        authority = target.to_authority()
        name = ":".join(authority) if authority else target.to_wkt()
        place = AreaOfInterest(min(west, east), min(south, north), max(west, east), max(south, north))
        frame = LocalFrame(origin[0], origin[1], name)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # about grids: said below, with the accuracy
            group = TransformerGroup(system, frame.crs, always_xy=True, area_of_interest=place)
        if not group.transformers or group.transformers[0].accuracy < 0:
            raise DataError(
                f"{path}: from {geographic.name!r} to {target.name!r} leads no transformation of a stated accuracy; "
                "name another --datum, or 'file' to stay in that of the file"
            )
        best = group.transformers[0]
        moved = f"moved from {geographic.name} to {target.name}, to {best.accuracy:g} m"
        if not group.best_available:
            grids = sorted({grid.short_name for way in group.unavailable_operations for grid in way.grids})
            moved = f"datum grid {', '.join(grids) or 'unknown'} is missing (get it with 'pyproj sync'): {moved}"
            warnings.warn(f"{path}: {moved}", FactorlocWarning, stacklevel=4)
        notes = [moved] if best.accuracy > 0 else []
        frame = LocalFrame(origin[0], origin[1], name, float(best.accuracy))
        return cls(frame, best, tuple(notes))

    def local(self, path: Path, coordinates: Array) -> Array:
        """Points (N, 2) in the local frame, m.

        Raises
        ------
        DataError
            If one is no place, or too far from the origin for a local frame.
        """
        points = np.column_stack(self.transformer.transform(coordinates[:, 0], coordinates[:, 1]))
        if not np.isfinite(points).all() or np.abs(points).max(initial=0.0) > _LARGEST:
            raise DataError(
                f"{path}: outlines reach more than {_LARGEST / 1000:.0f} km from the origin; cut out one place"
            )
        return points
