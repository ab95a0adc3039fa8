import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from factorloc.errors import GeometryError
from factorloc.intervals import (
    Interval,
    acos,
    atan2,
    cos,
    cos_sin,
    hypot,
    maximum,
    minimum,
    pi,
    rotate,
    sector,
    sin,
    sqrt,
    square,
)

INF = math.inf
MAX = float(np.finfo(np.float64).max)
TINY = 5e-324


@st.composite
def intervals(draw, least: float = -1e308, most: float = 1e308) -> Interval:
    ends = sorted(draw(st.lists(st.floats(least, most), min_size=2, max_size=2)))
    return Interval(*ends)


@st.composite
def nested(draw, least: float = -1e6, most: float = 1e6) -> tuple[Interval, Interval]:
    a, b, c, d = sorted(draw(st.lists(st.floats(least, most), min_size=4, max_size=4)))
    return Interval(b, c), Interval(a, d)


UNARY = {
    "square": square, "sqrt": sqrt, "abs": abs, "cos": cos, "sin": sin, "acos": acos, "cube": lambda x: x**3,
    "fourth": lambda x: x**4, "inverse": lambda x: 1 / x, "inverse square": lambda x: x**-2, "negative": lambda x: -x,
}  # fmt: skip
BINARY = {
    "add": lambda x, y: x + y, "subtract": lambda x, y: x - y, "multiply": lambda x, y: x * y,
    "divide": lambda x, y: x / y, "atan2": atan2, "hypot": hypot, "minimum": minimum, "maximum": maximum,
    "sector": lambda x, y: sector(x, y)[0], "hull": lambda x, y: x | y, "meet": lambda x, y: x & y,
}  # fmt: skip


@pytest.mark.parametrize("name", UNARY)
@given(pair=nested(-4.0, 4.0) | nested())
def test_functions_grow_with_their_argument(name, pair) -> None:
    small, large = pair
    assert UNARY[name](small).is_subset(UNARY[name](large))


@pytest.mark.parametrize("name", BINARY)
@given(first=nested(), second=nested(-4.0, 4.0))
def test_operations_grow_with_their_arguments(name, first, second) -> None:
    assert BINARY[name](first[0], second[0]).is_subset(BINARY[name](first[1], second[1]))


@given(x=intervals(), y=intervals())
def test_arithmetic_encloses_exact_fractions(x, y) -> None:
    for a in (float(x.lo), float(x.hi)):
        for b in (float(y.lo), float(y.hi)):
            exact = {"+": Fraction(a) + Fraction(b), "-": Fraction(a) - Fraction(b), "*": Fraction(a) * Fraction(b)}
            results = {"+": x + y, "-": x - y, "*": x * y}
            if b != 0:
                exact["/"], results["/"] = Fraction(a) / Fraction(b), x / y
            for sign, value in exact.items():
                if math.isfinite(results[sign].lo):
                    assert Fraction(float(results[sign].lo)) <= value, sign
                if math.isfinite(results[sign].hi):
                    assert value <= Fraction(float(results[sign].hi)), sign


def lies(interval: Interval, lo: float, hi: float, near: float = 1e-14) -> bool:
    """Whether bounds are those expected, or a little outside."""

    def close(bound, expected, sign):
        return bound == expected or 0 <= sign * (bound - expected) <= near * max(1.0, abs(expected))

    return close(float(interval.lo), lo, -1) and close(float(interval.hi), hi, 1)


