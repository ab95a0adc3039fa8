import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from factorloc.errors import GeometryError
from factorloc.intervals import (
    AnyOf,
    Box,
    Contractor,
    Cosine,
    Distance,
    Fixpoint,
    Heading,
    InSequence,
    Interval,
    Line,
    Linear,
    OnAxes,
    Polar,
    Product,
    Relaxed,
    RigidMotion,
    SegmentHull,
    Sine,
    Square,
    Sum,
    relaxed_intersection,
    segment,
)

EQUATIONS = {
    "sum": (Sum(), 3), "product": (Product(), 3), "square": (Square(), 2), "sine": (Sine(), 2), "cosine": (Cosine(), 2),
    "polar": (Polar(), 4), "distance": (Distance(), 5), "motion": (RigidMotion(), 7), "line": (Line(), 4),
    "heading": (Heading(), 7), "linear": (Linear(1.0, -2.0, Interval(-1.0, 3.0)), 2),
}  # fmt: skip


@st.composite
def boxes(draw, sides: int, most: float = 8.0) -> tuple[Box, Box]:
    ends = np.array([sorted(draw(st.lists(st.floats(-most, most), min_size=4, max_size=4))) for _ in range(sides)]).T
    return Box(Interval(ends[1], ends[2])), Box(Interval(ends[0], ends[3]))


@pytest.mark.parametrize("name", EQUATIONS)
@given(data=st.data())
def test_contractors_shrink_and_are_monotone(name, data) -> None:
    contractor, sides = EQUATIONS[name]
    small, large = data.draw(boxes(sides))
    assert contractor.contract(small).is_subset(small)
    # Rounding of a smaller box may end one float further out than that of a larger one where the two are not the same.
    slack = contractor.contract(large)
    slack = slack if slack.is_empty else slack.inflate(1e-6 if not contractor.minimal else 1e-12)
    assert contractor.contract(small).is_subset(slack)


@pytest.mark.parametrize("name", [name for name, (contractor, _) in EQUATIONS.items() if contractor.minimal])
@given(data=st.data())
def test_minimal_contractors_have_nothing_left_to_do(name, data) -> None:
    contractor, sides = EQUATIONS[name]
    _, box = data.draw(boxes(sides))
    once = contractor.contract(box)
    if not once.is_empty:
        twice = contractor.contract(once)
        # A root of a rounded number is off by the root of the rounding, where it vanishes.
        near = 1e-7 if name in ("square", "sine", "cosine") else 1e-9
        assert not twice.is_empty
        assert once.is_subset(twice.inflate(near))


@pytest.mark.parametrize("name", [name for name, (contractor, _) in EQUATIONS.items() if contractor.minimal])
def test_minimal_contractors_end_at_solutions(name) -> None:
    """Every bound of the result is reached by a solution, searched on a fine grid of the free variables."""
    contractor, sides = EQUATIONS[name]
    rng = np.random.default_rng(3)
    grid = np.linspace(0, 1, 241)
    for _ in range(25):
        ends = np.sort(rng.uniform(-4, 4, (2, sides)), axis=0)
        box = Box(Interval(ends[0], ends[1]))
        x = ends[0, 0] + grid * (ends[1, 0] - ends[0, 0])
        y = ends[0, 1] + grid * (ends[1, 1] - ends[0, 1])
        if sides == 3:
            X, Y = (side.ravel() for side in np.meshgrid(x, y))
            points = np.stack([X, Y, X + Y if name == "sum" else X * Y])
        elif name == "linear":
            points = np.stack([side.ravel() for side in np.meshgrid(x, y)])
            total = points[0] - 2 * points[1]
            points = points[:, (total >= -1) & (total <= 3)]
        else:
            x = np.linspace(ends[0, 0], ends[1, 0], 20001)
            points = np.stack([x, {"square": np.square, "sine": np.sin, "cosine": np.cos}[name](x)])
        points = points[:, box.contains(points) if points.ndim == 1 else Box(
            Interval(ends[0][:, None], ends[1][:, None])).contains(points)]  # fmt: skip
        result = contractor.contract(box)
        if points.shape[1]:
            assert (points.min(1) >= result.lo).all()
            assert (points.max(1) <= result.hi).all()
            if points.shape[1] > 300:
                assert np.allclose(points.min(1), result.lo, atol=0.25)
                assert np.allclose(points.max(1), result.hi, atol=0.25)
        elif not result.is_empty:
            assert (result.width < 0.3).any()


def test_batches_are_contracted_one_by_one() -> None:
    rng = np.random.default_rng(0)
    for contractor, sides in EQUATIONS.values():
        ends = np.sort(rng.uniform(-5, 5, (2, sides, 4, 3)), axis=0)
        batch = contractor.contract(Box(Interval(ends[0], ends[1])))
        assert batch.batch == (4, 3)
        one = contractor.contract(Box(Interval(ends[0][:, 2, 1], ends[1][:, 2, 1])))
        assert np.array_equal(one.lo, batch.lo[:, 2, 1], equal_nan=True)
        empty = Box(Interval.empty((sides, 2)))
        assert contractor.contract(empty).is_empty.all()


