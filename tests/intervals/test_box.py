import math

import numpy as np
import pytest

from factorloc.errors import GeometryError
from factorloc.intervals import Box, Interval


def make(lo, hi) -> Box:
    return Box(Interval(np.array(lo, float), np.array(hi, float)))


def test_axes_come_first() -> None:
    box = Box.of(Interval([0.0, 1.0], [1.0, 3.0]), 2.0)
    assert (box.axes, box.batch) == (2, (2,))
    assert box.contains([[0.5, 3.0], [2.0, 2.0]]).tolist() == [True, True]
    assert box.contains([[0.5, 3.1], [2.0, 2.0]]).tolist() == [True, False]
    assert box[0].hi.tolist() == [1.0, 3.0]
    assert box.widest.tolist() == [0, 0]


def test_a_box_is_empty_as_a_whole() -> None:
    cut = make([[0, 0], [0, 0]], [[1, 1], [1, 1]]) & make([[2, 0], [0, 0]], [[3, 1], [1, 1]])
    assert cut.is_empty.tolist() == [True, False]
    assert np.isnan(cut.lo[:, 0]).all()
    assert cut.volume.hi[0] == 0


def test_halves_of_the_longest_side() -> None:
    left, right = make([[0], [0]], [[4], [1]]).bisect()
    assert (left.hi[0, 0], right.lo[0, 0], left.hi[1, 0]) == (2.0, 2.0, 1.0)
    below, above = make([0, 0], [4, 1]).bisect(1)
    assert below.hi.tolist() == [4.0, 0.5]
    assert above.lo.tolist() == [0.0, 0.5]


def test_volume_is_enclosed() -> None:
    assert make([0, 0], [0.1, 0.3]).volume.contains(0.03)
    assert make([0, 0], [1, 0]).volume.hi < 1e-300
    assert make([0, 0], [1, math.inf]).volume.hi == math.inf


def test_hull_intersection_and_subsets() -> None:
    a, b = make([0, 0], [2, 2]), make([1, 1], [3, 4])
    assert (a | b).hi.tolist() == [3.0, 4.0]
    assert (a & b).lo.tolist() == [1.0, 1.0]
    assert (a & b).is_subset(a)
    assert not a.is_subset(b)
    assert a.inflate(1.0).contains([-1.0, 3.0])


def test_difference_covers_without_overlap() -> None:
    rng = np.random.default_rng(0)
    ends = np.sort(rng.integers(0, 6, (4, 2, 120)), axis=0).astype(float)
    outer, inner = make(ends[0], ends[3]), make(ends[1], ends[2])
    inner = inner.choose(rng.random(120) < 0.8, Box(Interval.empty((2, 120))))
    points = rng.uniform(0, 6, (2, 50))
    for n in range(120):
        pieces = outer.select(np.array([n])).difference(inner.select(np.array([n])))
        for point in points.T:
            wanted = bool(outer.select(np.array([n])).contains(point[:, None])[0]) and not bool(
                inner.select(np.array([n])).contains(point[:, None])[0]
            )
            assert int(pieces.contains(point[:, None]).sum()) == int(wanted)


def test_sides_are_taken_and_put_back() -> None:
    box = make([0, 1, 2], [1, 2, 3])
    put = box.put((2, 0), make([2.5, 0.5], [2.6, 0.6]))
    assert put.lo.tolist() == [0.5, 1.0, 2.5]
    assert box.lo.tolist() == [0.0, 1.0, 2.0]
    assert box.take((2,)).axes == 1
    assert Box.around([1.0, 2.0], 0.5).contains([1.5, 1.5])


def test_a_box_has_sides() -> None:
    with pytest.raises(GeometryError, match="at least one"):
        Box(Interval(1.0))
