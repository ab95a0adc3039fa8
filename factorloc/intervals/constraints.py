"""Contractors of single equations: sums, products, functions, points of the plane and the motions between them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from factorloc.errors import GeometryError
from factorloc.intervals import _contraction_kernels as kernels
from factorloc.intervals import _line_kernels as line_kernels
from factorloc.intervals.box import Box
from factorloc.intervals.contractor import Contractor
from factorloc.intervals.interval import Interval, IntervalLike, as_interval

__all__ = [
    "Cosine", "Distance", "Heading", "Line", "Linear", "OnAxes", "Polar", "Product", "RigidMotion", "SegmentHull",
    "Sine", "Square", "Sum",
]  # fmt: skip


def contract_in_place(box: Box, kernel: Callable[..., None], *parameters: object, rows: int = 0) -> Box:
    """Run a kernel on a flat copy of the bounds, with so many rows to work in."""
    flat = box.flat()
    lo, hi = flat.lo.copy(), flat.hi.copy()
    kernel(lo, hi, *parameters, *np.empty((rows, lo.shape[1])))
    return Box.trust(lo.reshape(box.bounds.shape), hi.reshape(box.bounds.shape))


class _Equation:
    """A contractor of fixed variables, run by one kernel."""

    constraint: ClassVar[str]
    minimal: ClassVar[bool]
    _kernel: ClassVar[Any]
    _sides: ClassVar[int]
    _rows: ClassVar[int] = 0

    def contract(self, box: Box) -> Box:
        """Shrink boxes.

        Raises
        ------
        GeometryError
            If the number of sides is not that of the variables.
        """
        if box.axes != self._sides:
            raise GeometryError(f"{type(self).__name__}: a box of {box.axes} sides; its variables are {self._sides}")
        return contract_in_place(box, type(self)._kernel, rows=self._rows)


class Sum(_Equation):
    """Variables x, y, z with ``z = x + y``."""

    constraint, minimal = "z = x + y", True
    _kernel, _sides = staticmethod(kernels.contract_sum), 3


class Product(_Equation):
    """Variables x, y, z with ``z = x y``; division by intervals around zero keeps both pieces until they are met."""

    constraint, minimal = "z = x y", True
    _kernel, _sides = staticmethod(kernels.contract_product), 3


class Square(_Equation):
    """Variables x, y with ``y = x^2``."""

    constraint, minimal = "y = x^2", True
    _kernel, _sides = staticmethod(kernels.contract_square), 2


class Sine(_Equation):
    """Variables x (rad), y with ``y = sin x``; x beyond 2^20 rad is left alone."""

    constraint, minimal = "y = sin x", True
    _kernel, _sides, _rows = staticmethod(kernels.contract_sine), 2, 4


class Cosine(_Equation):
    """Variables x (rad), y with ``y = cos x``; x beyond 2^20 rad is left alone."""

    constraint, minimal = "y = cos x", True
    _kernel, _sides, _rows = staticmethod(kernels.contract_cosine), 2, 4


class Polar(_Equation):
    """Variables x, y (m), r (m, not negative), b (rad, in any turn) with ``x = r cos b, y = r sin b``."""

    constraint, minimal = "x = r cos b, y = r sin b, r >= 0", False
    _kernel, _sides, _rows = staticmethod(kernels.contract_polar), 4, 4


class Distance(_Equation):
    """Variables a_x, a_y, b_x, b_y, d (m): two points and their distance."""

    constraint, minimal = "d = |a - b|", False
    _kernel, _sides = staticmethod(kernels.contract_distance), 5


class RigidMotion(_Equation):
    """Variables theta (rad), t_x, t_y, l_x, l_y, m_x, m_y (m): a local point, and its place in the map.

    Forward by the rotated point, backward by its inverse, and theta by the difference of the two directions.
    """

    constraint, minimal = "m = R(theta) l + t", False
    _kernel, _sides, _rows = staticmethod(kernels.contract_rigid_motion), 7, 4


class Line(_Equation):
    """Variables a (rad), d (m), x, y (m): a point on the line of normal direction a at distance d from the origin."""

    constraint, minimal = "x cos a + y sin a = d", False
    _kernel, _sides, _rows = staticmethod(line_kernels.contract_line), 4, 4


class Heading(_Equation):
    """Variables theta, t_x, t_y, r, b, a, d: the heading of a sensor at t that sees a point of a line.

    The point lies at range r (m) and bearing b (rad) of the sensor; the line is that of :class:`Line`. Shrinks theta
    only; in any turn.
    """

    constraint, minimal = "(cos a, sin a) . (r (cos(theta + b), sin(theta + b)) + t) = d", False
    _kernel, _sides, _rows = staticmethod(line_kernels.contract_heading), 7, 4


@dataclass(frozen=True)
class Linear:
    """Variables x, y with ``a x + b y`` in an interval: strips and half-planes.

    Parameters
    ----------
    a, b : interval or float
        Coefficients; for every point, one value of each must do.
    range : interval
        Of the sum.
    """

    a: IntervalLike
    b: IntervalLike
    range: IntervalLike

    @property
    def constraint(self) -> str:
        """The inequality in words."""
        a, b, values = (as_interval(value) for value in (self.a, self.b, self.range))
        return f"{a} x + {b} y in {values}"

    @property
    def minimal(self) -> bool:
        """Whether the coefficients are numbers."""
        return bool(not (as_interval(self.a).width + as_interval(self.b).width).any())

    def contract(self, box: Box) -> Box:
        """Shrink boxes."""
        bounds = (as_interval(value) for value in (self.a, self.b, self.range))
        return contract_in_place(
            box, line_kernels.contract_linear, *(float(end) for bound in bounds for end in (bound.lo, bound.hi))
        )


@dataclass(frozen=True)
class SegmentHull:
    """Variables x, y inside the hull of the ends of a segment, which are boxes themselves.

    Parameters
    ----------
    hull : Box
        Of the two ends.
    """

    hull: Box
    minimal: ClassVar[bool] = True

    @property
    def constraint(self) -> str:
        """The hull in words."""
        return f"(x, y) in {self.hull}"

    def contract(self, box: Box) -> Box:
        """Shrink boxes."""
        lo, hi = (bound.reshape(-1, *(1,) * len(box.batch)) for bound in (self.hull.lo, self.hull.hi))
        return Box(box.bounds & Interval.from_bounds(lo, hi))


@dataclass(frozen=True)
class OnAxes:
    """A contractor on some sides of larger boxes.

    Parameters
    ----------
    contractor : Contractor
        Of as many variables as axes are named.
    axes : tuple of int
        The side that each variable is.
    """

    contractor: Contractor
    axes: tuple[int, ...]

    @property
    def constraint(self) -> str:
        """That of the contractor, and where."""
        return f"{self.contractor.constraint} on sides {', '.join(map(str, self.axes))}"

    @property
    def minimal(self) -> bool:
        """As the contractor: the other sides are free."""
        return self.contractor.minimal

    def contract(self, box: Box) -> Box:
        """Shrink boxes."""
        return box.put(self.axes, self.contractor.contract(box.take(self.axes)))