@pytest.mark.parametrize(
    ("interval", "lo", "hi"),
    [
        (Interval(1, 2) / Interval(0, 4), 0.25, INF),
        (Interval(1, 2) / Interval(-4, 0), -INF, -0.25),
        (Interval(1, 2) / Interval(-0.0, 4), 0.25, INF),
        (Interval(-2, -1) / Interval(0, 4), -INF, -0.25),
        (Interval(1, 2) / Interval(-1, 1), -INF, INF),
        (Interval(-1, 2) / Interval(0, 1), -INF, INF),
        (Interval(0, 0) * Interval.entire(), 0.0, 0.0),
        (Interval(0, 1) * Interval(1, INF), 0.0, INF),
        (Interval(0, INF) * Interval(0, 0), 0.0, 0.0),
        (Interval(1, INF) / Interval(1, INF), 0.0, INF),
        (Interval(MAX) + Interval(MAX), MAX, INF),
        (Interval(-MAX) * Interval(2), -INF, -MAX),
        (Interval(TINY) * Interval(0.5), 0.0, TINY),
        (Interval(-1, 2) ** 2, 0.0, 4.0),
        (Interval(-2, 1) ** 3, -8.0, 1.0),
        (Interval(2, 4) ** -1, 0.25, 0.5),
        (Interval(-3, 7) ** 0, 1.0, 1.0),
        (abs(Interval(-3, 2)), 0.0, 3.0),
        (sqrt(Interval(-4, 9)), 0.0, 3.0),
        (acos(Interval(-5, 0.5)), math.pi / 3, math.pi),
        (cos(Interval(-1, 1)), math.cos(1), 1.0),
        (sin(Interval(1, 2)), math.sin(1), 1.0),
        (sin(Interval(4, 5)), -1.0, math.sin(4)),
        (cos(Interval(0, 1e7)), -1.0, 1.0),
        (sin(Interval(-INF, INF)), -1.0, 1.0),
        (cos(Interval(1e300)), -1.0, 1.0),
        (sin(Interval(0)), 0.0, 0.0),
        (atan2(Interval(-1, 1), Interval(1, 2)), -math.pi / 4, math.pi / 4),
        (atan2(Interval(-1, 1), Interval(-2, -1)), -math.pi, math.pi),
        (atan2(Interval(1, 2), Interval(-1, 1)), math.pi / 4, 3 * math.pi / 4),
        (atan2(Interval(-2, -1), Interval(-1, 1)), -3 * math.pi / 4, -math.pi / 4),
        (atan2(Interval(0, 1), Interval(-2, -1)), 3 * math.pi / 4, math.pi),
        (atan2(Interval(-1, 0), Interval(-2, -1)), -math.pi, math.pi),
        (atan2(Interval(-1, 1), Interval(0, 1)), -math.pi, math.pi),
        (atan2(Interval(-1, 1), Interval(-1, 1)), -math.pi, math.pi),
        (atan2(Interval(1, INF), Interval(-INF, INF)), 0.0, math.pi),
        (atan2(Interval(0), Interval(-1)), math.pi, math.pi),
        (hypot(Interval(3), Interval(-4, 1)), 3.0, 5.0),
    ],
)  # fmt: skip
def test_edges(interval, lo, hi) -> None:
    assert lies(interval, lo, hi), interval


def test_angles_around_extrema_have_them_inside() -> None:
    for k in range(-50, 50):
        for step in (-1, 0, 1):
            at = k * math.pi / 2 + step * 1e-12
            c, s = cos_sin(Interval(at - 1e-10, at + 1e-10))
            exact = [(1, 0), (0, 1), (-1, 0), (0, -1)][k % 4]
            assert c.contains(exact[0])
            assert s.contains(exact[1])


def test_what_is_computed_from_nothing_is_empty() -> None:
    empty, some = Interval.empty(), Interval(-1, 1)
    for function in UNARY.values():
        assert function(empty).is_empty
    for name, function in BINARY.items():
        if name != "hull":
            assert function(empty, some).is_empty, name
            assert function(some, empty).is_empty, name
            assert function(empty, Interval(0)).is_empty, name
    assert lies(empty | some, -1, 1)
    assert (Interval(1, 2) & Interval(3, 4)).is_empty
    assert sqrt(Interval(-2, -1)).is_empty
    assert acos(Interval(2, 3)).is_empty
    assert (some / Interval(0)).is_empty
    assert lies(atan2(Interval(0), Interval(0)), -math.pi, math.pi)  # the zero vector may have any angle
    assert not empty.contains(0)
    assert not empty.meets(some)
    assert empty.is_subset(some)
    assert np.isnan(empty.width)
    assert repr(empty) == "Interval.empty()"


def test_an_element_alone_is_empty() -> None:
    cut = Interval([0.0, 0.0], [1.0, 3.0]) & Interval(2, 4)
    assert cut.is_empty.tolist() == [True, False]
    assert (cut + 1).is_empty.tolist() == [True, False]