def test_division_keeps_two_pieces_until_they_are_met() -> None:
    box = Product().contract(Box.of(Interval(-0.5, 10), Interval(-1, 2), Interval(4, 5)))
    assert box.lo[0] == pytest.approx(2.0)
    assert Product().contract(Box.of(Interval(-1, 1), Interval(-1, 2), Interval(4, 5))).is_empty
    free = Product().contract(Box.of(Interval(-1, 1), Interval(-1, 1), Interval(0, 0)))
    assert free.lo.tolist()[:2] == [-1.0, -1.0]


def test_bearings_are_followed_through_turns() -> None:
    far = Polar().contract(Box.of(Interval(-5, -4), Interval(-0.1, 0.1), Interval(0, 100), Interval(2 * math.pi, 10.0)))
    assert far.lo[3] == pytest.approx(3 * math.pi - 0.1 / 4, abs=1e-4)
    assert far.hi[3] == pytest.approx(3 * math.pi + 0.1 / 4, abs=1e-4)
    assert Polar().contract(Box.of(Interval(4, 5), Interval(0, 1), Interval(0, 100), Interval(1, 6))).is_empty
    origin = Polar().contract(Box.of(Interval(0), Interval(0), Interval(0, 1), Interval(1, 6)))
    assert (float(origin.lo[3]), float(origin.hi[3])) == (1.0, 6.0)


def test_two_known_points_give_the_heading() -> None:
    truth, local = 2.9, np.array([4.0, 1.0])
    c, s = math.cos(truth), math.sin(truth)
    target = np.array([c * local[0] - s * local[1] + 1.0, s * local[0] + c * local[1] + 2.0])
    box = RigidMotion().contract(
        Box.of(Interval(-math.pi, math.pi), 1.0, 2.0, *local, *(Interval.around(value, 0.01) for value in target))
    )
    assert box[0].contains(truth)
    assert box[0].width < 0.012


def test_a_facade_gives_the_heading() -> None:
    sensor = Interval(0.0, 0.02), Interval(0.0, 0.02)
    wide = Box.of(Interval(-0.5, 0.5), *sensor, Interval.around(10.0, 0.01), Interval.around(1.4, 0.001), 0.0, 0.5)
    truth = math.acos(0.5 / 10) - 1.4
    narrow = Heading().contract(wide)
    assert narrow[0].contains(truth)
    assert narrow[0].width < 0.01
    assert Heading().contract(wide.put((6,), Box.of(20.0))).is_empty


def test_sides_must_be_the_variables() -> None:
    for contractor in (Sum(), Distance()):
        with pytest.raises(GeometryError, match="sides"):
            contractor.contract(Box.of(Interval(0, 1), 2.0))


def test_every_contractor_says_what_it_does() -> None:
    single = [contractor for contractor, _ in EQUATIONS.values()] + [SegmentHull(Box.of(0.0, Interval(0, 1)))]
    made = [InSequence((single[0],)), AnyOf((single[0],)), Relaxed((single[0], single[0]), 1), Fixpoint(single[0])]
    for contractor in [*single, *made, OnAxes(Sum(), (0, 1, 3))]:
        assert isinstance(contractor, Contractor)
        assert contractor.constraint
        assert contractor.minimal in (True, False)
    assert InSequence((Sum(),)).minimal
    assert not InSequence((Sum(), Sum())).minimal


def test_all_any_and_some_axes() -> None:
    box = Box.of(Interval(0, 10), Interval(0, 10))
    low, high = Linear(1.0, 0.0, Interval(1, 2)), Linear(1.0, 0.0, Interval(4, 5))
    assert InSequence((low, high)).contract(box).is_empty
    both = AnyOf((low, high)).contract(box)
    assert (both.lo[0], both.hi[0]) == (pytest.approx(1.0), pytest.approx(5.0))
    on = OnAxes(Sum(), (0, 2, 1)).contract(Box.of(Interval(0, 1), Interval(0, 1), Interval(-5, 5), 7.0))
    assert (on.lo[2], on.hi[2]) == (pytest.approx(-1.0), pytest.approx(1.0))
    assert on.lo[3] == 7.0
    with pytest.raises(GeometryError, match="at least one"):
        assert InSequence(()).constraint


