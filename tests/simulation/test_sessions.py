import itertools

import numpy as np
import pytest
import shapely

from factorloc.errors import SimulationError
from factorloc.simulation import furnishing
from factorloc.simulation.furnishing import BARREL_IDS
from factorloc.simulation.poles import PoleKind
from factorloc.simulation.route import Route
from factorloc.simulation.sessions import Sessions, SessionSettings
from factorloc.simulation.streams import stream
from factorloc.simulation.street_grid import StreetProfile
from factorloc.simulation.town import Town, TownSettings
from factorloc.simulation.traffic import Traffic
from factorloc.simulation.world import Surface

SMALL = TownSettings(columns=2, rows_of_blocks=1, block_depth=70)
CHANGES = SessionSettings(vanish_rate=0.1, appear_rate=0.1, parking_turnover=0.3, route_length=600, survey_length=900)


@pytest.fixture(scope="module")
def town():
    return Town(SMALL, seed=2)


@pytest.fixture(scope="module")
def sessions(town):
    return [Sessions(town, CHANGES).session(k) for k in range(5)]


def standing(session, *kinds):
    return {pole.id: pole for pole in session.poles if pole.kind in kinds}


FIXED = [kind for kind in PoleKind if kind not in (PoleKind.TRUNK, PoleKind.BARREL)]


def test_a_town_is_of_bounded_size(town, sessions):
    world = sessions[1].world
    count = sum(len(thing.mesh.faces) for thing in (*world.solids, *world.canopies))
    x0, y0, x1, y1 = town.grid.bounds
    # As dense as this, the default of 400 m x 300 m with its outskirts has less than 1.5 million.
    assert count / ((x1 - x0) * (y1 - y0)) * 460 * 360 < 1.5e6
    assert all(s.mesh.is_watertight for s in world.solids if s.surface is not Surface.GROUND)


def test_no_two_things_stand_in_one_place_and_lanes_are_free(town, sessions):
    for session in (sessions[0], sessions[2], sessions[4]):
        scene = session.scene
        footprints = np.array(scene.footprints)
        pairs = shapely.STRtree(footprints).query(footprints, predicate="intersects").T
        assert [tuple(pair) for pair in pairs.tolist() if pair[0] < pair[1]] == []
        moving = {id(car) for car in scene.vehicles if car.speed}
        still = [*scene.buildings, *scene.poles, *scene.trees, *scene.hedges, *scene.barrels, *scene.pedestrians]
        still += [car for car in scene.vehicles if id(car) not in moving]
        assert not any(town.grid.lanes.intersects(thing.footprint) for thing in still)


def test_routes_differ_are_clear_and_pass_the_barrels(sessions):
    routes = [session.route for session in sessions]
    assert len({route.waypoints for route in routes}) == len(routes)
    assert routes[0].length > 800
    for session, route in zip(sessions, routes, strict=True):
        s = np.arange(0, route.length, 0.5)
        path = route.poses_at(s)[:, :2]
        if session.number in (1, 4):
            places = np.pad(path, ((0, 0), (0, 1)), constant_values=0.8)
            assert session.world.clearance(places).min() > route.body_radius
        if session.scene.barrels:
            middle = session.scene.barrels[10]
            assert np.hypot(*(path - (middle.x, middle.y)).T).min() < 10


def test_traffic_keeps_clear_of_the_drive_and_of_itself(town, sessions):
    session = sessions[1]
    movers = [m for m in (*session.scene.vehicles, *session.scene.pedestrians) if m.speed]
    assert len(movers) > 10
    times = np.arange(0, session.route.duration, 0.1)
    tracks = [np.array([m.x, m.y]) + times[:, None] * np.array(m.velocity[:2]) for m in movers]
    driven = session.route.poses_at(times * session.route.speed)[:, :2]
    assert min(np.hypot(*(track - driven).T).min() for track in tracks) > 3
    for k, track in enumerate(tracks):
        assert all(np.hypot(*(track - other).T).min() > 1 for other in tracks[:k])


def test_a_full_street_takes_no_more_cars(town):
    route = Route(((0, -1.5), (40, -1.5)), body_radius=1.0, speed=8)
    cars = Traffic(town.grid, route).cars(150, lambda n: stream(0, "car", n))
    assert 5 < len(cars) < 150


