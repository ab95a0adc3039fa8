import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from factorloc.errors import GeometryError
from factorloc.intervals import Box, ConvexPolygon, Interval, Line, SegmentHull, Strips, lines_met, union

SQUARE = Box.of(Interval(-2.0, 2.0), Interval(-2.0, 2.0))


def random_strips(rng: np.random.Generator, count: int, through=(0.0, 0.0), width: float = 2.0) -> Strips:
    alpha = rng.uniform(-math.pi, math.pi, count)
    a, b = np.cos(alpha), np.sin(alpha)
    middle = a * through[0] + b * through[1]
    return Strips(a, b, Interval(middle - rng.uniform(0, width, count), middle + rng.uniform(0, width, count)))


def by_shapely(start: Box, strips: Strips) -> shapely.Geometry:
    region = shapely.box(*start.lo, *start.hi)
    for a, b, low, high in zip(strips.a, strips.b, strips.offset.lo, strips.offset.hi, strict=True):
        corners = [(a * d - b * e, b * d + a * e) for d, e in ((low, -99), (high, -99), (high, 99), (low, 99))]
        region = region.intersection(shapely.Polygon(corners))
    return region


def test_clipping_agrees_with_shapely() -> None:
    rng = np.random.default_rng(0)
    for count in (1, 3, 10, 60, 200):
        for _ in range(10):
            strips = random_strips(rng, count)
            polygon = ConvexPolygon.from_box(SQUARE).clip(strips)
            expected = by_shapely(SQUARE, strips)
            assert polygon.area == pytest.approx(expected.area, abs=1e-9)
            assert polygon.to_shapely().buffer(1e-10).covers(expected)
            assert polygon.to_shapely().is_valid


@given(seed=st.integers(0, 2**32 - 1), exponent=st.floats(-3, 7), count=st.integers(1, 40))
def test_a_point_of_all_strips_is_never_cut_off(seed, exponent, count) -> None:
    """Strips through a point, some of no width, far away from the origin: the point stays, by the room promised."""
    rng = np.random.default_rng(seed)
    point = 10.0**exponent * rng.choice([-1, 1], 2) * rng.uniform(0.1, 1, 2)
    box = Box.around(point, rng.uniform(0, 5, 2))
    strips = random_strips(rng, count, point, 1.0)
    if seed % 2:
        strips = Strips(strips.a, strips.b, Interval.around(strips.a * point[0] + strips.b * point[1], 0.0))
    polygon = ConvexPolygon.from_box(box).clip(strips).clip(strips)
    assert not polygon.is_empty
    scale = float(np.abs(point).max())
    # Clearly inside, not by luck: the shift is there to be used up by rounding, not all of it at once.
    inner = polygon.to_shapely()
    assert inner.distance(shapely.Point(point)) == 0
    assert inner.exterior.distance(shapely.Point(point)) > 1e-13 * scale


def test_margins_do_not_grow_beyond_their_promise() -> None:
    strips = random_strips(np.random.default_rng(1), 50)
    once = ConvexPolygon.from_box(SQUARE).clip(strips)
    twice = once.clip(strips)
    assert once.to_shapely().buffer(1e-11).covers(twice.to_shapely())


def test_half_planes_may_leave_nothing() -> None:
    polygon = ConvexPolygon.from_box(SQUARE)
    assert polygon.clip_half_planes([1.0], [0.0], [-3.0]).is_empty
    assert polygon.clip_half_planes([1.0], [0.0], [-1e300]).is_empty
    assert polygon.clip_half_planes([1.0], [0.0], [1e300]).area == pytest.approx(16.0)
    assert polygon.clip_half_planes([1.0, -1.0], [0.0, 0.0], [math.inf, 0.0]).area == pytest.approx(8.0)
    assert polygon.clip_half_planes([1.0], [0.0], [math.nan]).is_empty
    gone = polygon.clip(Strips(np.ones(1), np.zeros(1), Interval.empty((1,))))
    assert gone.is_empty
    assert gone.area == 0
    assert gone.box.is_empty
    assert gone.clip_half_planes([1.0], [0.0], [0.0]).is_empty
    assert not gone.contains([0.0, 0.0])
    assert ConvexPolygon.from_box(Box(Interval.empty((2,)))).is_empty


def test_unlike_normals_are_one_half_plane() -> None:
    polygon = ConvexPolygon.from_box(SQUARE)
    for scale in (1e-6, 1.0, 1e6):
        assert polygon.clip_half_planes([scale], [scale], [0.0]).area == pytest.approx(8.0)


