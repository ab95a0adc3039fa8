import dataclasses

import numpy as np
import pytest
import shapely

from factorloc.errors import GeometryError, SimulationError
from factorloc.geometry import se2
from factorloc.scan import RayStatus
from factorloc.simulation import FloorPlan, PlanarLidar

ROOM = FloorPlan((shapely.box(-5, -5, 5, 5),))
EXACT = PlanarLidar(range_sigma=0, T_body_sensor=(0, 0, 0))


def rng():
    return np.random.default_rng(11)


def test_exact_ranges_of_a_square_room():
    scan = EXACT.cast(ROOM, [0, 0, 0.3], rng(), stamp=2.5)
    bearing = EXACT.angles + 0.3
    assert scan.ranges == pytest.approx(5 / np.maximum(abs(np.cos(bearing)), abs(np.sin(bearing))))
    assert scan.is_return.all()
    assert scan.stamp == 2.5


def test_default_beams_are_every_degree_over_half_a_turn():
    assert np.rad2deg(PlanarLidar().angles) == pytest.approx(np.arange(-90, 91))
    assert np.rad2deg(PlanarLidar.wide().angles) == pytest.approx(np.arange(-135, 135.5, 0.5))


def test_points_lie_on_the_walls_whatever_the_mount():
    lidar = dataclasses.replace(EXACT, T_body_sensor=(0.4, -0.2, 0.7))
    poses = np.array([[1, 2, 0.5], [-3, 0.4, -2.9]])
    for pose, scan in zip(poses, lidar.cast_many(ROOM, poses, rng(), [0, 1]), strict=True):
        points = se2.transform(se2.compose(pose, scan.T_body_sensor), scan.points())
        assert abs(points).max(axis=1) == pytest.approx(5)


def test_one_scan_is_many_of_one():
    noisy = PlanarLidar(angle_sigma=0.01, dropout=0.1)
    one = noisy.cast(ROOM, [1, 0, 0], rng())
    (other,) = noisy.cast_many(ROOM, [[1, 0, 0]], rng())
    assert (one.ranges == other.ranges).all()
    assert (one.status == other.status).all()


def test_status_follows_from_the_limits():
    lidar = dataclasses.replace(EXACT, beams=5, range_limits=(1.0, 6.0))
    scan = lidar.cast(ROOM, [0, -4.5, 0], rng())
    assert scan.status.tolist() == [RayStatus.BELOW_MINIMUM, RayStatus.BELOW_MINIMUM, *[RayStatus.RETURN] * 1, *[2] * 2]
    assert scan.ranges == pytest.approx([1, 1, 5, 6, 6])


def test_rays_into_the_open_do_not_return():
    wall = FloorPlan((shapely.LineString([(5, -50), (5, 50)]),))
    scan = EXACT.cast(wall, [0, 0, np.pi], rng())
    assert (scan.status == RayStatus.NO_RETURN).all()
    assert (scan.ranges == 30).all()


def test_range_noise_has_its_deviation():
    lidar = dataclasses.replace(EXACT, range_sigma=0.03)
    exact = EXACT.cast(ROOM, [0, 0, 0], rng()).ranges
    scans = lidar.cast_many(ROOM, np.zeros((200, 3)), rng())
    errors = np.concatenate([scan.ranges - exact for scan in scans])
    assert abs(errors.mean()) < 4 * 0.03 / np.sqrt(errors.size)
    assert errors.std() == pytest.approx(0.03, rel=0.03)


def test_angle_noise_moves_slanted_hits():
    """On a wall at distance 5 the range is 5 / cos(angle), so it moves by 5 tan(angle) / cos(angle) per radian."""
    lidar = dataclasses.replace(EXACT, beams=2, field_of_view=np.pi / 2, angle_sigma=0.002)
    wall = FloorPlan((shapely.LineString([(5, -50), (5, 50)]),))
    ranges = np.array([scan.ranges for scan in lidar.cast_many(wall, np.zeros((5000, 3)), rng())])
    assert ranges.std(axis=0) == pytest.approx(np.full(2, 0.002 * 5 * np.sqrt(2)), rel=0.05)
    directions = lidar.cast(wall, [0, 0, 0], rng()).directions
    assert directions == pytest.approx(np.array([[1, -1], [1, 1]]) / np.sqrt(2))


def test_dropouts_are_reported_without_return():
    scans = dataclasses.replace(EXACT, dropout=0.2).cast_many(ROOM, np.zeros((100, 3)), rng())
    lost = np.concatenate([scan.status == RayStatus.NO_RETURN for scan in scans])
    assert abs(lost.mean() - 0.2) < 4 * np.sqrt(0.2 * 0.8 / lost.size)


@pytest.mark.parametrize(
    "setting",
    [
        {"beams": 1},
        {"field_of_view": 2 * np.pi},
        {"range_limits": (2.0, 1.0)},
        {"range_limits": (0.0, np.inf)},
        {"range_sigma": -0.1},
        {"angle_sigma": np.nan},
        {"dropout": 1.5},
        {"T_body_sensor": (0.0, 0.0)},
    ],
)
def test_settings_out_of_range_are_refused(setting):
    with pytest.raises(SimulationError, match=next(iter(setting))):
        PlanarLidar(**setting)


def test_what_does_not_fit_is_refused():
    with pytest.raises(SimulationError, match="stamps"):
        EXACT.cast_many(ROOM, np.zeros((3, 3)), rng(), [0, 1])
    with pytest.raises(GeometryError, match="poses"):
        EXACT.cast(ROOM, [0, 0], rng())
