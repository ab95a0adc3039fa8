import math

import numpy as np
import pytest
import shapely

from factorloc.errors import GeometryError
from factorloc.intervals import Box, Interval, annulus, disk, half_plane, pave, polygon, relaxed_separator

ARENA = Box.of(Interval(-3.0, 3.0), Interval(-3.0, 3.0))
RNG = np.random.default_rng(0)
POINTS = RNG.uniform(-3, 3, (2, 20_000))
L_SHAPE = shapely.Polygon([(-2, -2), (2, -2), (2, 0), (0, 0), (0, 2), (-2, 2)])
HOLED = shapely.Point(0, 0).buffer(2.5, 6).difference(shapely.box(-1, -0.5, 1.2, 0.7))
RADIUS = np.hypot(*POINTS)

REGIONS = {
    "half-plane": (half_plane(1.0, 2.0, 0.5), POINTS[0] + 2 * POINTS[1] <= 0.5, None),
    "disk": (disk((0.0, 0.0), 2.0), RADIUS <= 2, 4 * math.pi),
    "annulus": (annulus((0.0, 0.0), 1.0, 2.0), (RADIUS <= 2) & (RADIUS >= 1), 3 * math.pi),
    "complement": (~disk((0.0, 0.0), 2.0), RADIUS > 2, 36 - 4 * math.pi),
    "intersection": (disk((0.0, 0.0), 2.0) & half_plane(1.0, 0.0, 0.0), (RADIUS <= 2) & (POINTS[0] <= 0), 2 * math.pi),
    "union": (disk((0.0, 0.0), 2.0) | half_plane(1.0, 0.0, 0.0), (RADIUS <= 2) | (POINTS[0] <= 0), 18 + 2 * math.pi),
    "L": (polygon(L_SHAPE), shapely.contains_xy(L_SHAPE, *POINTS), 12.0),
    "holed": (polygon(HOLED), shapely.contains_xy(HOLED, *POINTS), HOLED.area),
    "two of three": (
        relaxed_separator([half_plane(1.0, 0.0, 0.0), half_plane(0.0, 1.0, 0.0), disk((0.0, 0.0), 2.0)], 1),
        (POINTS[0] <= 0).astype(int) + (POINTS[1] <= 0) + (RADIUS <= 2) >= 2,
        9 + 2 * math.pi,
    ),
}  # fmt: skip


def covered(boxes: Box) -> np.ndarray:
    """Points strictly inside of one of the boxes."""
    found = np.zeros(POINTS.shape[1], bool)
    for lo, hi in zip(boxes.lo.T, boxes.hi.T, strict=True):
        found |= ((lo[:, None] < POINTS) & (hi[:, None] > POINTS)).all(0)
    return found


@pytest.mark.parametrize("name", REGIONS)
def test_pavings_enclose_their_sets(name) -> None:
    separator, inside, area = REGIONS[name]
    paving = pave(separator, ARENA, 0.1)
    assert paving.complete
    inner, outer, boundary = (covered(boxes) for boxes in (paving.inner, paving.outer, paving.boundary))
    assert not (inner & ~inside).any()
    assert not (outer & inside).any()
    assert (inner.astype(int) + outer + boundary <= 1).all()
    assert (inner | outer | boundary).mean() > 0.999  # a random point on a face is in none
    total = sum(math.fsum(boxes.volume.mid) for boxes in (paving.inner, paving.outer, paving.boundary))
    assert total == pytest.approx(36.0)
    assert (paving.boundary.width < 0.1).all()
    if area is not None:
        assert paving.area.contains(area)
        assert paving.area.width < 0.2 * area


def test_finer_pavings_enclose_more_closely() -> None:
    separator = annulus((0.5, 0.0), 1.0, 2.0)
    widths = [float(pave(separator, ARENA, epsilon).area.width) for epsilon in (0.4, 0.1, 0.025)]
    assert widths[0] > 2 * widths[1] > 4 * widths[2]


def test_the_budget_is_kept_and_nothing_dropped() -> None:
    paving = pave(disk((0.0, 0.0), 2.0), ARENA, 1e-6, most_boxes=2000)
    assert not paving.complete
    assert paving.inner.batch[0] + paving.outer.batch[0] + paving.boundary.batch[0] < 6000
    assert paving.area.contains(4 * math.pi)


def test_sets_that_are_missed_or_fill_the_box() -> None:
    nothing = pave(disk((10.0, 0.0), 1.0), ARENA, 0.1)
    assert nothing.hull.is_empty
    assert nothing.area.hi < 1e-300
    everything = pave(disk((0.0, 0.0), 10.0), ARENA, 0.1)
    assert everything.boundary.batch == (0,)
    assert everything.area.contains(36.0)
    assert everything.hull.lo.tolist() == [-3.0, -3.0]
    assert pave(polygon(L_SHAPE), Box.of(Interval(-1.9, -1.1), Interval(-1.9, 1.0)), 0.1).inner.batch == (1,)


def test_a_polygon_of_shared_bearing_on_the_border() -> None:
    # Sides of the box along the border of the polygon.
    paving = pave(polygon(shapely.box(0, 0, 1, 1)), Box.of(Interval(0, 2), Interval(0, 1)), 0.05)
    assert paving.area.contains(1.0)
    assert paving.area.width < 0.2


def test_what_cannot_be_paved() -> None:
    with pytest.raises(GeometryError, match="unbounded"):
        pave(disk((0.0, 0.0), 1.0), Box.of(Interval(0, math.inf), 0.0), 0.1)
    with pytest.raises(GeometryError, match="epsilon"):
        pave(disk((0.0, 0.0), 1.0), ARENA, 0.0)
    with pytest.raises(GeometryError, match="annulus"):
        annulus((0.0, 0.0), 2.0, 1.0)
    with pytest.raises(GeometryError, match="polygon"):
        polygon([(0, 0), (1, 1), (1, 0), (0, 1)])
    with pytest.raises(GeometryError, match="q:"):
        relaxed_separator([disk((0.0, 0.0), 1.0)], 1)