def test_a_triangle_is_kept_when_clipped_by_nothing() -> None:
    triangle = ConvexPolygon(np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 3.0]]))
    same = triangle.clip_half_planes([], [], [])
    assert same.area == pytest.approx(6.0)
    assert same.to_shapely().covers(triangle.to_shapely())
    assert same.contains([[1.0, 1.0], [3.0, 3.0]]).tolist() == [True, False]
    back = ConvexPolygon.from_shapely(triangle.to_shapely())
    assert back.area == triangle.area
    assert back.contains([1.0, 1.0])  # counter-clockwise
    assert ConvexPolygon.from_shapely(shapely.Point(0, 0)).is_empty


def test_union_of_polygons() -> None:
    one, two = (ConvexPolygon.from_box(Box.around([x, 0.0], 1.0)) for x in (0.0, 1.0))
    assert union([one, two]).area == pytest.approx(6.0)
    assert union([one, ConvexPolygon.from_box(Box.around([9.0, 0.0], 1.0))]).geom_type == "MultiPolygon"
    assert union([]).is_empty


def test_strips_hold_every_direction() -> None:
    rng = np.random.default_rng(7)
    within = Box.of(Interval(480.0, 500.0), Interval(-310.0, -300.0))
    for _ in range(300):
        alpha, d = rng.uniform(-3, 3), rng.uniform(-0.2, 0.2)
        point = rng.uniform(within.lo, within.hi)
        radius = 10.0 ** rng.uniform(-9, -1.5)
        turned = alpha + rng.uniform(-radius, radius)
        exact = float(np.cos(np.longdouble(turned)) * point[0] + np.sin(np.longdouble(turned)) * point[1])
        strips = Strips.from_lines(
            Interval(np.array([alpha - radius]), alpha + radius),
            Interval(np.array([exact + min(d, 0) - 1e-13]), exact + abs(d) + 1e-13),
            within,
        )
        assert strips.offset.contains(strips.a * point[0] + strips.b * point[1]).all()
        assert not ConvexPolygon.from_box(within).clip(strips).is_empty
    with pytest.raises(GeometryError, match="within"):
        Strips.from_lines(Interval([0.0]), Interval([0.0]), Box.of(Interval(0, math.inf), 0.0))


def test_a_narrow_direction_costs_little() -> None:
    strips = Strips.from_lines(Interval([0.5]), Interval([10.0], [11.0]), Box.around([10.0, 5.0], 2.0))
    assert strips.offset.width[0] == pytest.approx(1.0, abs=1e-12)
    assert len(strips) == 1


def test_lines_met_passes_no_point_over() -> None:
    rng = np.random.default_rng(3)
    ends = rng.uniform(-50, 50, (30, 2, 2))
    across = ends[:, 1] - ends[:, 0]
    alpha = np.arctan2(-across[:, 0], across[:, 1])
    d = np.cos(alpha) * ends[:, 0, 0] + np.sin(alpha) * ends[:, 0, 1]
    segments = Box(Interval(ends.min(1).T, ends.max(1).T))
    on = ends[:, 0] + rng.random((30, 1)) * across
    points = Box.around(on.T, 1e-9).inflate(np.where(rng.random(30) < 0.5, 0.0, 1.0))
    met = lines_met(points, Interval.around(alpha, 1e-12), Interval.around(d, 1e-10), segments)
    assert met.shape == (30, 30)
    assert met.diagonal().all()
    # What the contractor of the line finds to be empty, or nearly: the test is no looser.
    for k in range(30):
        box = Box.of(Interval.around(alpha[k], 1e-12), Interval.around(d[k], 1e-10), points[0], points[1])
        left = Line().contract(box)
        hull = ~SegmentHull(Box.of(segments[0][k], segments[1][k])).contract(points).is_empty
        assert (met[k] <= hull).all()
        assert (met[k] >= (~left.is_empty & hull)).all()
    assert met.mean() < 0.5
    entire = Box(Interval.entire((2, 1)))
    assert lines_met(entire, Interval.around(alpha, 1e-12), Interval.around(d, 1e-10), segments).all()
    assert not lines_met(Box(Interval.empty((2, 1))), Interval(alpha), Interval(d), segments).any()


def test_a_far_box_is_held_too() -> None:
    within = Box.of(Interval(5e6, 5e6 + 1), Interval(3e5, 3e5 + 1))
    strips = Strips.from_lines(Interval([0.3], [0.31]), Interval(-np.full(1, math.inf), 1e9), within)
    assert strips.offset.hi[0] > 1e9
    assert strips.offset.lo[0] == -math.inf


def test_what_is_no_polygon() -> None:
    with pytest.raises(GeometryError, match="normal"):
        ConvexPolygon.from_box(SQUARE).clip_half_planes([0.0], [0.0], [1.0])
    with pytest.raises(GeometryError, match="unbounded"):
        ConvexPolygon.from_box(Box.of(Interval(0, math.inf), 0.0))
    with pytest.raises(GeometryError, match="single box"):
        ConvexPolygon.from_box(Box.of(Interval([0.0], [1.0]), 0.0))
