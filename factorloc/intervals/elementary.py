"""Functions of intervals: every result encloses all values over the numbers inside; of any shape, broadcasting."""

from __future__ import annotations

import numpy as np

from factorloc.intervals._arithmetic_kernels import norm_arrays, root_arrays, square_arrays
from factorloc.intervals._elementary_kernels import angle_arrays, arccosine_arrays, move_arrays, sector_arrays
from factorloc.intervals._trigonometric_kernels import PI_LOWER, PI_UPPER, cosine_sine_arrays
from factorloc.intervals.box import Box
from factorloc.intervals.interval import Interval, IntervalLike, as_interval, elementwise, elementwise_many

__all__ = [
    "acos", "atan2", "cos", "cos_sin", "hypot", "maximum", "minimum", "move", "pi", "rotate", "sector", "sin", "sqrt",
    "square",
]  # fmt: skip


def pi() -> Interval:
    """Enclose pi between neighbouring floats."""
    return Interval(PI_LOWER, PI_UPPER)


def square(x: IntervalLike) -> Interval:
    """``x^2``; tighter than ``x * x``, whose factors need not agree."""
    return elementwise(square_arrays, x)


def sqrt(x: IntervalLike) -> Interval:
    """Square root of the part that is not negative; empty without one."""
    return elementwise(root_arrays, x)


def cos_sin(x: IntervalLike) -> tuple[Interval, Interval]:
    """Cosine and sine of angles (rad); ``[-1, 1]`` for angles beyond 2^20 rad."""
    cosine, sine = elementwise_many(cosine_sine_arrays, 2, x)
    return cosine, sine


def cos(x: IntervalLike) -> Interval:
    """Cosine of angles (rad)."""
    return cos_sin(x)[0]


def sin(x: IntervalLike) -> Interval:
    """Sine of angles (rad)."""
    return cos_sin(x)[1]


def acos(x: IntervalLike) -> Interval:
    """Arc cosine (rad, in [0, pi]) of the part in [-1, 1]; empty without one."""
    return elementwise(arccosine_arrays, x)


def atan2(y: IntervalLike, x: IntervalLike) -> Interval:
    """Hull of the angles (rad, in (-pi, pi]) of vectors ``(x, y)``; all, if the zero vector is one of them.

    Across the negative x axis the hull is ``[-pi, pi]``; a :class:`factorloc.intervals.Polar` contractor follows angles
    across it.
    """
    return elementwise(angle_arrays, y, x)


def hypot(x: IntervalLike, y: IntervalLike) -> Interval:
    """Lengths of vectors ``(x, y)``."""
    return elementwise(norm_arrays, x, y)


def minimum(x: IntervalLike, y: IntervalLike) -> Interval:
    """The smaller of two numbers; exact."""
    x, y = as_interval(x), as_interval(y)
    return Interval.from_bounds(np.minimum(x.lo, y.lo), np.minimum(x.hi, y.hi))


def maximum(x: IntervalLike, y: IntervalLike) -> Interval:
    """The larger of two numbers; exact."""
    x, y = as_interval(x), as_interval(y)
    return Interval.from_bounds(np.maximum(x.lo, y.lo), np.maximum(x.hi, y.hi))


def sector(r: IntervalLike, bearing: IntervalLike) -> tuple[Interval, Interval]:
    """Boxes ``(x, y)`` around sectors of ranges (m) and bearings (rad); the smallest, up to rounding."""
    x, y = elementwise_many(sector_arrays, 2, r, bearing)
    return x, y


def rotate(theta: IntervalLike, x: IntervalLike, y: IntervalLike) -> tuple[Interval, Interval]:
    """Turn vectors ``(x, y)`` by angles (rad), by the formula: ``(c x - s y, s x + c y)``."""
    c, s = cos_sin(theta)
    return c * x - s * y, s * x + c * y


def move(theta: IntervalLike, t_x: IntervalLike, t_y: IntervalLike, points: Box) -> Box:
    """Boxes around points moved by one uncertain motion: ``R(theta) l + t``.

    Parameters
    ----------
    theta, t_x, t_y : interval or float
        Single ones; rad, m, m.
    points : Box, sides (x, y)
        m, of any batch.
    """
    c, s = cos_sin(theta)
    motion = (float(bound) for side in (c, s, as_interval(t_x), as_interval(t_y)) for bound in (side.lo, side.hi))
    flat = points.flat()
    lo, hi = np.empty(flat.lo.shape), np.empty(flat.lo.shape)
    move_arrays(flat.lo[0], flat.hi[0], flat.lo[1], flat.hi[1], *motion, lo[0], hi[0], lo[1], hi[1])
    return Box(Interval.from_bounds(lo.reshape(points.bounds.shape), hi.reshape(points.bounds.shape)))
