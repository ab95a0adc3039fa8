import dataclasses

import numpy as np
import pytest
import trimesh

from factorloc.errors import SimulationError
from factorloc.geometry import se3
from factorloc.simulation import (
    Gnss,
    MeshWorld,
    OdometryNoise,
    PlanarLidar,
    Route,
    Solid,
    SpatialLidar,
    SpatialOdometryNoise,
    SpatialRoute,
    Surface,
    simulate_drive,
)

LIDAR = SpatialLidar((0.1, 0.0, -0.1, -0.3), columns=60, dropout=0.01)
ROUTE = Route(((0, 0), (12, 0), (12, 8)), radius=4.0, speed=6.0, body_radius=0.9)


def solid(size, centre, surface, **features):
    mesh = trimesh.creation.box(size)
    mesh.apply_translation(centre)
    return Solid(mesh, surface, **features)


def street(*more):
    ground = solid((200, 200, 1), (0, 0, -0.5), Surface.GROUND)
    return MeshWorld([ground, solid((40, 2, 12), (0, 15, 6), Surface.FACADE), *more])


def slope(a, b):
    """Ground z = a x + b y."""
    corners = np.array([(-90, -90), (90, -90), (-90, 90), (90, 90)])
    vertices = np.column_stack([corners, corners @ [a, b]])
    return MeshWorld([Solid(trimesh.Trimesh(vertices, [(0, 1, 2), (1, 3, 2)]), Surface.GROUND)])


def drive(world=None, route=ROUTE, seed=1, **settings):
    return simulate_drive(world or street(), route, settings.pop("lidar", LIDAR), seed=seed, **settings)


def ranges(scans):
    return np.array([scan.ranges for scan in scans])


def test_a_drive_in_space_has_everything():
    sampled = drive(period=0.4, name="street", gnss=Gnss(period=0.2))
    n = len(sampled)
    assert (sampled.dimension, sampled.name, n) == (3, "street", len(ROUTE.sample(0.4)))
    assert sampled.odometry.shape == (n - 1, 4, 4)
    assert sampled.odometry_covariances.shape == (n - 1, 6, 6)
    assert sampled.truth.poses.shape == (n, 4, 4)
    assert [scan.stamp for scan in sampled.scans] == pytest.approx(sampled.stamps)
    assert sampled.gnss.stamps[:2] == pytest.approx([0, 0.2])
    assert se3.to_se2(sampled.truth.poses) == pytest.approx(ROUTE.sample(0.4).poses, abs=1e-4)


def test_points_of_the_ground_lie_on_the_ground():
    exact = dataclasses.replace(LIDAR, range_sigma=0.0)
    sampled = drive(lidar=exact)
    for pose, scan in zip(sampled.truth.poses, sampled.scans, strict=True):
        points = se3.transform(pose @ scan.T_body_sensor, scan.points())
        assert (np.abs(points[:, 2]) < 1e-9).sum() > 40


def test_a_seed_decides_everything():
    first, again, other = drive(gnss=Gnss()), drive(gnss=Gnss()), drive(seed=2, gnss=Gnss())
    assert (ranges(first.scans) == ranges(again.scans)).all()
    assert (first.odometry == again.odometry).all()
    assert (first.gnss.positions == again.gnss.positions).all()
    assert (ranges(first.scans) != ranges(other.scans)).any()
    assert (first.odometry != other.odometry).any()
    assert (first.gnss.positions != other.gnss.positions).all()


def test_sensors_draw_from_streams_of_their_own():
    plain = drive(gnss=Gnss())
    fewer = drive(lidar=dataclasses.replace(LIDAR, columns=9), gnss=Gnss())
    assert (fewer.odometry == plain.odometry).all()
    assert (fewer.gnss.positions == plain.gnss.positions).all()
    assert (ranges(drive(odometry_noise=SpatialOdometryNoise.none()).scans) == ranges(plain.scans)).all()


def test_scans_that_are_not_kept_are_the_same():
    kept, lazy = drive(), drive(keep_scans=False)
    assert isinstance(kept.scans, tuple)
    assert not isinstance(lazy.scans, tuple)
    assert len(lazy) == len(kept)
    assert (ranges(lazy.scans) == ranges(kept.scans)).all()
    assert (lazy.scans[-1].ranges == kept.scans[-1].ranges).all()
    assert (ranges(lazy.scans[1::2]) == ranges(kept.scans[1::2])).all()
    with pytest.raises(IndexError):
        lazy.scans[len(kept)]


