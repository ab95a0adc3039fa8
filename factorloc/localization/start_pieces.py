"""Pieces of a start: in a wide place no line is unambiguous, so parts of it are asked in turn.

A wall is looked for among all distances that it may have. From a start of many metres these take in the neighbours, and
every line is rivalled; from each of its pieces they do not. What the pieces find is weighed together afterwards.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import shapely

from factorloc.intervals import ConvexPolygon
from factorloc.localization.feasible_layers import Layer, hull_of_layers
from factorloc.result import Bounds

__all__ = ["split_layers"]

Array = npt.NDArray[np.float64]

_SLIVER = 1e-9  # m


def split_layers(
    layers: Sequence[Layer], most_position: float, most_heading: float, most_pieces: int
) -> list[tuple[Layer, ...]]:
    """Part layers into pieces of limited size, by heading and along the sides of the smallest rectangle around them.

    Parameters
    ----------
    layers : sequence of Layer
        Where the body may be.
    most_position, most_heading : float
        Greatest half sides of a piece, m and rad.
    most_pieces : int
        If more were needed, there is none.
    """
    whole = hull_of_layers(layers)
    low, high = whole.orientation
    turns = max(math.ceil((high - low) / (2.0 * most_heading) - 1e-9), 1)
    axes, place_low, place_high = _rectangle(whole.polygons[0])
    number = np.maximum(np.ceil((place_high - place_low) / (2.0 * most_position) - 1e-9).astype(int), 1)
    if turns * int(number.prod()) == 1:
        return [tuple(layers)]
    if turns * int(number.prod()) > most_pieces:
        return []
    heads = np.linspace(low, high, turns + 1)
    xs, ys = (np.linspace(place_low[k], place_high[k], number[k] + 1) for k in range(2))
    pieces = []
    for h in range(turns):
        for x in range(number[0]):
            for y in range(number[1]):
                box = np.array([xs[x], xs[x + 1]]), np.array([ys[y], ys[y + 1]])
                parts = tuple(
                    Layer(layer.cost, slices)
                    for layer in layers
                    if (slices := _within(layer.slices, (heads[h], heads[h + 1]), axes, box))
                )
                if parts:
                    pieces.append(parts)
    return pieces


def _rectangle(polygon: Array) -> tuple[Array, Array, Array]:
    """Axes of the smallest rectangle around a polygon, and its limits along them."""
    around = shapely.minimum_rotated_rectangle(shapely.MultiPoint(polygon))
    axes = np.eye(2)
    if around.geom_type in ("Polygon", "LineString"):
        corners = shapely.get_coordinates(around)
        x, y = (corners[1] - corners[0]) / np.hypot(*(corners[1] - corners[0]))
        axes = np.array([[x, y], [-y, x]])
    along = polygon @ axes.T
    return axes, along.min(0), along.max(0)


def _within(
    slices: Sequence[Bounds], heading: tuple[float, float], axes: Array, box: tuple[Array, Array]
) -> tuple[Bounds, ...]:
    """What slices have in a range of headings and a rectangle."""
    kept = []
    a, b = np.concatenate([axes[:, 0], -axes[:, 0]]), np.concatenate([axes[:, 1], -axes[:, 1]])
    c = np.array([box[0][1], box[1][1], -box[0][0], -box[1][0]])
    for one in slices:
        low, high = max(one.orientation[0], heading[0]), min(one.orientation[1], heading[1])
        if low > high:
            continue
        polygons = tuple(part for polygon in one.polygons if len(part := _clipped(polygon, a, b, c)))
        if polygons:
            kept.append(Bounds((low, high), polygons))
    return tuple(kept)


def _clipped(polygon: Array, a: Array, b: Array, c: Array) -> Array:
    """A polygon within half-planes ``a x + b y <= c``; one without an area is left whole where it meets them all."""
    if float(np.ptp(polygon @ np.stack([a, b]), axis=0).min()) < _SLIVER:
        meets = (polygon @ np.stack([a, b])).min(0) <= c + _SLIVER
        return polygon if bool(meets.all()) else polygon[:0]
    return ConvexPolygon(polygon).clip_half_planes(a, b, c).corners
