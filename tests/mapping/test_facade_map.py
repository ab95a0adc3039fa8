"""Facade maps: which walls stand free, what is left out, and what is in reach."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from factorloc.errors import MapError
from factorloc.mapping.building_outlines import BuildingOutlines, Outline
from factorloc.mapping.facade_map import FacadeMap, MapUncertainty
from factorloc.mapping.local_frame import LocalFrame
from factorloc.mapping.outer_walls import exposed_parts, straight_walls


def house(x0, y0, x1, y1, **facts) -> Outline:
    return Outline(shapely.box(x0, y0, x1, y1), **facts)


def row() -> BuildingOutlines:
    """Three houses in a row, the last one 0.2 m off and 2 m behind, one inside another, and one apart."""
    houses = house(0, 0, 10, 8), house(10, 0, 20, 8), house(20.2, 2, 30, 8), house(2, 2, 4, 4), house(40, 0, 50, 10)
    return BuildingOutlines(houses, attribution="somebody", source="row")


def walls_of(found: FacadeMap, building: int) -> set[tuple[float, ...]]:
    return {tuple(np.ravel(s).tolist()) for s in found.facades.segments[found.facades.buildings == building]}


def test_walls_between_buildings_are_removed() -> None:
    found = FacadeMap.from_outlines(row())
    assert walls_of(found, 0) == {(0, 0, 10, 0), (10, 8, 0, 8), (0, 8, 0, 0)}
    # Of the wall towards the house behind, the part that stands free is left, though there is a gap between them.
    assert walls_of(found, 1) == {(10, 0, 20, 0), (20, 8, 10, 8), (20, 0, 20, 2)}
    assert len(walls_of(found, 3)) == 4
    assert found.left_out == {"inside another building": 1, "walls between buildings": 3}
    assert found.attribution == "somebody"
    assert found.provenance == {"source": "row"}
    assert found.extent == (0, 50, 0, 10)


def test_the_building_is_on_the_left() -> None:
    court = Outline(shapely.Polygon([(0, 0), (0, 20), (20, 20), (20, 0)], [[(5, 5), (15, 5), (15, 15), (5, 15)]]))
    found = FacadeMap.from_outlines(BuildingOutlines((court,)))
    assert len(found) == 8
    for start, end in found.facades.segments:
        along = (end - start) / np.hypot(*(end - start))
        left = (start + end) / 2 + 0.1 * np.array([-along[1], along[0]])
        assert court.polygon.contains(shapely.Point(left))


def test_corners_on_straight_walls_are_put_into_the_error() -> None:
    ring = [(0, 0), (4, -0.03), (10, 0), (10, 5), (0, 5)]
    found = FacadeMap.from_outlines(BuildingOutlines((Outline(shapely.Polygon(ring)),)), MapUncertainty(1.0, 0.1))
    front = found.facades.segments[:, :, 1].max(1) == 0
    assert found.facades.segments[front].tolist() == [[[0, 0], [10, 0]]]
    assert found.facades.vertex_errors[front] == pytest.approx([0.13])
    assert found.facades.vertex_errors[~front].tolist() == [0.1, 0.1, 0.1]
    kept = FacadeMap.from_outlines(BuildingOutlines((Outline(shapely.Polygon(ring)),)), tolerance=0.01)
    assert len(kept) == 5


def test_a_round_tower_is_not_eaten_up() -> None:
    circle = shapely.Point(0, 0).buffer(10, quad_segs=64)
    walls, off = straight_walls(circle, 0.05)
    assert 8 < len(walls) < 256
    assert off.max() <= 0.05
    lines = shapely.union_all(shapely.linestrings(walls))
    assert shapely.hausdorff_distance(lines, circle.exterior, densify=0.1) <= 0.051


def test_every_corner_is_near_the_wall_that_replaces_it() -> None:
    rng = np.random.default_rng(4)
    for _ in range(20):
        angles = np.sort(rng.uniform(0, 2 * np.pi, 40))
        ring = (10 + rng.normal(0, 0.1, 40))[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
        walls, off = straight_walls(shapely.Polygon(ring), 0.3)
        lines = shapely.linestrings(walls)
        distances = shapely.distance(shapely.points(ring)[:, None], lines[None]).min(1)
        assert distances.max() <= off.max() + 1e-12 <= 0.3 + 1e-12


def test_narrow_slits_and_overlaps_are_no_facades() -> None:
    slit = shapely.Polygon([(0, 0), (10, 0), (10, 5), (5.1, 5), (5.1, 1), (4.9, 1), (4.9, 5), (0, 5)])
    walls, _ = straight_walls(slit, 0.0)
    free = [len(parts) for parts in exposed_parts(walls, [slit], 0.4)]
    assert sum(n == 0 for n in free) == 2  # both sides of the slit; its end is short
    overlapping = BuildingOutlines((house(0, 0, 10, 8), house(9, 0, 20, 8)))
    found = FacadeMap.from_outlines(overlapping)
    assert {s for s in walls_of(found, 0) if s[0] == s[2]} == {(0, 8, 0, 0)}


def test_the_accuracy_of_the_transformation_adds_to_the_shift() -> None:
    frame = LocalFrame(8.4, 49.0, accuracy=1.5)
    found = FacadeMap.from_outlines(BuildingOutlines((house(0, 0, 10, 8),), frame), MapUncertainty(0.25, 0.05))
    assert set(found.facades.shifts.tolist()) == {1.75}
    assert set(found.facades.vertex_errors.tolist()) == {0.05}


def test_what_is_drawn_twice_counts_once_and_parts_lend_their_height() -> None:
    twice = BuildingOutlines(
        (
            house(0, 0, 10, 8),
            house(0, 0, 10, 8, height=9.0),
            house(1, 1, 5, 7, height=12.0, is_part=True),
            house(30, 0, 40, 8, height=5.0, is_part=True),
        )
    )
    whole = twice.whole()
    assert [outline.height for outline in whole.outlines] == [12.0, 5.0]
    assert whole.left_out == {"drawn twice": 1, "inside another building": 1}
    assert math.isnan(FacadeMap.from_outlines(row()).heights[0])


def test_what_may_be_in_reach_is_found() -> None:
    found = FacadeMap.from_outlines(row(), MapUncertainty(0.5, 0.1))
    slack = math.sqrt(2) * 0.6
    last = np.flatnonzero(found.facades.buildings == 3)
    top = last[found.facades.segments[last, :, 1].min(1) == 10]
    assert top[0] in found.within((45, 20), 10.0 - slack + 1e-9)
    assert top[0] not in found.within((45, 20), 10.0 - slack - 1e-3)
    assert found.within((25, 5), 1000.0).tolist() == list(range(len(found)))
    rng = np.random.default_rng(0)
    lines = shapely.linestrings(found.facades.segments)
    for center in rng.uniform(-30, 80, (20, 2)):
        near = shapely.distance(lines, shapely.Point(center)) <= 15 + slack
        assert found.within(center, 15.0).tolist() == np.flatnonzero(near).tolist()


def test_the_origin_moves() -> None:
    found = FacadeMap.from_outlines(row())
    moved = found.moved((3, -2))
    assert moved.extent == (-3, 47, 2, 12)
    assert np.allclose(moved.bounds().d.mid, found.bounds((3, -2)).d.mid)
    assert moved.bounds().first.lo == pytest.approx(found.bounds((3, -2)).first.lo)


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: FacadeMap.from_outlines(BuildingOutlines((), source="empty.osm")), "empty.osm: holds no building"),
        (lambda: FacadeMap.from_outlines(row(), gap=-1.0), "gap"),
        (lambda: MapUncertainty(shift=math.inf), "shift"),
        (lambda: FacadeMap(FacadeMap.from_outlines(row()).facades, (), []), "not there"),
        (lambda: FacadeMap(FacadeMap.from_outlines(row()).facades, (shapely.box(0, 0, 1, 1),), []), "heights"),
        (lambda: FacadeMap.from_outlines(row()).moved((math.nan, 0)), "origin"),
        (lambda: Outline(shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)])), "valid"),
        (lambda: house(0, 0, 1, 1, height=-2), "height"),
        (lambda: LocalFrame(49.0, 98.0), "longitude first"),
        (lambda: LocalFrame(8.0, 49.0, accuracy=-1), "accuracy"),
    ],
)
def test_what_makes_no_sense_is_refused(make, word: str) -> None:
    with pytest.raises(MapError, match=word):
        make()


def test_local_frames_are_true_to_scale() -> None:
    pyproj = pytest.importorskip("pyproj")
    frame = LocalFrame(8.42, 49.01)
    here = frame.to_geographic([[0, 0], [100, 0], [0, 100]])
    assert here[0] == pytest.approx([8.42, 49.01], abs=1e-12)
    geod = pyproj.Geod(ellps="WGS84")
    for point in here[1:]:
        assert geod.inv(*here[0], *point)[2] == pytest.approx(100.0, abs=1e-5)
    assert frame.from_geographic(here) == pytest.approx(np.array([[0, 0], [100, 0], [0, 100]]), abs=1e-6)