def test_poles_vanish_and_appear_at_the_given_rates_and_keep_their_identity(sessions):
    for before, after in itertools.pairwise(sessions):
        old, new = standing(before, *FIXED), standing(after, *FIXED)
        assert all(new[id] == old[id] for id in old.keys() & new.keys())
        assert 0.02 < len(old.keys() - new.keys()) / len(old) < 0.25
        assert 0.02 < len(new.keys() - old.keys()) / len(old) < 0.25
    # What has gone does not come back under its old name.
    presence = np.array([[id in standing(s, *FIXED) for s in sessions] for id in standing(sessions[0], *FIXED)])
    assert (np.diff(presence.astype(int), axis=1) <= 0).all()
    trunks = [standing(session, PoleKind.TRUNK) for session in sessions]
    assert all(t == trunks[0] for t in trunks)
    for session in sessions:
        assert len({pole.id for pole in session.poles}) == len(session.poles)


def test_identities_of_a_large_town_do_not_meet():
    grid = Town(TownSettings(columns=6, rows_of_blocks=6)).grid
    settings = SMALL.furniture
    numbers = [site.id for make in (furnishing.pole_sites, furnishing.spare_sites) for site in make(grid, settings, 0)]
    numbers += [tree.trunk.id for tree in furnishing.trees(grid, settings, 0)]
    assert len(set(numbers)) == len(numbers) > 3000
    assert max(numbers) < BARREL_IDS


def test_without_rates_nothing_changes(town):
    still = Sessions(town, CHANGES.replaced(vanish_rate=0, appear_rate=0, parking_turnover=0))
    first, later = still.session(0), still.session(3)
    assert standing(first, *FIXED) == standing(later, *FIXED)
    assert [c for c in first.scene.vehicles if not c.speed] == [c for c in later.scene.vehicles if not c.speed]


def test_parked_cars_come_and_go_and_those_that_stay_are_the_same(sessions):
    parked = [{car for car in session.scene.vehicles if not car.speed} for session in sessions]
    for before, after in itertools.pairwise(parked):
        stayed = len(before & after) / len(before)
        assert 0.55 < stayed < 0.85  # 30 % of the places have changed
        assert after - before
    a, b = ({car: car.solids[0].mesh.vertices for car in cars} for cars in parked[:2])
    assert all(np.array_equal(a[car], b[car]) for car in a.keys() & b.keys())


def test_all_barrels_are_moved_by_the_same_vector_and_stand_alone(town, sessions):
    assert sessions[0].scene.barrels == ()
    first, still, after = (sessions[k].scene.barrels for k in (1, 2, 3))
    assert first == still
    assert sessions[4].scene.barrels == after
    assert [b.id for b in first] == [b.id for b in after]
    assert first[0].id == BARREL_IDS
    shift = np.array([(b.x - a.x, b.y - a.y) for a, b in zip(first, after, strict=True)])
    assert abs(shift - shift[0]).max() < 1e-12
    assert np.hypot(*shift[0]) == pytest.approx(3)
    row = np.array([(b.x, b.y) for b in first])
    along = row[-1] - row[0]
    assert np.hypot(*along) >= 60
    assert abs(along @ shift[0]) < 1e-9
    for barrel in (*first, *after):
        assert barrel.z == pytest.approx(float(town.grid.ground.elevation((barrel.x, barrel.y))))
    # No other pole in the stretch, on either side of the street.
    unit, length = along / np.hypot(*along), np.hypot(*along)
    for session in sessions:
        others = np.array([(p.x, p.y) for p in session.poles if p.kind is not PoleKind.BARREL])
        s, side = (others - row[0]) @ unit, (others - row[0]) @ shift[0] / 3
        assert not ((s > -0.5) & (s < length + 0.5) & (side > -3) & (side < 17)).any()


def test_leaves_follow_the_month(town, sessions):
    assert [session.month for session in sessions] == [5, 6, 7, 8, 9]
    later = Sessions(town, CHANGES).session(8)
    assert later.month == 1
    assert max(c.rate for c in later.scene.canopies) < 0.2 * max(c.rate for c in sessions[2].scene.canopies)


def test_a_session_follows_from_settings_and_seed_alone(town, sessions):
    again = Sessions(town, CHANGES).session(3)
    assert again.poles == sessions[3].poles
    assert again.scene.vehicles == sessions[3].scene.vehicles
    assert again.scene.pedestrians == sessions[3].scene.pedestrians
    assert again.route == sessions[3].route
    more = Sessions(town, CHANGES.replaced(pedestrians=3, parking_turnover=0.9)).session(3)
    assert more.poles == again.poles
    assert more.route == again.route


def test_what_cannot_be_is_refused(town):
    with pytest.raises(SimulationError, match="count from 0"):
        Sessions(town).session(-1)
    with pytest.raises(SimulationError, match="bare_length"):
        Town(TownSettings(bare_length=70))
    narrow = Town(SMALL.replaced(profile=StreetProfile(pavement_width=2.6)))
    with pytest.raises(SimulationError, match="barrel_shift"):
        Sessions(narrow)
