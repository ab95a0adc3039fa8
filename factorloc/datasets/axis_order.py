"""Axis order: whether latitudes and longitudes were swapped, told by the right angles of buildings."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import shapely

__all__ = ["look_swapped"]

Array = npt.NDArray[np.float64]

_RIGHT = np.deg2rad(4.0)
_SKEW = np.deg2rad(8.0)  # walls nearer than that to an axis stay at right angles when axes are swapped
_FEWEST = 12


def look_swapped(polygons: list[shapely.Polygon]) -> bool:
    """Whether buildings, longitude first, have far more right angles if their coordinates are swapped.

    A degree of longitude is shorter than one of latitude by the cosine of the latitude. With the wrong one of two
    coordinates taken for the latitude, walls that are not along the axes lose their right angles. Where both
    coordinates have about the same cosine, or all walls run along the axes, this cannot tell, and says no.

    Parameters
    ----------
    polygons : list of shapely.Polygon
        Outlines, degrees.
    """
    rings = [shapely.get_coordinates(polygon.exterior)[:-1] for polygon in polygons[:2000]]
    here = np.concatenate([_corners(ring) for ring in rings])
    scales = [np.cos(np.deg2rad(float(np.mean(np.concatenate(rings)[:, axis])))) for axis in (1, 0)]
    as_is, swapped = (
        _right_angles(here[..., order] * [scale, 1.0])
        for order, scale in zip(([0, 1], [1, 0]), scales, strict=True)
    )  # fmt: skip
    if min(len(as_is), len(swapped)) < _FEWEST:
        return False
    return bool(as_is.mean() < 0.5 * swapped.mean() and swapped.mean() > 0.4)


def _corners(ring: Array) -> Array:
    """Edges before and after each corner, shape (V, 2, 2)."""
    return np.stack([ring - np.roll(ring, 1, 0), np.roll(ring, -1, 0) - ring], 1)


def _right_angles(edges: Array) -> npt.NDArray[np.bool_]:
    """Which corners are right, of those that are not along the axes."""
    angles = np.arctan2(edges[..., 1], edges[..., 0])
    off_axis = np.abs((angles + np.pi / 4) % (np.pi / 2) - np.pi / 4)
    turn = np.abs((angles[:, 1] - angles[:, 0]) % np.pi - np.pi / 2)
    return np.asarray(turn[(off_axis > _SKEW).all(1)] < _RIGHT)
