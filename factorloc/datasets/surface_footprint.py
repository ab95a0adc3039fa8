"""The footprint of a building that is given by its surfaces in space, and its height."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

__all__ = ["Surface", "footprint_of", "rise_of"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Surface:
    """A plane piece of a building's surface.

    Parameters
    ----------
    kind : str
        ``GroundSurface``, ``WallSurface``, ``RoofSurface`` and so on; empty where the file does not tell.
    rings : tuple of ndarray, shape (N, 3)
        Its outline and its holes; the last point may repeat the first.
    """

    kind: str
    rings: tuple[Array, ...]


def footprint_of(surfaces: Sequence[Surface]) -> shapely.Geometry:
    """Footprint along the walls, in the coordinates of the surfaces; empty if there is none.

    That is what the ground surfaces cover. Without them, it is what the walls enclose, since roofs may overhang; and
    without walls that close, as in a block model whose surfaces have no kinds, what all surfaces cover from above.
    """
    ground = _covered([surface for surface in surfaces if surface.kind in ("GroundSurface", "FootPrint")])
    if ground.area > 0:
        return ground
    walls = [surface for surface in surfaces if surface.kind == "WallSurface"]
    enclosed = shapely.polygonize([_trace(surface) for surface in walls])
    if (inside := shapely.union_all(shapely.get_parts(enclosed))).area > 0:
        return inside
    return _covered([surface for surface in surfaces if surface.kind not in ("WallSurface", "InteriorWallSurface")])


def rise_of(surfaces: Sequence[Surface]) -> float | None:
    """From the lowest to the highest point, m, if that is anything."""
    heights = [ring[:, 2] for surface in surfaces for ring in surface.rings if len(ring)]
    if not heights:
        return None
    z = np.concatenate(heights)
    rise = float(z.max() - z.min())
    return rise if 0 < rise < np.inf else None


def _covered(surfaces: Sequence[Surface]) -> shapely.Geometry:
    shapes = []
    for surface in surfaces:
        outer, *holes = (ring[:, :2] for ring in surface.rings)
        if len(outer) < 3:
            continue
        shape = shapely.Polygon(outer, [hole for hole in holes if len(hole) >= 3])
        shapes.append(shape if shape.is_valid else shapely.make_valid(shape))
    return shapely.union_all([shape for shape in shapes if shape.area > 0])


def _trace(surface: Surface) -> shapely.LineString:
    """The straight line that a wall draws on the ground: between its two farthest points."""
    flat = surface.rings[0][:, :2]
    far = flat[np.argmax(((flat - flat[0]) ** 2).sum(1))]
    other = flat[np.argmax(((flat - far) ** 2).sum(1))]
    return shapely.LineString([far, other])