def test_a_fixpoint_is_where_a_contractor_stops() -> None:
    # x + y = 1 and x = y: each contraction halves the box.
    both = InSequence((Linear(1.0, 1.0, Interval(1.0)), Linear(1.0, -1.0, Interval(0.0))))
    spinning = InSequence((both, Linear(1.0, 0.3, Interval(0.65))))
    start = Box.of(Interval([0.0, 5.0], [1.0, 6.0]), Interval([0.0, 5.0], [1.0, 6.0]))
    end = Fixpoint(spinning, ratio=0.9).contract(start)
    assert end.contains([[0.5, 0.5], [0.5, 0.5]]).tolist() == [True, False]
    assert end.width[0, 0] < 1e-12
    assert end.is_empty[1]
    assert Fixpoint(spinning, rounds=1).contract(start).width[0, 0] > end.width[0, 0]
    for ratio, rounds in ((1.0, 5), (0.5, 0)):
        with pytest.raises(GeometryError, match="fixpoint"):
            Fixpoint(both, ratio, rounds)


def test_segments_keep_their_points() -> None:
    rng = np.random.default_rng(2)
    for _ in range(50):
        p, q = rng.uniform(-50, 50, (2, 2))
        t = rng.random(200)
        points = p + t[:, None] * (q - p)
        box = segment(p, q).contract(Box.around(points.T, 1e-9))
        assert not box.is_empty.any()
        assert (
            segment(p, q).contract(Box.around(points.T + np.array([[q[1] - p[1]], [p[0] - q[0]]]), 1e-3)).is_empty.all()
        )
    assert segment([1.0, 2.0], [1.0, 2.0]).contract(Box.of(Interval(0, 3), Interval(0, 3))).width.max() == 0


# --- all but q ---


def naive_relaxed(pairs: list[tuple[float, float]], q: int) -> tuple[float, float] | None:
    """Try every bound as a point: the hull of what is shared begins and ends at one."""
    ends = [end for pair in pairs for end in pair]
    good = [end for end in ends if sum(lo <= end <= hi for lo, hi in pairs) >= len(pairs) - q]
    return (min(good), max(good)) if good else None


@given(data=st.data())
def test_relaxed_intersection_is_the_hull_of_a_sweep(data) -> None:
    ends = st.integers(-6, 6).map(float) | st.sampled_from([-math.inf, math.inf])
    pairs = data.draw(st.lists(st.tuples(ends, ends).map(sorted).filter(lambda p: p[0] < math.inf and p[1] > -math.inf),
                               min_size=1, max_size=9))  # fmt: skip
    q = data.draw(st.integers(0, len(pairs) - 1))
    result = relaxed_intersection([Box.of(Interval(*pair)) for pair in pairs], q)
    expected = naive_relaxed(pairs, q)
    if expected is None:
        assert result.is_empty
    else:
        assert (float(result.lo[0]), float(result.hi[0])) == expected


def test_relaxation_bounds_points_in_all_but_q_boxes() -> None:
    rng = np.random.default_rng(4)
    for _ in range(100):
        ends = np.sort(rng.uniform(0, 4, (2, 2, 7)), axis=0)
        every = [Box(Interval(ends[0, :, k], ends[1, :, k])) for k in range(7)]
        points = rng.uniform(0, 4, (2, 400))
        for q in (0, 2, 5):
            inside = sum(((ends[0, :, k, None] <= points) & (points <= ends[1, :, k, None])).all(0) for k in range(7))
            result = relaxed_intersection(every, q)
            shared = points[:, inside >= 7 - q]
            assert (result.lo[:, None] <= shared).all() if shared.size else True
            assert (shared <= result.hi[:, None]).all() if shared.size else True


def test_many_intervals_are_relaxed_alike() -> None:
    rng = np.random.default_rng(8)
    pairs = [tuple(sorted(pair)) for pair in rng.integers(-40, 40, (90, 2)).astype(float).tolist()]
    for q in (30, 50, 80):
        result = relaxed_intersection([Box.of(Interval(*pair)) for pair in pairs], q)
        assert (None if result.is_empty else (float(result.lo[0]), float(result.hi[0]))) == naive_relaxed(pairs, q)


def test_an_empty_box_is_one_that_fails() -> None:
    some, none = Box.of(Interval(0, 1)), Box(Interval.empty((1,)))
    assert relaxed_intersection([some, none], 0).is_empty
    assert relaxed_intersection([some, none], 1).hi[0] == 1.0
    outlier = Relaxed(
        (Linear(1.0, 0.0, Interval(0, 1)), Linear(1.0, 0.0, Interval(0.5, 2)), Linear(1.0, 0.0, Interval(7))), 1
    )
    box = outlier.contract(Box.of(Interval(-9, 9), Interval(-9, 9)))
    assert (box.lo[0], box.hi[0]) == (pytest.approx(0.5), pytest.approx(1.0))
    for q in (-1, 2):
        with pytest.raises(GeometryError, match="q:"):
            relaxed_intersection([some, none], q)
        with pytest.raises(GeometryError, match="q:"):
            Relaxed((Sum(), Sum()), q)
