"""Interval Hough transform: no vote of a box that a line meets is lost, and peaks are where lines are."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from factorloc.errors import GeometryError
from factorloc.intervals import Box, Interval
from factorloc.intervals.hough import HoughAccumulator


def boxes_on_line(rng, alpha, d, count, radius):
    s = rng.uniform(-15, 15, count)
    points = np.array([np.cos(alpha) * d - np.sin(alpha) * s, np.sin(alpha) * d + np.cos(alpha) * s])
    return Box.around(points + rng.uniform(-radius, radius, (2, count)), radius)


def votes_by_corners(lo, hi, alphas, edges, low, high):
    """Naive reference: whether any of many directions of a bin brings a box into a bin of distances."""
    corners = np.array([[lo[0], lo[1]], [lo[0], hi[1]], [hi[0], lo[1]], [hi[0], hi[1]]])
    d = np.cos(alphas)[:, None] * corners[:, 0] + np.sin(alphas)[:, None] * corners[:, 1]
    return ((d.min(1) < high) & (d.max(1) > low)).any()


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.floats(-3.1, 3.1), st.floats(-40, 40), st.floats(0.0, 0.3))
def test_the_cell_of_a_line_has_a_vote_of_every_box_it_meets(seed, alpha, d, radius):
    rng = np.random.default_rng(seed)
    points = boxes_on_line(rng, alpha, d, 300, radius)
    accumulator = HoughAccumulator.from_boxes(points, Interval(alpha - 0.2, alpha + 0.2), Interval(d - 3, d + 3))
    row, column = accumulator.cell(alpha, d)
    assert accumulator.counts[row, column] == 300


def test_monte_carlo_of_many_lines_has_no_violation():
    # Every line through a point of a box must find the vote of that box: a million pairs.
    rng = np.random.default_rng(8)
    for _ in range(10):
        lo = rng.uniform(-30, 30, 2)
        box = Box(Interval(lo[:, None], lo[:, None] + rng.uniform(0, 0.5, (2, 1))))
        accumulator = HoughAccumulator.from_boxes(box, Interval(-3.2, 3.2), Interval(-60, 60))
        inside = box.lo + (box.hi - box.lo) * rng.uniform(0, 1, (2, 100_000))
        inside = np.clip(inside, box.lo, box.hi)
        alpha = rng.uniform(-3.19, 3.19, 100_000)
        rows, columns = accumulator.cell(alpha, np.cos(alpha) * inside[0] + np.sin(alpha) * inside[1])
        assert (accumulator.counts[rows, columns] == 1).all()


def test_few_votes_are_given_beyond_what_the_naive_count_finds():
    rng = np.random.default_rng(9)
    boxes = Box.around(rng.uniform(-10, 10, (2, 40)), 0.05)
    accumulator = HoughAccumulator.from_boxes(boxes, Interval(0.0, 0.5), Interval(-12, 12))
    extra = total = 0
    for row in range(0, len(accumulator.counts), 7):
        first = accumulator.alpha_first + row * accumulator.alpha_step
        alphas = np.linspace(first, first + accumulator.alpha_step, 9)
        for column in range(0, accumulator.counts.shape[1], 11):
            low = accumulator.d_first + column * accumulator.d_step
            naive = sum(
                votes_by_corners(boxes.lo[:, i], boxes.hi[:, i], alphas, None, low, low + accumulator.d_step)
                for i in range(40)
            )
            assert accumulator.counts[row, column] >= naive
            extra += accumulator.counts[row, column] - naive
            total += naive
    assert total > 100
    assert extra <= 0.3 * total  # dependence of cosine and sine, once a bin


def test_peak_holds_the_line_and_tells_its_rival():
    rng = np.random.default_rng(10)
    strong, weak = boxes_on_line(rng, 0.3, 8.0, 200, 0.05), boxes_on_line(rng, 0.3, 13.0, 90, 0.05)
    clutter = Box.around(rng.uniform(-15, 15, (2, 100)), 0.05)
    points = Box.join([strong, weak, clutter])
    peak = HoughAccumulator.from_boxes(points, Interval(0.1, 0.5), Interval(0, 20)).peak(0.85)
    assert peak.alpha.contains(0.3)
    assert peak.d.contains(8.0)
    assert peak.votes >= 200
    assert 0.4 < peak.rivalry < 0.6


def test_near_cells_above_the_threshold_widen_the_hull_and_are_no_rivals():
    rng = np.random.default_rng(11)
    points = Box.join([boxes_on_line(rng, 0.0, d, 200, 0.01) for d in (5.05, 5.55)])
    accumulator = HoughAccumulator.from_boxes(points, Interval(-0.2, 0.2), Interval(0, 10))
    both = accumulator.peak(0.8, apart=0.8)
    assert both.d.contains([5.05, 5.55]).all()
    assert both.rivalry < 0.5
    assert accumulator.peak(0.8, apart=0.1).rivalry > 0.9


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"alpha": Interval.entire()}, "bounded"),
        ({"d_step": 0.0}, "positive"),
        ({"points": Box.around(np.zeros((3, 2)), 1.0)}, "boxes"),
        ({"points": Box.around(np.full((2, 1), 1e9), 1.0)}, "origin"),
    ],
)
def test_bad_input_gets_one_line(change, word):
    given_input = {"points": Box.around(np.zeros((2, 1)), 1.0), "alpha": Interval(0, 1), "d": Interval(0, 1)}
    with pytest.raises(GeometryError, match=word):
        HoughAccumulator.from_boxes(**{**given_input, **change})


def test_no_points_give_no_votes():
    accumulator = HoughAccumulator.from_boxes(Box.around(np.zeros((2, 0)), 1.0), Interval(0, 1), Interval(0, 1))
    peak = accumulator.peak()
    assert peak.votes == 0
    assert peak.rivalry == 1.0
