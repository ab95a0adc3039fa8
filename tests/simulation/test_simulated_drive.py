import numpy as np
import pytest
import shapely

from factorloc.errors import SimulationError
from factorloc.simulation import FloorPlan, Foliage, OdometryNoise, PlanarLidar, Route, simulate_drive

PLAN = FloorPlan((shapely.box(-2, -2, 8, 5),), (Foliage(shapely.box(2, 2, 6, 4), 0.8),))
ROUTE = Route(((0, 0), (5, 0), (5, 1.2)))


def ranges(drive):
    return np.array([scan.ranges for scan in drive.scans])


def drive(seed=1, **arguments):
    # Inside a solid block rays end at its faces; the route is checked against an open copy of it.
    plan = FloorPlan((PLAN.walls[0].exterior,), PLAN.foliage)
    return simulate_drive(plan, ROUTE, seed=seed, **arguments)


def test_a_seed_decides_everything():
    first, again, other = drive(1), drive(1), drive(2)
    assert (ranges(first) == ranges(again)).all()
    assert (first.odometry == again.odometry).all()
    assert (ranges(first) != ranges(other)).any()
    assert (first.odometry != other.odometry).all()


def test_lidar_and_wheels_draw_from_streams_of_their_own():
    plain = drive()
    assert (drive(lidar=PlanarLidar(beams=11)).odometry == plain.odometry).all()
    assert (ranges(drive(odometry_noise=OdometryNoise.none())) == ranges(plain)).all()


def test_stamps_follow_from_speed_and_period():
    sampled = drive(period=0.25, name="yard")
    assert sampled.name == "yard"
    assert sampled.stamps == pytest.approx(0.25 * np.arange(len(sampled)))
    assert sampled.truth.length == pytest.approx(sampled.stamps[-1] * ROUTE.speed, rel=0.01)


def test_a_route_through_a_wall_is_refused():
    with pytest.raises(SimulationError, match="touches something"):
        simulate_drive(PLAN, ROUTE, seed=0)


def test_a_planar_lidar_needs_a_planar_world():
    class Space:
        dimension = 3

        def clearance(self, points):
            return np.ones(len(points))

    with pytest.raises(SimulationError, match="3 dimensions"):
        simulate_drive(Space(), ROUTE, seed=0)
