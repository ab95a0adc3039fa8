"""Pole maps: what is kept and refused, rates, duplicates, frames and places on Earth."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from factorloc.errors import MapError
from factorloc.geometry import se2
from factorloc.mapping.georeference import WGS84, Georeference, convert
from factorloc.mapping.pole_map import PoleMap
from factorloc.mapping.poles import Poles

KARLSRUHE = Georeference("EPSG:32632", [456_789.123, 5_432_100.987, 0.3])


def row_of(count: int) -> Poles:
    x = np.arange(count, dtype=float)
    return Poles(np.stack([10 * x, 0.1 * x], 1), 0.1 + 0.01 * x, np.stack([0 * x, 2 + x], 1), 1 / (1 + x))


def three() -> PoleMap:
    return PoleMap(row_of(3), [[3, 0], [1, 2], [0, 0]], [[4, 0], [2, 4], [0, 0]], ("spring", "autumn"))


def test_detection_rates_pool_the_sessions() -> None:
    assert np.allclose(three().detection_rates, [0.75, 0.5, math.nan], equal_nan=True)


def test_selection_keeps_counts_with_their_poles() -> None:
    part = three().select([1])
    assert len(three().select([])) == 0
    assert part.poles.widths.tolist() == [0.11]
    assert part.seen.tolist() == [[1, 2]]
    assert part.sessions == ("spring", "autumn")


@pytest.mark.parametrize(
    ("seen", "in_view", "sessions", "word"),
    [
        ([[1], [1]], [[1], [1]], ("a",), "shape"),
        ([[2]] * 3, [[1]] * 3, ("a",), "more often"),
        ([[-1]] * 3, [[1]] * 3, ("a",), "negative"),
        ([[1, 1]] * 3, [[1, 1]] * 3, ("a", "a"), "told apart"),
        (np.zeros((3, 0)), np.zeros((3, 0)), (), "no session"),
    ],
)
def test_counts_that_make_no_sense_are_refused(seen: object, in_view: object, sessions: object, word: str) -> None:
    with pytest.raises(MapError, match=word):
        PoleMap(row_of(3), seen, in_view, sessions)  # type: ignore[arg-type]


def test_the_part_near_a_drive_and_none_near() -> None:
    pole_map = PoleMap.of(row_of(10))
    assert pole_map.near([[0, 0], [50, 0]], 12.0).positions[:, 0].tolist() == [0, 10, 40, 50, 60]
    with pytest.raises(MapError, match=r"1000 m from the drive.*another place"):
        pole_map.near([[1090.0, 0.9]], 100.0)
    with pytest.raises(MapError, match="holds no poles"):
        PoleMap.of(Poles.none()).near([[0, 0]], 10.0)
    with pytest.raises(MapError, match="no finite positions"):
        pole_map.near(np.empty((0, 2)), 10.0)


def test_of_duplicates_the_one_seen_most_stays() -> None:
    poles = Poles([[0, 0], [0.005, 0], [0.012, 0], [5, 0]], [0.1] * 4, [[0, 2]] * 4, [0.9, 0.8, 0.7, 0.6])
    pole_map = PoleMap(poles, [[1], [2], [1], [1]], [[3]] * 4, ("a",))
    left, count = pole_map.without_duplicates(0.01)
    assert count == 2  # each of the outer two stands too near to the middle one
    assert left.positions[:, 0].tolist() == [0.005, 5]
    assert PoleMap.of(Poles.none()).without_duplicates(1.0)[1] == 0


@settings(max_examples=10)
@given(st.tuples(*[st.floats(-50, 50)] * 2, st.floats(-3, 3)))
def test_moving_a_map_leaves_its_poles_where_they_stand_on_earth(pose: tuple[float, float, float]) -> None:
    pole_map = PoleMap.of(row_of(4), georeference=KARLSRUHE)
    moved = pole_map.transformed(pose, "other")
    assert moved.georeference is not None
    before = KARLSRUHE.to_lonlat(pole_map.positions)
    assert np.abs(moved.georeference.to_lonlat(moved.positions) - before).max() < 1e-11
    assert np.allclose(moved.positions, se2.transform(pose, pole_map.positions))


def test_a_map_referred_to_another_system_and_back_is_the_same() -> None:
    pole_map = PoleMap.of(row_of(5), georeference=KARLSRUHE)
    local = Georeference.at(49.04, 8.41, yaw=1.0)
    there = pole_map.referred_to(local)
    # UTM shortens lengths by up to 0.4 per mille, and turns: a plain shift would be wrong.
    length = np.linalg.norm(np.diff(there.positions, axis=0), axis=1)
    assert np.allclose(length / np.linalg.norm(np.diff(pole_map.positions, axis=0), axis=1), 1 / 0.99962, atol=2e-5)
    assert np.abs(there.referred_to(KARLSRUHE).positions - pole_map.positions).max() < 1e-7
    with pytest.raises(MapError, match="no coordinate system"):
        PoleMap.of(row_of(1)).referred_to(local)


def test_the_local_projection_has_true_lengths_and_its_north() -> None:
    place = Georeference.at(49.0, 8.4, yaw=math.pi / 2)
    longitude, latitude = place.to_lonlat([[100.0, 0.0]])[0]
    assert longitude == pytest.approx(8.4, abs=1e-9)
    # A degree of the meridian at 49 degrees is 111.207 km on WGS 84 (radius of curvature 6 371 735 m).
    assert (latitude - 49.0) * 111_207 == pytest.approx(100.0, abs=0.01)
    assert np.allclose(place.from_lonlat([[longitude, latitude]]), [[100.0, 0.0]], atol=1e-7)


@pytest.mark.parametrize(
    ("crs", "word"), [("EPSG:4326", "no projected system in m"), ("EPSG:2263", "in m"), ("EPSG:nowhere", "unknown")]
)
def test_a_georeference_wants_a_metric_system(crs: str, word: str) -> None:
    with pytest.raises(MapError, match=word):
        Georeference(crs, [0.0, 0.0, 0.0])


def test_coordinates_outside_a_system_are_refused() -> None:
    with pytest.raises(MapError, match="cannot be converted"):
        convert([[1e12, 1e12]], "EPSG:32632", WGS84)
    with pytest.raises(MapError, match="expected degrees"):
        Georeference.at(91.0, 0.0)
