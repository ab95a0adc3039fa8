"""Facades: walls of buildings as segments in the plane, with the errors their map is declared to have."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import shapely

from factorloc.errors import MapError

__all__ = ["Facades"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Facades:
    """Outer walls, each a segment with its building on the left.

    The truth that is promised: a building is moved as a whole by at most its shift along x and along y, and then
    each end of a wall by at most the vertex error along x and along y. Both walls of a corner share its error.

    Parameters
    ----------
    segments : (F, 2, 2) array_like
        Start and end of each wall as mapped, m, in a local metric frame (x east, y north).
    buildings : (F,) array_like of int
        Which building each belongs to.
    shifts : (F,) array_like
        Greatest shift of that building along each axis, m.
    vertex_errors : (F,) array_like
        Greatest error of its corners along each axis, on top of the shift, m.

    Raises
    ------
    MapError
        If the shapes do not match, a value is not finite, a wall has no length or an error is negative.
    """

    segments: Array
    buildings: npt.NDArray[np.int64]
    shifts: Array
    vertex_errors: Array

    def __post_init__(self) -> None:
        segments = np.ascontiguousarray(np.asarray(self.segments, np.float64))
        if segments.size == 0:
            segments = segments.reshape(0, 2, 2)
        if segments.ndim != 3 or segments.shape[1:] != (2, 2):
            raise MapError(f"facades: segments has shape {segments.shape}; give (F, 2, 2)")
        count = len(segments)
        object.__setattr__(self, "segments", segments)
        object.__setattr__(self, "buildings", _column(self.buildings, "buildings", count, np.dtype(np.int64)))
        for name in ("shifts", "vertex_errors"):
            values = _column(getattr(self, name), name, count, np.dtype(np.float64))
            if (np.asarray(values, np.float64) < 0.0).any():
                raise MapError(f"facades: {name} must not be negative, in m")
            object.__setattr__(self, name, values)
        if not np.isfinite(segments).all():
            raise MapError("facades: segments has values that are not finite; leave those walls out")
        if (self.lengths <= 0.0).any():
            raise MapError("facades: a wall begins where it ends; leave it out")

    def __len__(self) -> int:
        return len(self.segments)

    @property
    def lengths(self) -> Array:
        """Lengths as mapped, m, (F,)."""
        d = self.segments[:, 1] - self.segments[:, 0]
        return np.asarray(np.hypot(d[:, 0], d[:, 1]))

    @cached_property
    def lines(self) -> npt.NDArray[np.object_]:
        """As lines of shapely, m, (F,)."""
        return np.asarray(shapely.linestrings(self.segments))

    @cached_property
    def tree(self) -> shapely.STRtree:
        """Spatial index of the lines."""
        return shapely.STRtree(self.lines)

    def within(self, center: npt.ArrayLike, reach: float) -> npt.NDArray[np.int64]:
        """Facades that may be within reach of a point, whatever errors the map has, in ascending order.

        Parameters
        ----------
        center : (2,) array_like
            Point, m.
        reach : float
            Distance, m; add the radius of a region to ask for the region.
        """
        # No point of a wall is off by more than both errors along both axes.
        errors = math.sqrt(2.0) * (self.shifts + self.vertex_errors)
        point = shapely.Point(np.asarray(center, np.float64))
        rows = self.tree.query(point, predicate="dwithin", distance=reach + float(errors.max(initial=0.0)))
        rows = rows[shapely.distance(self.lines[rows], point) <= reach + errors[rows]]
        return np.sort(rows).astype(np.int64)

    def select(self, which: npt.ArrayLike) -> Facades:
        """Walls named by a mask or indices."""
        rows = np.asarray(which) if np.size(which) else np.empty(0, np.int64)
        return Facades(self.segments[rows], self.buildings[rows], self.shifts[rows], self.vertex_errors[rows])


def _column(values: npt.ArrayLike, name: str, count: int, kind: np.dtype[np.generic]) -> npt.NDArray[np.generic]:
    column = np.asarray(values, kind)
    if column.shape != (count,):
        raise MapError(f"facades: {name} has shape {column.shape}; give one value for each of {count} walls")
    if not np.isfinite(column).all():
        raise MapError(f"facades: {name} has values that are not finite")
    return np.ascontiguousarray(column)
