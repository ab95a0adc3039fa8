import numpy as np
import pytest
import scipy.spatial

from factorloc.geometry import se2
from factorloc.simulation import (
    OdometryNoise,
    PlanarLidar,
    Surface,
    integrate_odometry,
    office_plan,
    office_routes,
    simulate_drive,
)


@pytest.fixture(scope="module")
def plan():
    return office_plan()


@pytest.fixture(scope="module")
def drives(plan):
    return [simulate_drive(plan, route, seed=k) for k, route in enumerate(office_routes())]


def world_points(drive):
    scans = zip(drive.truth.poses, drive.scans, strict=True)
    return np.concatenate([se2.transform(se2.compose(T, s.T_body_sensor), s.points()) for T, s in scans])


def test_it_is_a_building_of_30_by_20_metres(plan):
    assert plan.bounds == pytest.approx((0, 0, 30, 20))
    assert len(plan.panes) > 10
    assert {round(f.decay_rate, 1) for f in plan.foliage} >= {0.6, 3.0}


def test_both_routes_are_clear_and_of_the_length_of_a_demonstration(plan, drives):
    for route, drive in zip(office_routes(), drives, strict=True):
        assert route.clearance(plan) > 0
        assert 150 <= len(drive) <= 250


def test_a_drive_holds_as_much_as_it_says(drives):
    for drive in drives:
        assert len(drive.scans) == len(drive.truth) == len(drive.odometry) + 1
        assert [scan.stamp for scan in drive.scans] == drive.stamps.tolist()


def test_scans_see_glass_and_foliage_and_mostly_return(plan, drives):
    lidar = PlanarLidar()
    for drive in drives:
        assert np.mean([scan.is_return.mean() for scan in drive.scans]) > 0.9
        T = se2.compose(drive.truth.poses, np.array(lidar.T_body_sensor))
        bearing = T[:, 2:] + lidar.angles
        hits = plan.cast(T[:, None, :2], np.stack([np.cos(bearing), np.sin(bearing)], -1), np.random.default_rng(0))
        share = np.bincount(hits.surfaces.ravel(), minlength=4) / hits.surfaces.size
        assert share[Surface.GLASS] > 0.005
        assert share[Surface.FOLIAGE] > 0.04


def test_the_second_drive_sees_what_the_first_has_mapped(drives):
    mapped, seen = (world_points(drive) for drive in drives)
    distances, _ = scipy.spatial.KDTree(mapped).query(seen)
    assert np.mean(distances < 0.1) > 0.9


def test_without_noise_points_lie_on_the_plan_and_odometry_leads_to_the_truth(plan):
    route = office_routes()[1]
    drive = simulate_drive(plan, route, PlanarLidar(range_sigma=0), OdometryNoise.none(), seed=0, period=5)
    assert plan.clearance(world_points(drive)).max() < 1e-9
    assert integrate_odometry(drive.truth.poses[0], drive.odometry) == pytest.approx(drive.truth.poses)