@pytest.mark.parametrize(
    "bounds", [(2, 1), (math.nan, 1), (0, math.nan), (math.nan, math.nan), (INF, INF), (-INF, -INF)]
)
def test_bounds_by_hand_must_make_sense(bounds) -> None:
    with pytest.raises(GeometryError, match="interval"):
        Interval(*bounds)


@pytest.mark.parametrize("radius", [-1.0, math.nan])
def test_a_radius_is_not_negative(radius) -> None:
    for make in (lambda: Interval.around(0.0, radius), lambda: Interval(0, 1).inflate(radius)):
        with pytest.raises(GeometryError, match="radius"):
            make()


def test_shapes_are_kept_and_broadcast() -> None:
    column, row = Interval(np.zeros((3, 1)), 1.0), np.arange(4.0)
    total = row * column + column[0]
    assert total.shape == (3, 4)
    assert total[2, 3].shape == ()
    assert lies(total[2, 3], 0, 4)
    assert len(column) == 3
    assert Interval(np.zeros((0, 2))).size == 0
    assert (Interval(np.zeros((0, 2))) * 2).shape == (0, 2)
    assert lies(3 - Interval(1, 2), 1, 2)
    assert lies(6 / Interval(2, 3), 2, 3)


def test_operands_are_left_alone() -> None:
    x = Interval([1.0, 2.0], [3.0, 4.0])
    square(x), cos(x), x + x, x.bisect(), x | 0.0, -x
    assert x.lo.tolist() == [1.0, 2.0]
    assert x.hi.tolist() == [3.0, 4.0]


@given(x=intervals())
def test_middle_halves_and_width(x) -> None:
    assert x.contains(x.mid)
    left, right = x.bisect()
    assert left.hi == right.lo == x.mid
    assert (left | right).is_subset(x) and x.is_subset(left | right)
    assert Fraction(float(x.hi)) - Fraction(float(x.lo)) <= Fraction(float(min(x.width, MAX))) or x.width == INF


def test_middles_of_unbounded_intervals_are_inside() -> None:
    for x in (Interval.entire(), Interval(3, INF), Interval(-INF, -MAX), Interval(MAX, INF)):
        assert x.contains(x.mid)
    assert Interval.entire().mid == 0


def test_inflating_and_around_go_outwards() -> None:
    third = Interval.around(1 / 3, 1e-17)
    assert Fraction(float(third.lo)) < Fraction(1, 3) < Fraction(float(third.hi))
    assert lies(Interval(1, 2).inflate(0.5), 0.5, 2.5)
    assert float(Interval(1, 2).inflate(0.5).lo) < 0.5


def test_powers_are_whole() -> None:
    with pytest.raises(GeometryError, match="power"):
        Interval(1, 2) ** 0.5


def test_pi_lies_between_neighbours() -> None:
    assert float(pi().hi) == np.nextafter(float(pi().lo), 4)
    assert math.sin(float(pi().lo)) > 0 > math.sin(float(pi().hi))


def test_turning_a_vector() -> None:
    x, y = rotate(Interval(0.3, 0.31), Interval(5.0), Interval(1.0))
    t = 0.305
    assert x.contains(5 * math.cos(t) - math.sin(t))
    assert y.contains(5 * math.sin(t) + math.cos(t))


def test_bounds_are_tight() -> None:
    x = np.random.default_rng(0).uniform(-3, 3, 1000)
    one = Interval(x)
    ulps = {"+": one + 0.1, "*": one * 0.1, "/": one / 3, "sqrt": sqrt(abs(one)), "acos": acos(one / 4)}
    most = {"+": 4, "*": 4, "/": 4, "sqrt": 4, "acos": 60}
    for name, result in ulps.items():
        assert (result.width <= most[name] * np.spacing(result.magnitude)).all(), name
    assert (cos(one).width <= 2.0**-53 * (12 * np.abs(np.cos(x)) + 4)).all()
    assert (sin(one / 4).width <= 2.0**-53 * 14 * np.abs(np.sin(x / 4))).all()
