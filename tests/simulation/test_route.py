import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st

from factorloc.errors import SimulationError
from factorloc.geometry import wrap
from factorloc.simulation import FloorPlan, Route


@st.composite
def routes(draw):
    """Legs of 2 to 5 m that turn by up to 100 degrees."""
    count = draw(st.integers(1, 8))
    headings = np.cumsum([draw(st.floats(-1.75, 1.75)) for _ in range(count)])
    lengths = np.array([draw(st.floats(2, 5)) for _ in range(count)])
    legs = lengths[:, None] * np.stack([np.cos(headings), np.sin(headings)], -1)
    points = np.concatenate([np.zeros((1, 2)), np.cumsum(legs, axis=0)])
    return Route(tuple((float(x), float(y)) for x, y in points), radius=draw(st.floats(0.1, 0.8)))


def test_a_rounded_corner_has_the_length_of_its_pieces():
    route = Route(((0, 0), (4, 0), (4, 3)), radius=1.0, speed=0.5)
    assert route.length == pytest.approx(3 + np.pi / 2 + 2)
    assert route.duration == pytest.approx(route.length / 0.5)
    half = 3 + np.pi / 4
    assert route.poses_at([0, 3, half, route.length]) == pytest.approx(
        np.array(
            [[0, 0, 0], [3, 0, 0], [3 + np.sqrt(0.5), 1 - np.sqrt(0.5), np.pi / 4], [4, 3, np.pi / 2]],
        )
    )


@given(routes())
def test_the_vehicle_drives_where_it_heads_and_never_turns_too_sharply(route):
    s = np.linspace(0, route.length, 400)
    poses = route.poses_at(s)
    step = s[1]
    moves = np.diff(poses[:, :2], axis=0)
    turns = wrap(np.diff(poses[:, 2]))
    chord_heading = poses[:-1, 2] + turns / 2
    assert np.linalg.norm(moves, axis=1) == pytest.approx(step, rel=(step / route.radius) ** 2 / 20 + 1e-9)
    assert (abs(turns) <= step / route.radius + 1e-9).all()
    off = wrap(np.arctan2(moves[:, 1], moves[:, 0]) - chord_heading)
    assert (abs(off) <= step / route.radius / 2 + 1e-9).all()


@given(routes())
def test_it_leads_from_the_first_waypoint_to_the_last_inside_the_corners(route):
    ends = route.poses_at([0, route.length])[:, :2]
    assert ends == pytest.approx(np.array([route.waypoints[0], route.waypoints[-1]]), abs=1e-9)
    path = shapely.LineString(route.poses_at(np.linspace(0, route.length, 500))[:, :2])
    # An arc of radius r between legs that turn by phi misses their corner by r (1 / cos(phi / 2) - 1).
    cut = route.radius * (1 / np.cos(1.75 / 2) - 1)
    assert shapely.LineString(route.waypoints).hausdorff_distance(path) < cut + 0.02


@given(routes(), st.floats(0.1, 2))
def test_samples_are_evenly_spaced_in_time(route, period):
    assume(route.duration > period)
    trajectory = route.sample(period)
    assert np.diff(trajectory.stamps) == pytest.approx(period)
    assert route.duration - period <= trajectory.stamps[-1] + 1e-6
    assert trajectory.stamps[-1] <= route.duration + 1e-6
    assert trajectory.poses == pytest.approx(route.poses_at(np.minimum(trajectory.stamps * route.speed, route.length)))


def test_a_route_of_whole_periods_includes_its_end():
    assert len(Route(((0, 0), (0.7, 0)), speed=0.1).sample(1.0)) == 8


def test_a_body_that_touches_a_wall_is_refused_with_the_place():
    plan = FloorPlan((shapely.LineString([(-1, 1), (2, 1)]), shapely.LineString([(6, 0.2), (6, 5)])))
    route = Route(((0, 0), (8, 0)), body_radius=0.25)
    assert route.clearance(plan) == pytest.approx(-0.05)
    with pytest.raises(SimulationError, match=r"at \(5\.8\d, 0\.00\), 5\.9 m along"):
        route.check(plan)
    Route(((0, 0), (8, 0)), body_radius=0.19).check(plan)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"waypoints": ((0, 0),)}, "waypoints"),
        ({"waypoints": ((0, 0), (0, 0))}, "equals the next"),
        ({"waypoints": ((0, 0), (1, 0), (0, 0))}, "too short"),
        ({"waypoints": ((0, 0), (1, 0), (1, 1)), "radius": 1.5}, "0.50 m too short"),
        ({"waypoints": ((0, 0), (1, 0)), "speed": 0}, "speed"),
    ],
)
def test_what_cannot_be_driven_is_refused(arguments, message):
    with pytest.raises(SimulationError, match=message):
        Route(**arguments)


def test_a_period_must_be_positive():
    with pytest.raises(SimulationError, match="period"):
        Route(((0, 0), (1, 0))).sample(0)
