"""Georeference: where on Earth the plane of a map lies."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from factorloc.errors import MapError
from factorloc.geometry import se2

__all__ = ["WGS84", "Georeference", "convert"]

WGS84 = "OGC:CRS84"
"""Longitude and latitude, degrees, in this order: the system of GeoJSON."""

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Georeference:
    """A metric coordinate system, and the planar pose of the frame of the map in it.

    Maps keep their own coordinates, small numbers in m, and this beside them: large eastings and northings never enter
    a computation, and nothing is rounded.

    Parameters
    ----------
    crs : str
        Projected coordinate system with axes in m, as pyproj takes it: ``EPSG:32632``, a PROJ string or WKT.
    T_crs_map : (3,) array_like
        Easting and northing of the map's origin, m, and the direction of its x axis, rad, counter-clockwise from east.

    Raises
    ------
    MapError
        If the system is unknown or not in m, or the pose is not finite.
    """

    crs: str
    T_crs_map: Array

    def __post_init__(self) -> None:
        pose = np.array(self.T_crs_map, np.float64)
        if pose.shape != (3,) or not np.isfinite(pose).all():
            raise MapError(f"georeference: T_crs_map is {pose.tolist()}; give easting, northing (m) and yaw (rad)")
        object.__setattr__(self, "T_crs_map", pose)
        system = _system(self.crs)
        units = [axis.unit_conversion_factor for axis in system.axis_info[:2]]
        if system.is_geographic or not system.is_projected or units != [1.0, 1.0]:
            raise MapError(f"georeference: {self.crs!r} is no projected system in m; use UTM, or Georeference.at")

    @classmethod
    def at(cls, latitude: float, longitude: float, yaw: float = 0.0) -> Georeference:
        """Place the origin of a map on Earth, in a transverse Mercator projection centred there.

        Lengths near the origin are true: the scale is 1 there and off by less than 2e-8 within 1 km.

        Parameters
        ----------
        latitude, longitude : float
            Origin, degrees on WGS 84.
        yaw : float
            Direction of the map's x axis, rad, counter-clockwise from east.
        """
        if not (abs(latitude) < 90 and abs(longitude) <= 180):
            raise MapError(f"georeference: latitude {latitude}, longitude {longitude}; expected degrees")
        crs = f"+proj=tmerc +lat_0={latitude!r} +lon_0={longitude!r} +k=1 +ellps=WGS84 +units=m +type=crs"
        return cls(crs, np.array([0.0, 0.0, yaw]))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Georeference):
            return NotImplemented
        return self.crs == other.crs and np.array_equal(self.T_crs_map, other.T_crs_map)

    def __hash__(self) -> int:
        return hash((self.crs, *self.T_crs_map.tolist()))

    def to_lonlat(self, positions: npt.ArrayLike) -> Array:
        """Longitudes and latitudes on WGS 84, degrees, (N, 2), of positions in the map, m, (N, 2).

        Raises
        ------
        MapError
            If a position lies where the projection is not defined.
        """
        points = se2.transform(self.T_crs_map, np.asarray(positions, np.float64).reshape(-1, 2))
        return convert(points, self.crs, WGS84)

    def from_lonlat(self, lonlat: npt.ArrayLike) -> Array:
        """Positions in the map, m, (N, 2), of longitudes and latitudes on WGS 84, degrees, (N, 2).

        Raises
        ------
        MapError
            If a place lies where the projection is not defined.
        """
        points = convert(lonlat, WGS84, self.crs)
        return np.asarray(se2.transform(se2.inverse(self.T_crs_map), points))


@functools.lru_cache(maxsize=64)
def _system(crs: str) -> Any:
    import pyproj  # costs a tenth of a second

    try:
        return pyproj.CRS.from_user_input(crs)
    except pyproj.exceptions.CRSError as error:
        raise MapError(f"coordinate system {crs[:80]!r} is unknown; name it as EPSG:32632, say") from error


def convert(points: npt.ArrayLike, source: str, target: str) -> Array:
    """Convert coordinates from one system to another.

    Parameters
    ----------
    points : (N, 2) array_like
        Easting and northing, or longitude and latitude: in this order, whatever the order of axes in the system.
    source, target : str
        Coordinate systems as pyproj takes them.

    Raises
    ------
    MapError
        If a system is unknown, or a point lies where it is not defined.
    """
    import pyproj

    given = np.asarray(points, np.float64).reshape(-1, 2)
    transformer = pyproj.Transformer.from_crs(_system(source), _system(target), always_xy=True)
    converted = np.column_stack(transformer.transform(given[:, 0], given[:, 1]))
    if not np.isfinite(converted).all():
        raise MapError(f"coordinates cannot be converted from {source[:80]!r} to {target[:80]!r}; is the system right?")
    return np.asarray(converted, np.float64)
