"""Box: products of intervals, one or a batch of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Self

import numpy as np
import numpy.typing as npt

from factorloc.errors import GeometryError
from factorloc.intervals.interval import Interval, IntervalLike, as_interval

__all__ = ["Box"]

Array = npt.NDArray[np.float64]


class Box:
    """Axis-aligned boxes: the axes first, then the batch, so that each axis of all boxes is one block of memory.

    A box is empty if one of its axes is; then all of them are.

    Parameters
    ----------
    bounds : Interval, shape (n, *batch)
        Sides of the boxes.

    Raises
    ------
    GeometryError
        If there is no axis.
    """

    __slots__ = ("bounds",)
    bounds: Interval

    def __init__(self, bounds: Interval) -> None:
        if not bounds.shape or not len(bounds):
            raise GeometryError(f"box: bounds of shape {bounds.shape}; the first axis counts the sides, at least one")
        gone = bounds.is_empty.any(0)
        if gone.any():
            bounds = Interval.from_bounds(np.where(gone, np.nan, bounds.lo), np.where(gone, np.nan, bounds.hi))
        self.bounds = bounds

    @classmethod
    def trust(cls, lo: Array, hi: Array) -> Self:
        """Take over bounds, shape (n, *batch), of boxes that are sound and empty as a whole where they are empty."""
        made = cls.__new__(cls)
        made.bounds = Interval.trust(lo, hi)
        return made

    @classmethod
    def of(cls, *sides: IntervalLike) -> Self:
        """Boxes from their sides, brought to one shape."""
        given = [as_interval(side) for side in sides]
        shape = np.broadcast_shapes(*(side.shape for side in given))
        stacked = (np.stack([np.broadcast_to(bound, shape) for bound in bounds]) for bounds in (
            [side.lo for side in given], [side.hi for side in given]))  # fmt: skip
        return cls(Interval.from_bounds(*stacked))

    @classmethod
    def around(cls, points: npt.ArrayLike, radius: npt.ArrayLike) -> Self:
        """Boxes around points, shape (n, *batch), with a radius of each side."""
        return cls(Interval.around(points, radius))

    @classmethod
    def join(cls, boxes: Iterable[Box]) -> Self:
        """One flat batch of several."""
        flat = [box.flat() for box in boxes]
        return cls(Interval.from_bounds(*(
            np.concatenate(bounds, 1) for bounds in ([box.lo for box in flat], [box.hi for box in flat]))))  # fmt: skip

    @property
    def lo(self) -> Array:
        """Lower corners, shape (n, *batch)."""
        return self.bounds.lo

    @property
    def hi(self) -> Array:
        """Upper corners, shape (n, *batch)."""
        return self.bounds.hi

    @property
    def axes(self) -> int:
        """Number of sides."""
        return len(self.bounds)

    @property
    def batch(self) -> tuple[int, ...]:
        """Shape of the batch; ``()`` for one box."""
        return self.bounds.shape[1:]

    def __getitem__(self, axis: int) -> Interval:
        return self.bounds[axis]

    def __repr__(self) -> str:
        return f"Box({self.bounds!r})"

    def flat(self) -> Box:
        """The same boxes as a batch of shape (N,)."""
        return Box.trust(self.lo.reshape(self.axes, -1), self.hi.reshape(self.axes, -1))

    def take(self, axes: Sequence[int]) -> Box:
        """Boxes of some of the sides."""
        return Box(self.bounds[list(axes)])

    def put(self, axes: Sequence[int], sides: Box) -> Box:
        """Boxes with some of the sides replaced."""
        lo, hi = self.lo.copy(), self.hi.copy()
        lo[list(axes)], hi[list(axes)] = sides.lo, sides.hi
        return Box(Interval.from_bounds(lo, hi))

    def select(self, index: npt.NDArray[np.generic]) -> Box:
        """Boxes of a flat batch by mask or index."""
        return Box.trust(self.lo[:, index], self.hi[:, index])

    def choose(self, condition: npt.ArrayLike, other: Box) -> Box:
        """These boxes where a condition of the shape of the batch holds, others elsewhere."""
        pairs = ((self.lo, other.lo), (self.hi, other.hi))
        return Box(Interval.from_bounds(*(np.where(condition, own, theirs) for own, theirs in pairs)))

    @property
    def is_empty(self) -> npt.NDArray[np.bool_]:
        """Whether boxes hold no point, shape of the batch."""
        return self.bounds[0].is_empty

    @property
    def mid(self) -> Array:
        """A point in the middle of each box, shape (n, *batch)."""
        return self.bounds.mid

    @property
    def width(self) -> Array:
        """Length of each side, rounded up, shape (n, *batch)."""
        return self.bounds.width

    @property
    def widest(self) -> npt.NDArray[np.intp]:
        """Number of the longest side; 0 for the empty box."""
        return np.asarray(np.argmax(np.nan_to_num(self.width, nan=0.0, posinf=np.inf), axis=0))

    @property
    def volume(self) -> Interval:
        """Bounds of the volume, in the product of the units; 0 for the empty box."""
        flat = self.is_empty | (self.lo == self.hi).any(0)
        lo, hi = np.where(flat, 0.0, self.lo), np.where(flat, 0.0, self.hi)
        volume = Interval(np.ones(self.batch))
        for low, high in zip(lo, hi, strict=True):
            side = Interval.from_bounds(high, high) - Interval.from_bounds(low, low)
            volume *= Interval.from_bounds(np.maximum(side.lo, 0.0), side.hi)
        return Interval.from_bounds(np.maximum(volume.lo, 0.0), np.where(flat, 0.0, volume.hi))

    def contains(self, points: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Whether points, shape (n, *batch), lie inside."""
        return np.asarray(self.bounds.contains(points).all(0))

    def is_subset(self, other: Box) -> npt.NDArray[np.bool_]:
        """Whether boxes lie inside others."""
        return np.asarray(self.bounds.is_subset(other.bounds).all(0))

    def intersection(self, other: Box) -> Box:
        """Points in both; exact."""
        return Box(self.bounds & other.bounds)

    def hull(self, other: Box) -> Box:
        """Smallest boxes around both; exact."""
        return Box(self.bounds | other.bounds)

    def __and__(self, other: Box) -> Box:
        return self.intersection(other)

    def __or__(self, other: Box) -> Box:
        return self.hull(other)

    def inflate(self, radius: npt.ArrayLike) -> Box:
        """Widen by a radius to all sides."""
        return Box(self.bounds.inflate(radius))

    def bisect(self, axis: int | None = None) -> tuple[Box, Box]:
        """Halves along an axis, by default the longest side of each; they share a face."""
        cut = np.arange(self.axes).reshape(-1, *(1,) * len(self.batch)) == (self.widest if axis is None else axis)
        mid = self.mid
        left = Interval.from_bounds(self.lo, np.where(cut, mid, self.hi))
        return Box(left), Box(Interval.from_bounds(np.where(cut, mid, self.lo), self.hi))

    def difference(self, other: Box) -> Box:
        """Cover what is outside other boxes of the same flat batch with up to two boxes an axis, without overlap."""
        pieces = []
        rest_lo, rest_hi = self.lo.copy(), self.hi.copy()
        gone = other.is_empty & ~self.is_empty
        for axis in range(self.axes):
            for below in (True, False):
                lo, hi = rest_lo.copy(), rest_hi.copy()
                (hi if below else lo)[axis] = (other.lo if below else other.hi)[axis]
                kept = ~gone & (lo[axis] < hi[axis])
                pieces.append(Box(Interval.from_bounds(lo[:, kept], hi[:, kept])))
            inside = ~gone & ~self.is_empty
            rest_lo[axis, inside], rest_hi[axis, inside] = other.lo[axis, inside], other.hi[axis, inside]
        return Box.join([self.select(gone), *pieces])
