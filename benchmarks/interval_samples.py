"""Random intervals of every kind, numbers inside of them, and operations to be checked in extended precision.

An operation on intervals is wrong if it misses the value of a single number inside. Values are computed with numpy's
longdouble; where that rounds only once, rounding is monotone and a value inside the bounds stays there, so that nothing
is found that is not there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

import factorloc.intervals as fi
from factorloc.intervals import Box, Contractor, Interval

__all__ = [
    "CONSTRAINTS", "EXTENDED", "OPERATIONS", "Constraint", "Containment", "Operation", "check_constraint",
    "check_operation",
]  # fmt: skip

Array = npt.NDArray[np.float64]
Rng = np.random.Generator
Extended = Any

L = np.longdouble
_LARGEST = np.finfo(np.float64).max
EXTENDED = bool(np.finfo(L).nmant >= 63)
"""Whether longdouble is wider than double on this machine; without, sines and angles cannot be checked."""


@dataclass(frozen=True)
class Containment:
    """What checking found.

    Parameters
    ----------
    samples, violations : int
        Numbers tried, and those whose value is not enclosed.
    excess : float
        Median width of the result for single numbers, in units in the last place; NaN where it is not measured.
    """

    samples: int
    violations: int
    excess: float = np.nan


@dataclass(frozen=True)
class Operation:
    """A function of one or two intervals.

    Parameters
    ----------
    run : callable
        On intervals; may give several.
    exact : callable
        On longdoubles, alike.
    ranges : tuple of callable
        Draws bounds of each operand, ``(rng, count) -> Interval``.
    """

    run: Callable[..., Interval | tuple[Interval, ...]]
    exact: Callable[..., Extended]
    ranges: tuple[Callable[[Rng, int], Interval], ...]


def any_size(rng: Rng, count: int) -> Interval:
    """Of all magnitudes, with zeros, subnormal, huge and infinite bounds; every fourth a single number."""
    sign, exponent = rng.choice([-1.0, 1.0], (2, count)), rng.uniform(-6, 6, (2, count))
    wild = rng.random((2, count)) < 0.2
    ends = sign * 10.0 ** np.where(wild, rng.uniform(-320, 308, (2, count)), exponent)
    special = np.array(
        [0.0, -0.0, 1.0, -1.0, 5e-324, -5e-324, 2.0**-1022, 1.7976931348623157e308, -1.7976931348623157e308]
    )
    ends = np.where(rng.random((2, count)) < 0.1, rng.choice(special, (2, count)), ends)
    ends[1] = np.where(rng.random(count) < 0.25, ends[0], ends[1])
    lo, hi = ends.min(0), ends.max(0)
    return Interval(np.where(rng.random(count) < 0.05, -np.inf, lo), np.where(rng.random(count) < 0.05, np.inf, hi))


def moderate(least: float, most: float, width: float = 1.0) -> Callable[[Rng, int], Interval]:
    """Of a range, as wide as ``width`` and down to single numbers."""

    def draw(rng: Rng, count: int) -> Interval:
        lo = rng.uniform(least, most, count)
        wide = width * 10.0 ** rng.uniform(-17, 0, count) * (rng.random(count) < 0.75)
        return Interval(lo, np.maximum(np.minimum(lo + wide, most), lo))

    return draw


def angles(rng: Rng, count: int) -> Interval:
    """Small and large angles, around multiples of a quarter turn, and beyond what is reduced."""
    near = rng.integers(-40, 40, count) * (np.pi / 2) + rng.choice([0.0, 1e-17, 1e-15, 1e-9], count)
    lo = np.choose(rng.integers(0, 4, count), [rng.uniform(-10, 10, count), near, rng.uniform(-1.04e6, 1.04e6, count),
                                               10.0 ** rng.uniform(-320, 7, count)])  # fmt: skip
    wide = 10.0 ** rng.uniform(-17, 1, count) * (rng.random(count) < 0.75)
    return Interval(lo, lo + wide)


_THETA, _SHIFT = 0.7, Interval(10.5)
_C, _S = np.cos(L(_THETA)), np.sin(L(_THETA))


def _move(x: Interval, y: Interval) -> tuple[Interval, ...]:
    moved = fi.move(_THETA, _SHIFT, _SHIFT, Box.of(x, y))
    return moved[0], moved[1]


OPERATIONS: Mapping[str, Operation] = {
    "x + y": Operation(lambda x, y: x + y, np.add, (any_size, any_size)),
    "x - y": Operation(lambda x, y: x - y, np.subtract, (any_size, any_size)),
    "x y": Operation(lambda x, y: x * y, np.multiply, (any_size, any_size)),
    "x / y": Operation(lambda x, y: x / y, np.divide, (any_size, any_size)),
    "x^2": Operation(fi.square, np.square, (any_size,)),
    "x^3": Operation(lambda x: x**3, lambda x: x * x * x, (any_size,)),
    "sqrt x": Operation(fi.sqrt, np.sqrt, (any_size,)),
    "|x|": Operation(abs, np.abs, (any_size,)),
    "min": Operation(fi.minimum, np.minimum, (any_size, any_size)),
    "max": Operation(fi.maximum, np.maximum, (any_size, any_size)),
    "hypot": Operation(fi.hypot, np.hypot, (any_size, any_size)),
    "cos": Operation(fi.cos, np.cos, (angles,)),
    "sin": Operation(fi.sin, np.sin, (angles,)),
    "acos": Operation(fi.acos, np.arccos, (moderate(-1.0, 1.0),)),
    "atan2": Operation(fi.atan2, lambda y, x: np.arctan2(y + 0.0, x), (any_size, any_size)),  # no -0
    "sector": Operation(
        fi.sector, lambda r, b: (r * np.cos(b), r * np.sin(b)), (moderate(0.0, 100.0), moderate(-10.0, 10.0, 3.0))
    ),
    "rotate": Operation(
        fi.rotate,
        lambda t, x, y: (np.cos(t) * x - np.sin(t) * y, np.sin(t) * x + np.cos(t) * y),
        (moderate(-10.0, 10.0, 3.0), moderate(-50.0, 50.0), moderate(-50.0, 50.0)),
    ),
    "move": Operation(
        _move, lambda x, y: (_C * x - _S * y + L(_SHIFT.lo), _S * x + _C * y + L(_SHIFT.lo)), (any_size, any_size)
    ),
}
"""What is checked, by name."""


def inside(rng: Rng, interval: Interval) -> Array:
    """Numbers inside: bounds (where finite) as often as others."""
    lo, hi = (np.nan_to_num(bound, posinf=_LARGEST, neginf=-_LARGEST) for bound in (interval.lo, interval.hi))
    part = rng.random(interval.shape)
    part = np.where(rng.random(interval.shape) < 0.5, np.round(part), part)
    return np.clip(np.where(part == 1.0, hi, (1.0 - part) * lo + part * hi), lo, hi)


def check_operation(operation: Operation, rng: Rng, count: int, each: int = 4) -> Containment:
    """Draw ``count`` tuples of intervals and ``each`` numbers in all of them, and look where their values are."""
    operands = [draw(rng, count) for draw in operation.ranges]
    results = as_tuple(operation.run(*operands))
    violations = samples = 0
    with np.errstate(all="ignore"):
        for _ in range(each):
            numbers = [inside(rng, operand) for operand in operands]
            values = as_tuple(operation.exact(*(L(number) for number in numbers)))
            for result, value in zip(results, values, strict=True):
                known = np.isfinite(value)  # outside of the domain there is no value
                missed = known & ~((L(result.lo) <= value) & (value <= L(result.hi)))
                violations += int(missed.sum())
                samples += int(known.sum())
        points = [Interval(number) for number in numbers]
        widths = [image.width / np.spacing(image.magnitude) for image in as_tuple(operation.run(*points))]
        bounded = np.concatenate([width[np.isfinite(width)] for width in widths])
    return Containment(samples, violations, float(np.median(bounded)))


def as_tuple(values: Any) -> tuple[Any, ...]:
    """One value as a tuple of one."""
    return values if isinstance(values, tuple) else (values,)


@dataclass(frozen=True)
class Constraint:
    """A contractor and a way to find solutions.

    Parameters
    ----------
    contractor : Contractor
        To be checked.
    free : tuple of (float, float)
        Ranges of the variables that are drawn.
    solve : callable
        From longdoubles of these, all variables in order.
    """

    contractor: Contractor
    free: tuple[tuple[float, float], ...]
    solve: Callable[..., tuple[Extended, ...]]


def _distance(a: Any, b: Any, c: Any, d: Any) -> tuple[Any, ...]:
    return a, b, c, d, np.hypot(a - c, b - d)


def _motion(t: Any, x: Any, y: Any, p: Any, q: Any) -> tuple[Any, ...]:
    c, s = np.cos(t), np.sin(t)
    return t, x, y, p, q, c * p - s * q + x, s * p + c * q + y


def _heading(t: Any, x: Any, y: Any, r: Any, b: Any, a: Any) -> tuple[Any, ...]:
    return t, x, y, r, b, a, r * np.cos(t + b - a) + x * np.cos(a) + y * np.sin(a)


_FAR, _TURN = (-50.0, 50.0), (-7.0, 7.0)

CONSTRAINTS: Mapping[str, Constraint] = {
    "z = x + y": Constraint(fi.Sum(), (_FAR, _FAR), lambda x, y: (x, y, x + y)),
    "z = x y": Constraint(fi.Product(), (_FAR, _FAR), lambda x, y: (x, y, x * y)),
    "y = x^2": Constraint(fi.Square(), (_FAR,), lambda x: (x, x * x)),
    "y = sin x": Constraint(fi.Sine(), (_FAR,), lambda x: (x, np.sin(x))),
    "y = cos x": Constraint(fi.Cosine(), (_FAR,), lambda x: (x, np.cos(x))),
    "polar": Constraint(fi.Polar(), ((0.0, 50.0), _TURN), lambda r, b: (r * np.cos(b), r * np.sin(b), r, b)),
    "distance": Constraint(fi.Distance(), (_FAR,) * 4, _distance),
    "rigid motion": Constraint(fi.RigidMotion(), (_TURN, *(_FAR,) * 4), _motion),
    "line": Constraint(fi.Line(), (_TURN, _FAR, _FAR), lambda a, x, y: (a, x * np.cos(a) + y * np.sin(a), x, y)),
    "heading": Constraint(fi.Heading(), (_TURN, _FAR, _FAR, (0.1, 50.0), _TURN, _TURN), _heading),
    "polar, repeated": Constraint(
        fi.Fixpoint(fi.Polar()), ((0.0, 50.0), _TURN), lambda r, b: (r * np.cos(b), r * np.sin(b), r, b)
    ),
}
"""Contractors that are checked, by name."""


def check_constraint(constraint: Constraint, rng: Rng, count: int) -> Containment:
    """Draw ``count`` solutions and boxes around them, contract, and look which are lost.

    Sides are from a neighbouring float to tens of units wide; the solution often lies at a bound.
    """
    drawn = [rng.uniform(low, high, count) for low, high in constraint.free]
    drawn = [np.where(rng.random(count) < 0.1, np.round(number), number) for number in drawn]
    solution = constraint.solve(*(L(number) for number in drawn))
    lo, hi = np.empty((len(solution), count)), np.empty((len(solution), count))
    for row, value in enumerate(solution):
        near = value.astype(np.float64)
        given = any(value is number or np.array_equal(L(number), value) for number in drawn)
        ulp = 0.0 if given else np.spacing(np.abs(near))  # a number drawn may be a bound itself, a rounded one not
        for bounds, sign in ((lo, -1.0), (hi, 1.0)):
            wide = 10.0 ** rng.uniform(-17, 1.5, count) * (rng.random(count) < 0.7)
            bounds[row] = near + sign * (ulp + wide)
    box = constraint.contractor.contract(Box(Interval(lo, hi)))
    kept = np.ones(count, np.bool_)
    for row, value in enumerate(solution):
        kept &= (L(box.lo[row]) <= value) & (value <= L(box.hi[row]))
    return Containment(count, int((~kept).sum()))