@pytest.mark.parametrize("keep", [True, False])
def test_each_scan_is_announced_once_in_order(keep):
    seen = []
    sampled = drive(keep_scans=keep, on_scan=lambda k, scan: seen.append((k, scan.stamp)))
    assert seen == [(k, stamp) for k, stamp in enumerate(sampled.stamps)]


def test_a_planar_drive_announces_its_scans_too():
    import shapely

    from factorloc.simulation import FloorPlan

    plan, seen = FloorPlan((shapely.box(-2, -2, 8, 5).exterior,)), []
    sampled = simulate_drive(plan, Route(((0, 0), (5, 0))), seed=1, on_scan=lambda k, scan: seen.append(k))
    assert seen == list(range(len(sampled)))
    assert sampled.dimension == 2


def test_the_vehicle_stands_on_a_slope_as_the_ground_does():
    a, b = 0.08, -0.05
    planar = np.array([[3.0, -4.0, 0.7], [0.0, 2.0, -2.0]])
    poses = SpatialRoute(ROUTE).lift(slope(a, b), planar)
    assert poses[:, 2, 3] == pytest.approx(planar[:, :2] @ [a, b])
    normal = np.array([-a, -b, 1]) / np.linalg.norm([a, b, 1])
    assert poses[:, :3, 2] == pytest.approx(np.tile(normal, (2, 1)))
    assert se3.to_se2(poses) == pytest.approx(planar)
    assert se3.as_poses(poses) == pytest.approx(poses)


def test_a_flat_route_ignores_the_ground():
    poses = SpatialRoute(ROUTE, flat=True).lift(slope(0.1, 0.1), [[3.0, -4.0, 0.7]])
    assert poses == pytest.approx(se3.from_se2([[3.0, -4.0, 0.7]]))


def test_a_vehicle_stands_before_and_after_the_route():
    motion = SpatialRoute(ROUTE).motion(street(), -0.05, ROUTE.duration + 0.05)
    assert motion.positions[0] == pytest.approx([0, 0, 0], abs=1e-12)
    assert motion.positions[-1] == pytest.approx([12, 8, 0], abs=1e-12)
    assert np.diff(motion.stamps).max() <= 0.01 + 1e-9


def test_a_route_beyond_the_ground_is_refused():
    with pytest.raises(SimulationError, match="no ground under a wheel"):
        drive(route=Route(((0, 0), (150, 0))))


def test_a_route_through_something_is_refused():
    post = solid((0.2, 0.2, 1.0), (6, 0.5, 0.5), Surface.POLE)
    with pytest.raises(SimulationError, match=r"touches something at \(5\.\d\d, 0\.00"):
        drive(street(post))
    inside = solid((60, 12, 4), (0, 0, 2), Surface.FACADE)
    with pytest.raises(SimulationError, match=r"touches something.* 0\.0 m along"):
        drive(street(inside))


def test_a_route_into_a_moving_vehicle_is_refused():
    def crossing(y):
        return solid((2, 4, 1.5), (8, y, 0.75), Surface.VEHICLE, velocity=(0.0, 10.0, 0.0))

    with pytest.raises(SimulationError, match="touches something"):
        drive(street(crossing(-8 / 6 * 10)))
    assert len(drive(street(crossing(-60)))) > 0


def test_dimensions_must_agree():
    with pytest.raises(SimulationError, match="2 dimensions; a mesh world needs"):
        drive(lidar=PlanarLidar())
    import shapely

    from factorloc.simulation import FloorPlan

    with pytest.raises(SimulationError, match="no mesh world"):
        simulate_drive(FloorPlan((shapely.box(-1, -1, 1, 1),)), SpatialRoute(ROUTE), seed=0)


@pytest.mark.parametrize("name", ["wheelbase", "track", "height"])
def test_bad_sizes_are_refused(name):
    with pytest.raises(SimulationError, match=f"route {name}"):
        SpatialRoute(ROUTE, **{name: 0.0})


def test_planar_noise_is_that_of_the_wheels():
    noise = OdometryNoise(0.05**2, 0.01**2, 0.05**2, 0.0)
    one, other = drive(odometry_noise=noise), drive(odometry_noise=SpatialOdometryNoise(wheels=noise))
    assert (one.odometry == other.odometry).all()
