"""Feasible layers: sets of poses that cost at most so much, one within the other, as a drive carries them along."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.errors import GeometryError
from factorloc.localization._cell_kernels import convex_hull, spread_corners
from factorloc.result import Bounds

__all__ = ["Layer", "as_layers", "hull_of", "hull_of_layers", "hull_of_points", "without_twins"]

Array = npt.NDArray[np.float64]

_TWINS = 1e-6  # m; corners at most so far apart are one
_SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


@dataclass(frozen=True, eq=False)
class Layer:
    """Poses for which lines were false that weigh at least so much.

    Parameters
    ----------
    cost : float
        That weight, in natural units of log odds, relative to the least of all poses.
    slices : tuple of Bounds
        By narrow slices of headings: heading and position belong together, and a motion moves them so.
    """

    cost: float
    slices: tuple[Bounds, ...]


def as_layers(start: Bounds | Sequence[Bounds] | Sequence[Layer]) -> tuple[Layer, ...]:
    """A set, slices of one that may overlap, or layers, as layers by increasing cost.

    Raises
    ------
    GeometryError
        If there is none.
    """
    given = (start,) if isinstance(start, Bounds) else tuple(start)
    layers = [one for one in given if isinstance(one, Layer)]
    slices = tuple(one for one in given if isinstance(one, Bounds) and one.polygons)
    if slices:
        layers.append(Layer(0.0, slices))
    if not layers:
        raise GeometryError("bounds: no slice is left; no pose is possible")
    return tuple(sorted(layers, key=lambda one: one.cost))


def hull_of_layers(layers: Sequence[Layer]) -> Bounds:
    """All headings of some layers, and one convex polygon around all their positions."""
    return hull_of([one for layer in layers for one in layer.slices])


def hull_of(slices: Sequence[Bounds]) -> Bounds:
    """All headings of some slices, and one convex polygon around all their positions.

    Raises
    ------
    GeometryError
        If there is none.
    """
    if not slices:
        raise GeometryError("bounds: no slice is left; no pose is possible")
    headings = np.array([one.orientation for one in slices])
    corners = np.concatenate([polygon for one in slices for polygon in one.polygons])
    return Bounds((float(headings[:, 0].min()), float(headings[:, 1].max())), (hull_of_points(corners),))


def hull_of_points(points: Array) -> Array:
    """Corners of the convex hull of points, counter-clockwise."""
    out = np.empty((2 * len(points) + 2, 2))
    order = np.lexsort((points[:, 1], points[:, 0]))
    return out[: convex_hull(points, order, out)].copy()


def without_twins(polygon: Array) -> Array:
    """A convex polygon, a micrometre larger, without corners so near to each other that rounding turns their edge.

    Whoever asks on which side of such an edge a point is gets any answer.
    """
    kept = np.empty_like(polygon)
    count = spread_corners(polygon, _TWINS, kept)
    return hull_of_points((kept[:count, None] + _TWINS * _SQUARE).reshape(-1, 2))
