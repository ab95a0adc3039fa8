"""Mapping of poles: stretches of a drive, merging, confirmation, growth over sessions, and what is counted."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pole_yard import POLES, drive, full_size

from factorloc.errors import MapError
from factorloc.geometry import se2
from factorloc.mapping.local_maps import local_maps, segments
from factorloc.mapping.pole_mapping import PoleMapper, PoleMappingSettings, confirmed, merged, overlaps
from factorloc.mapping.pole_settings import BY_EVIDENCE
from factorloc.mapping.poles import Poles
from factorloc.trajectory import Trajectory

YARD = BY_EVIDENCE.replaced(segment_length=2.3, segment_spacing=2.0)


def line(*x: float) -> Trajectory:
    return Trajectory(np.arange(len(x), dtype=float), np.array([[value, 0, 0] for value in x], float).reshape(-1, 3))


def at(*positions: tuple[float, float], width: float = 0.2, score: float = 1.0) -> Poles:
    n = len(positions)
    return Poles(
        np.array(positions, float).reshape(n, 2), np.full(n, width), np.tile([0.0, 2.0], (n, 1)), np.full(n, score)
    )


def test_stretches_are_of_equal_length_and_reach_the_end() -> None:
    rows = segments(line(*np.arange(0, 11.5, 1.0)), 5.0, 3.0)
    assert [r.tolist() for r in rows] == [[0, 1, 2, 3, 4, 5], [3, 4, 5, 6, 7, 8], [6, 7, 8, 9, 10, 11]]


@given(st.lists(st.floats(0, 3), min_size=1, max_size=40), st.floats(0.5, 6), st.floats(0.5, 6))
@settings(max_examples=60)
def test_stretches_cover_the_drive(steps: list[float], length: float, spacing: float) -> None:
    way = np.concatenate([[0.0], np.cumsum(steps)])
    rows = segments(line(*way.tolist()), length, min(spacing, length))
    assert rows[-1][-1] == len(way) - 1
    assert all(way[r[-1]] - way[r[0]] <= length + 1e-6 for r in rows)
    # Only scans between which more than a stretch lies may fall between two.
    seen = np.unique(np.concatenate(rows))
    assert len(seen) == len(way) or max(steps) > 1e-9


def test_a_vehicle_at_rest_and_no_scans_at_all() -> None:
    assert [len(r) for r in segments(line(*np.zeros(500)), 5.0, 3.0)] == [64]
    assert segments(line(), 5.0, 3.0) == []


def test_overlaps_are_those_of_squares() -> None:
    rng = np.random.default_rng(0)
    one, other = (
        Poles(rng.uniform(0, 3, (n, 2)), rng.uniform(0.1, 0.8, n), np.zeros((n, 2)), np.ones(n)) for n in (30, 25)
    )
    found = {(int(i), int(j)) for i, j in overlaps(one, other, 0.1)}
    expected = {
        (i, j)
        for i in range(30)
        for j in range(25)
        if (np.abs(one.positions[i] - other.positions[j]) < (one.widths[i] + other.widths[j]) / 2 + 0.1).all()
    }
    assert found == expected
    assert len(overlaps(one, Poles.none())) == 0


def test_poles_that_overlap_become_their_weighted_mean() -> None:
    poles = Poles([[0, 0], [0.3, 0], [9, 9]], [0.4, 0.4, 0.2], [[0, 2], [0.5, 3], [0, 1]], [1.0, 3.0, 0.5])
    one = merged(poles)
    assert np.allclose(one.positions, [[0.225, 0], [9, 9]])
    assert np.allclose(one.spans, [[0, 3], [0, 1]])
    assert np.allclose(one.scores, [2.5, 0.5])  # weighted with themselves
    assert len(merged(poles.select([0, 1]), 0.0)) == 1
    assert len(merged(Poles.none())) == 0


def test_what_is_seen_too_rarely_is_left_out() -> None:
    found = [at((0, 0), (5, 5)), at((0.05, 0)), at((0, 0.05), (9, 9)), at((9, 9.1), (5, 5))]
    kept = confirmed(found, 2, 3)
    assert [poles.positions.tolist() for poles in kept] == [[], [[0.05, 0]], [[0, 0.05]], [[9, 9.1]]]
    assert [len(poles) for poles in confirmed(found, 1, 1)] == [2, 1, 2, 2]
    with pytest.raises(MapError, match="confirmations 4 of 3"):
        confirmed(found, 4, 3)


@full_size
@pytest.mark.parametrize("axes", ["reference", "world"])
def test_local_maps_are_in_the_frame_of_their_newest_pose(axes: str) -> None:
    scans, poses = drive()
    T = np.array([30.0, 20.0, 2.0])  # odometry begins anywhere
    odometry = Trajectory(np.arange(5.0), se2.compose(T, poses))
    found = list(local_maps(scans, odometry, YARD, axes=axes))  # type: ignore[arg-type]
    assert [each.scans.tolist() for each in found] == [[0, 1, 2], [2, 3, 4]]
    for each in found:
        assert each.stamp == each.scans[-1]
        here = each.poles.transformed(poses[each.scans[-1]])
        distances = np.linalg.norm(here.positions[:, None] - POLES[:, :2], axis=-1)
        assert len(here) >= 3
        assert distances.min(1).max() < 0.05
        assert each.covers(each.in_world.positions).all()
        assert not each.covers([[100.0, 0.0]]).any()


@full_size
def test_a_map_of_two_sessions_counts_and_grows_only_on_new_ground() -> None:
    scans, poses = drive()
    path = Trajectory(np.arange(5.0), poses)
    mapper = PoleMapper(PoleMappingSettings(poles=YARD, slack=0.1))
    done: list[int] = []
    mapper.add("first", scans, path, done.append)
    assert done == [1, 2]
    assert mapper.count(path) == 2
    mapper.add("again", scans[:4], path.select(slice(4)))
    far = Trajectory(np.arange(5.0), se2.compose([200.0, 0.0, 0.0], poses))
    mapper.add("elsewhere", scans, far)
    assert mapper.map_fractions == {"first": 1.0, "again": 0.0, "elsewhere": 1.0}
    found = mapper.finish("yard", {"recording": "yard"})
    truth = np.concatenate([POLES[:, :2], POLES[:, :2] + [200.0, 0.0]])
    distances = np.linalg.norm(found.positions[:, None] - truth, axis=-1)
    assert len(found) == 8
    assert distances.min(0).max() < 0.05
    near = found.positions[:, 0] < 100
    assert (found.in_view[near, 0] == 2).all()
    assert (found.in_view[near, 2] == 0).all()
    assert (found.seen[near, :2].sum(1) >= 2).all()
    assert found.frame == "yard"
    assert found.sessions == ("first", "again", "elsewhere")


@full_size
def test_nothing_to_map_is_said_in_one_line() -> None:
    scans, poses = drive(count=2)
    path = Trajectory(np.arange(2.0), poses)
    mapper = PoleMapper(PoleMappingSettings(poles=YARD))
    with pytest.raises(MapError, match="no session"):
        mapper.finish()
    with pytest.raises(MapError, match="holds no scans"):
        mapper.add("empty", [], path.select(slice(0)))
    with pytest.raises(MapError, match="2 scans, but 1 poses"):
        mapper.add("short", scans, path.select(slice(1)))
    mapper.add("ground", [scan.select(scan.directions[:, 2] < -0.35) for scan in scans], path)
    with pytest.raises(MapError, match="of 0 detections in 2 local maps, none became a pole"):
        mapper.finish()
