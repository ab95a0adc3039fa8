"""Interval: closed intervals of real numbers, one or an array of them, that never lose a number to rounding."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from factorloc.errors import GeometryError
from factorloc.intervals._arithmetic_kernels import (
    ETA,
    LARGEST,
    PHI,
    add_arrays,
    divide_arrays,
    multiply_arrays,
    power_arrays,
)

__all__ = ["Interval", "IntervalLike", "as_interval", "elementwise", "elementwise_many", "outward"]

Array = npt.NDArray[np.float64]


def outward(lo: npt.ArrayLike, hi: npt.ArrayLike) -> tuple[Array, Array]:
    """Widen bounds that were rounded once, as all kernels do."""
    with np.errstate(invalid="ignore", over="ignore"):
        low, high = np.minimum(lo, LARGEST), np.maximum(hi, -LARGEST)
        return np.asarray(low - (np.abs(low) * PHI + ETA)), np.asarray(high + (np.abs(high) * PHI + ETA))


class Interval:
    """Closed intervals, of any shape; arithmetic encloses every result the numbers inside can have.

    ``a + b``, ``a - b``, ``a * b``, ``a / b``, ``a ** n``, ``abs(a)`` and ``-a`` broadcast as numpy does and take plain
    numbers for degenerate intervals; ``a & b`` is the intersection, ``a | b`` the hull. A number stands for the float
    it is: ``Interval(0.1)`` does not contain one tenth, ``Interval.around(0.1, 1e-17)`` does.

    The empty set is a result like any other: both of its bounds are NaN, so that whatever is computed from it is empty
    and every comparison with it is false. Only :meth:`empty` and results are empty; NaN given by hand is an error.

    Parameters
    ----------
    lo, hi : array_like
        Bounds, ``lo <= hi``; ``hi`` defaults to ``lo``. Infinity is a bound, not a member.

    Raises
    ------
    GeometryError
        If a bound is NaN or an interval holds no number.
    """

    __slots__ = ("hi", "lo")
    __array_ufunc__ = None  # so that ``array * interval`` asks the interval
    lo: Array
    hi: Array

    def __init__(self, lo: npt.ArrayLike, hi: npt.ArrayLike | None = None) -> None:
        low = np.array(lo, np.float64, order="C")
        high = low.copy() if hi is None else np.array(hi, np.float64, order="C")
        if low.shape != high.shape:
            low, high = (np.array(bound) for bound in np.broadcast_arrays(low, high))
        if not ((low <= high) & (low < np.inf) & (high > -np.inf)).all():
            raise GeometryError("interval: a bound is NaN, lo exceeds hi, or both are infinite alike; mend the bounds")
        self.lo, self.hi = low, high

    @classmethod
    def from_bounds(cls, lo: Array, hi: Array) -> Self:
        """Take over bounds that are sound already; where they are NaN or cross, the interval is empty.

        Parameters
        ----------
        lo, hi : ndarray of float64
            Contiguous, of one shape; not copied unless some are empty.
        """
        good = lo <= hi
        if good.all():
            return cls.trust(lo, hi)
        return cls.trust(np.where(good, lo, np.nan), np.where(good, hi, np.nan))

    @classmethod
    def trust(cls, lo: Array, hi: Array) -> Self:
        """Take over bounds without a look at them: sound, and both NaN where one is."""
        made = cls.__new__(cls)
        made.lo, made.hi = lo, hi
        return made

    @classmethod
    def around(cls, mid: npt.ArrayLike, radius: npt.ArrayLike) -> Self:
        """Enclose all numbers within a radius of a middle.

        Raises
        ------
        GeometryError
            If a radius is negative or a value is NaN.
        """
        mid, radius = np.broadcast_arrays(np.asarray(mid, np.float64), np.asarray(radius, np.float64))
        if not (radius >= 0).all():
            raise GeometryError("interval: a radius is negative or NaN")
        return cls(*outward(mid - radius, mid + radius))

    @classmethod
    def empty(cls, shape: int | tuple[int, ...] = ()) -> Self:
        """Intervals without a number."""
        return cls.from_bounds(np.full(shape, np.nan), np.full(shape, np.nan))

    @classmethod
    def entire(cls, shape: int | tuple[int, ...] = ()) -> Self:
        """Intervals of all numbers."""
        return cls.from_bounds(np.full(shape, -np.inf), np.full(shape, np.inf))

    @classmethod
    def hull_of(cls, values: npt.ArrayLike, axis: int | None = None) -> Self:
        """Smallest intervals around values along an axis."""
        values = np.asarray(values, np.float64)
        return cls(values.min(axis), values.max(axis))

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the array of intervals."""
        return self.lo.shape

    @property
    def size(self) -> int:
        """Number of intervals."""
        return self.lo.size

    def __len__(self) -> int:
        return len(self.lo)

    def __getitem__(self, index: Any) -> Interval:
        return Interval.from_bounds(*(np.array(bound[index], order="C") for bound in (self.lo, self.hi)))

    def __repr__(self) -> str:
        if self.shape:
            return f"Interval(lo={self.lo!r}, hi={self.hi!r})"
        return "Interval.empty()" if self.is_empty else f"Interval({float(self.lo)!r}, {float(self.hi)!r})"

    @property
    def is_empty(self) -> npt.NDArray[np.bool_]:
        """Whether there is no number inside."""
        return np.isnan(self.lo)

    @property
    def is_bounded(self) -> npt.NDArray[np.bool_]:
        """Whether both bounds are finite; the empty set has none."""
        return np.asarray(np.isfinite(self.lo) & np.isfinite(self.hi))

    @property
    def width(self) -> Array:
        """Distance of the bounds, rounded up; NaN for the empty set, 0 for a single number."""
        with np.errstate(over="ignore"):
            return np.where(self.lo == self.hi, 0.0, outward(0.0, self.hi - self.lo)[1])

    @property
    def mid(self) -> Array:
        """A float in the middle, always inside and finite; NaN for the empty set."""
        low, high = np.maximum(self.lo, -LARGEST), np.minimum(self.hi, LARGEST)
        return np.asarray(np.clip(0.5 * low + 0.5 * high, low, high))

    @property
    def magnitude(self) -> Array:
        """Largest absolute value inside."""
        return np.maximum(np.abs(self.lo), np.abs(self.hi))

    def contains(self, values: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Whether numbers lie inside."""
        values = np.asarray(values, np.float64)
        return np.asarray((self.lo <= values) & (values <= self.hi) & np.isfinite(values))

    def is_subset(self, other: IntervalLike) -> npt.NDArray[np.bool_]:
        """Whether all numbers inside lie in other intervals too; the empty set is a subset of all."""
        outer = as_interval(other)
        return np.asarray(self.is_empty | ((outer.lo <= self.lo) & (self.hi <= outer.hi)))

    def meets(self, other: IntervalLike) -> npt.NDArray[np.bool_]:
        """Whether a number lies in both."""
        other = as_interval(other)
        return np.asarray((self.lo <= other.hi) & (other.lo <= self.hi))

    def intersection(self, other: IntervalLike) -> Interval:
        """Numbers in both; exact."""
        other = as_interval(other)
        return Interval.from_bounds(np.maximum(self.lo, other.lo), np.minimum(self.hi, other.hi))

    def hull(self, other: IntervalLike) -> Interval:
        """Smallest intervals around both; exact."""
        other = as_interval(other)
        return Interval.from_bounds(np.fmin(self.lo, other.lo), np.fmax(self.hi, other.hi))

    def inflate(self, radius: npt.ArrayLike) -> Interval:
        """Widen by a radius to either side.

        Raises
        ------
        GeometryError
            If a radius is negative or NaN.
        """
        return self + Interval.around(0.0, radius)

    def bisect(self) -> tuple[Interval, Interval]:
        """Halves, which share the middle."""
        mid = self.mid
        return Interval.from_bounds(self.lo, mid), Interval.from_bounds(mid.copy(), self.hi)

    def __and__(self, other: IntervalLike) -> Interval:
        return self.intersection(other)

    def __or__(self, other: IntervalLike) -> Interval:
        return self.hull(other)

    def __neg__(self) -> Interval:
        return Interval.from_bounds(-self.hi, -self.lo)

    def __pos__(self) -> Interval:
        return self

    def __abs__(self) -> Interval:
        low, high = np.abs(self.lo), np.abs(self.hi)
        inside = (self.lo <= 0) & (self.hi >= 0)
        return Interval.from_bounds(np.where(inside, 0.0, np.minimum(low, high)), np.maximum(low, high))

    def __add__(self, other: IntervalLike) -> Interval:
        return elementwise(add_arrays, self, other)

    def __sub__(self, other: IntervalLike) -> Interval:
        return elementwise(add_arrays, self, -as_interval(other))

    def __mul__(self, other: IntervalLike) -> Interval:
        return elementwise(multiply_arrays, self, other)

    def __truediv__(self, other: IntervalLike) -> Interval:
        return elementwise(divide_arrays, self, other)

    def __rsub__(self, other: IntervalLike) -> Interval:
        return -self + other

    def __rtruediv__(self, other: IntervalLike) -> Interval:
        return as_interval(other) / self

    __radd__, __rmul__, __rand__, __ror__ = __add__, __mul__, __and__, __or__

    def __pow__(self, exponent: int) -> Interval:
        if exponent != int(exponent):
            raise GeometryError(f"interval: power {exponent}; only whole exponents are enclosed")
        if exponent == 0:
            return Interval.from_bounds(*(np.where(self.is_empty, np.nan, 1.0) for _ in range(2)))
        whole = elementwise(power_arrays, self, parameters=(abs(int(exponent)),))
        return whole if exponent > 0 else 1.0 / whole


IntervalLike = Interval | npt.ArrayLike


def as_interval(value: IntervalLike) -> Interval:
    """Take numbers for degenerate intervals.

    Raises
    ------
    GeometryError
        If a number is not finite.
    """
    return value if isinstance(value, Interval) else Interval(value)


def elementwise(kernel: Callable[..., None], *operands: IntervalLike, parameters: tuple[object, ...] = ()) -> Interval:
    """Run a kernel of one result over intervals brought to one shape."""
    return elementwise_many(kernel, 1, *operands, parameters=parameters)[0]


def elementwise_many(
    kernel: Callable[..., None], results: int, *operands: IntervalLike, parameters: tuple[object, ...] = ()
) -> tuple[Interval, ...]:
    """Run a kernel over intervals brought to one shape.

    Parameters
    ----------
    kernel : callable
        Takes flat arrays of the bounds of all operands, then the parameters, then flat arrays to write bounds to.
    results : int
        Number of intervals it makes for each element.
    """
    given = [as_interval(operand) for operand in operands]
    shape = np.broadcast_shapes(*(operand.shape for operand in given))
    flat = [
        (bound if bound.shape == shape else np.array(np.broadcast_to(bound, shape), order="C")).ravel()
        for operand in given
        for bound in (operand.lo, operand.hi)
    ]
    out = [np.empty(flat[0].size) for _ in range(2 * results)]
    kernel(*flat, *parameters, *out)
    shaped = [bound.reshape(shape) for bound in out]
    return tuple(Interval.from_bounds(lo, hi) for lo, hi in zip(shaped[::2], shaped[1::2], strict=True))
