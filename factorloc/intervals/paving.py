"""Pavings: sets enclosed between boxes that are inside and boxes that may be (set inversion, SIVIA)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from factorloc.errors import GeometryError
from factorloc.intervals.box import Box
from factorloc.intervals.interval import Interval, outward
from factorloc.intervals.separator import Separator

__all__ = ["Paving", "pave"]


@dataclass(frozen=True)
class Paving:
    """Boxes that overlap at faces only and together cover the box that was paved.

    Parameters
    ----------
    inner : Box, batch (N,)
        Inside of the set.
    outer : Box, batch (N,)
        Outside.
    boundary : Box, batch (N,)
        Undecided.
    complete : bool
        Whether every undecided box is smaller than the resolution; False if the budget ran out.
    """

    inner: Box
    outer: Box
    boundary: Box
    complete: bool

    @property
    def area(self) -> Interval:
        """Bounds of the area (or volume) of the set, in the product of the units."""
        inner, boundary = self.inner.volume, self.boundary.volume
        low, high = math.fsum(inner.lo), math.fsum(np.append(inner.hi, boundary.hi))
        least, most = outward(np.float64(low), np.float64(high))
        return Interval(max(float(least), 0.0), max(float(most), 0.0))

    @property
    def hull(self) -> Box:
        """Smallest box around the set; empty if the set is."""
        around = Box.join([self.inner, self.boundary])
        if not around.batch[0]:
            return Box(Interval.empty((around.axes,)))
        return Box(Interval(around.lo.min(1), around.hi.max(1)))


def pave(separator: Separator, box: Box, epsilon: float, *, most_boxes: int = 1_000_000) -> Paving:
    """Pave a set, all boxes of a generation at once.

    Every box is separated; what is proven inside or outside is cut off, the rest is halved across its longest side
    until that is shorter than ``epsilon``.

    Parameters
    ----------
    separator : Separator
        Of the set.
    box : Box
        A single box or a batch, bounded.
    epsilon : float
        Resolution, in the unit of the sides.
    most_boxes : int
        Budget: about the number of boxes to stop at.

    Raises
    ------
    GeometryError
        If the box is not bounded, or resolution or budget are not positive.
    """
    if not (epsilon > 0 and most_boxes > 0):
        raise GeometryError(f"paving: epsilon {epsilon}, most_boxes {most_boxes}; both must be positive")
    todo = box.flat()
    todo = todo.select(~todo.is_empty)
    if not todo.bounds.is_bounded.all():
        raise GeometryError("paving: a side is unbounded; give a bounded box")
    inner, outer, boundary = ([todo.select(np.zeros(0, np.intp))] for _ in range(3))
    made = 0
    while todo.batch[0] and made + todo.batch[0] <= most_boxes:
        left_outer, left_inner = separator.separate(todo)
        # What is taken away is cut off whole; a box neither contractor leaves a part of is of a set without area.
        inside = todo.difference(left_inner)
        rest = left_inner & left_outer
        outside = left_inner.difference(rest)
        inner.append(inside)
        outer.append(outside)
        rest = rest.select(~rest.is_empty)
        width = rest.width.max(0)
        # A side of two neighbouring floats cannot be halved.
        small = (width < epsilon) | (rest.bisect()[0].hi == rest.hi).all(0)
        boundary.append(rest.select(small))
        made += inside.batch[0] + outside.batch[0] + int(small.sum())
        todo = Box.join(rest.select(~small).bisect())
    boundary.append(todo)
    return Paving(Box.join(inner), Box.join(outer), Box.join(boundary), complete=not todo.batch[0])
