"""Visibility: against rays on the map as drawn; and nothing that is truly seen is left out, whatever the errors."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
import shapely.affinity

from factorloc.errors import MapError
from factorloc.intervals import Box
from factorloc.mapping.building_outlines import BuildingOutlines, Outline
from factorloc.mapping.facade_map import FacadeMap, MapUncertainty
from factorloc.mapping.facade_visibility import SightLines, certain_cores, outline_edges, shares_seen
from factorloc.mapping.facades import Facades

FLAT = SightLines(height=2.0, elevation=0.0)


def town(seed: int) -> list[shapely.Polygon]:
    """Some turned houses on a grid, every other one with a wing."""
    rng = np.random.default_rng(seed)
    houses = []
    for k, (x, y) in enumerate(np.ndindex(5, 5)):
        w, d = rng.uniform(8, 16, 2)
        a, b = w / 2, d / 2
        wing = [(a + 5, b), (a + 5, b - 4), (a, b - 4)] if k % 2 else [(a, b)]
        house = shapely.Polygon([(a, -b), (-a, -b), (-a, b), *wing])
        turned = shapely.affinity.rotate(house, rng.uniform(0, 90), origin=(0, 0))
        houses.append(shapely.affinity.translate(turned, 26.0 * x, 26.0 * y))
    return houses


def map_of(houses: list[shapely.Polygon], shift: float, vertex: float) -> FacadeMap:
    outlines = tuple(Outline(house, 9.0) for house in houses)
    return FacadeMap.from_outlines(BuildingOutlines(outlines), MapUncertainty(shift, vertex), least_length=0.0)


def naive_shares(position: np.ndarray, found: FacadeMap, samples: int = 200) -> np.ndarray:
    blocks = shapely.union_all(found.outlines)
    shapely.prepare(blocks)
    shares = []
    for start, end in found.facades.segments:
        along = (end - start) / np.hypot(*(end - start))
        u = (np.arange(samples) + 0.5) / samples
        targets = start + u[:, None] * (end - start) + 1e-6 * np.array([along[1], -along[0]])
        ways = shapely.linestrings(np.stack([np.broadcast_to(position, targets.shape), targets], 1))
        shares.append(np.mean(~shapely.intersects(blocks, ways)))
    return np.array(shares)


def test_shares_are_those_of_many_rays() -> None:
    found = map_of(town(1), 0.0, 0.0)
    for position in ([13.0, 13.0], [39.0, -10.0], [63.0, 66.0]):
        assert found.seen_from(position) == pytest.approx(naive_shares(np.array(position), found), abs=0.011)


def test_a_screen_hides_what_is_behind_it() -> None:
    houses = [shapely.box(-10, 10, 10, 20), shapely.box(-2, 4, 2, 6)]
    found = map_of(houses, 0.0, 0.0)
    shares = found.seen_from((0, 0))
    front = [k for k, s in enumerate(found.facades.segments) if (s[:, 1] == 10).all()]
    # From 4 m, a screen of 4 m hides 10 m of a wall 10 m away.
    assert shares[front] == pytest.approx([0.5])
    assert (shares[found.facades.segments[:, :, 1].min(1) >= 20] == 0).all()


def true_town(houses: list[shapely.Polygon], shift: float, vertex: float, rng: np.random.Generator, extreme: bool):
    def drawn(shape):
        draws = rng.uniform(-1, 1, shape)
        return np.sign(draws) if extreme else draws

    truth = []
    for house in houses:
        ring = shapely.get_coordinates(shapely.orient_polygons(house).exterior)[:-1]
        truth.append(ring + shift * drawn(2) + vertex * drawn(ring.shape))
    return truth


@pytest.mark.parametrize(("shift", "vertex", "least_left_out"), [(0.2, 0.05, 0.75), (2.0, 0.1, 0.6)])
def test_nothing_that_is_seen_in_truth_is_left_out(shift: float, vertex: float, least_left_out: float) -> None:
    houses = town(2)
    found = map_of(houses, shift, vertex)
    rng = np.random.default_rng(3)
    lost = checked = 0
    left_out = []
    for trial in range(80):
        center = rng.uniform(0, 104, 2)
        region = Box.around(center, [2.5, 2.5])
        rows = found.may_be_seen(region, 60.0, FLAT)
        left_out.append(1 - len(rows) / len(found))
        rings = true_town(houses, shift, vertex, rng, bool(trial % 2))
        polygons = [shapely.Polygon(ring) for ring in rings]
        edges = outline_edges(polygons)
        walls = np.concatenate([np.stack([ring, np.roll(ring, -1, 0)], 1) for ring in rings])
        truth = Facades(walls, np.zeros(len(walls)), np.zeros(len(walls)), np.zeros(len(walls)))
        # The same walls in the same order: none is shared, none too short.
        assert len(truth) == len(found)
        for position in rng.uniform(region.lo, region.hi, (10, 2)):
            eye = shapely.Point(position)
            if any(polygon.contains(eye) for polygon in polygons):
                continue
            near = shapely.distance(shapely.linestrings(walls), eye) <= 60.0
            seen = np.flatnonzero((shares_seen(position, truth, edges) > 1e-9) & near)
            lost += int((~np.isin(seen, rows)).sum())
            checked += len(seen)
    assert lost == 0
    assert checked > 4000
    assert np.mean(left_out) > least_left_out


def test_cores_are_inside_whatever_the_errors() -> None:
    houses, rng = town(5), np.random.default_rng(6)
    cores = certain_cores(houses, np.full(len(houses), 1.2))
    assert len(set(cores.owners.tolist())) == len(houses)
    polygons = [cores.polygon(k) for k in range(len(cores))]
    assert all(polygon.equals(polygon.convex_hull) for polygon in polygons)
    for _ in range(50):
        rings = true_town(houses, 1.0, 0.2, rng, True)
        for core, owner in zip(polygons, cores.owners, strict=True):
            assert shapely.Polygon(rings[owner]).buffer(1e-9).contains(core)
    assert len(certain_cores([shapely.box(0, 0, 2, 2)], np.array([1.2]))) == 0  # nothing of a shed is certain
    # All of the inside is covered but the rim and what of wings is too narrow.
    covered = sum(polygon.area for polygon in polygons)
    inside = sum(house.buffer(-1.201).area for house in houses)
    assert covered > 0.8 * inside


def test_low_buildings_hide_little_from_beams_that_rise() -> None:
    houses = [shapely.box(-10, 30, 10, 40), shapely.box(-30, 5, 30, 15)]
    found = map_of(houses, 0.2, 0.05)
    region = Box.around([0.0, 0.0], [1.0, 1.0])
    behind = next(k for k, s in enumerate(found.facades.segments) if (s[:, 1] == 30).all())
    assert behind not in found.may_be_seen(region, sight=FLAT)
    steep = SightLines(height=2.0, elevation=math.radians(15.0))  # looks over 9 m beyond 26 m
    assert behind in found.may_be_seen(region, sight=steep)


def test_a_region_has_to_be_one_box() -> None:
    with pytest.raises(MapError, match="bounded box"):
        map_of(town(1), 0.0, 0.0).may_be_seen(Box.around(np.zeros((2, 3)), np.ones((2, 1))))
