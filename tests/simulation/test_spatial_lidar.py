import dataclasses

import numpy as np
import pytest
import trimesh

from factorloc.errors import GeometryError, SimulationError
from factorloc.geometry import se3
from factorloc.scan import RayStatus
from factorloc.simulation import FloorPlan, MeshWorld, Solid, SpatialLidar, Surface, hdl_32e, hdl_64e, os_128, vlp_16
from factorloc.trajectory import Trajectory

MOUNT = se3.exp([0.02, -0.03, 0.4, 0.5, -0.2, 1.6])
EXACT = SpatialLidar(tuple(np.deg2rad([10.0, 0.0, -15.0])), columns=90, range_sigma=0.0, T_body_sensor=MOUNT)


def room(**features):
    mesh = trimesh.creation.box((24, 16, 10))
    return Solid(mesh, Surface.WALL, **features)


ROOM = MeshWorld([room()])


def rng(seed=3):
    return np.random.default_rng(seed)


def curve():
    """A vehicle that turns and climbs, 8 m/s and 1 rad/s."""
    stamps = np.linspace(0, 0.6, 61)
    return Trajectory(stamps, se3.exp(stamps[:, None] * np.array([0.1, -0.05, 1.0, 8.0, 0.0, 0.5])))


def on_walls(points):
    return np.abs(np.abs(points) / [12, 8, 5]).max(axis=-1)


@pytest.mark.parametrize(
    ("lidar", "shape", "first", "last"),
    [
        (hdl_64e(), (64, 2083), 2.0, -24.33),
        (hdl_32e(), (32, 2170), 10.67, -30.67),
        (vlp_16(), (16, 1800), 15.0, -15.0),
        (os_128(columns=2048), (128, 2048), 22.5, -22.5),
    ],
)
def test_models_have_the_beams_of_their_data_sheets(lidar, shape, first, last):
    degrees = np.rad2deg(lidar.elevations)
    assert lidar.directions.shape == (*shape, 3)
    assert degrees[[0, -1]] == pytest.approx([first, last], abs=0.005)
    assert (np.diff(degrees) < 0).all()


def test_the_two_blocks_of_the_hdl_64e():
    degrees = np.rad2deg(hdl_64e().elevations)
    assert degrees[31:33] == pytest.approx([-8.333, -8.83], abs=0.001)
    assert np.diff(degrees)[[0, 40]] == pytest.approx([-1 / 3, -1 / 2])


def test_models_take_other_settings():
    assert vlp_16(dropout=0.1, frame="roof").dropout == 0.1


def test_a_sweep_turns_clockwise_and_looks_ahead_in_its_middle():
    lidar = SpatialLidar((0.0,), columns=5, rotation_period=0.1)
    assert np.rad2deg(lidar.azimuths) == pytest.approx([144, 72, 0, -72, -144])
    assert lidar.column_times == pytest.approx([-0.04, -0.02, 0, 0.02, 0.04])


def test_a_standing_scan_lies_on_the_walls():
    pose = se3.exp([0.05, 0.02, 2.0, 1.0, -2.0, -1.0])
    scan = EXACT.cast(ROOM, pose, rng(), 2.5)
    assert scan.shape == (3, 90)
    assert (scan.dimension, scan.stamp) == (3, 2.5)
    assert scan.is_return.all()
    assert on_walls(se3.transform(pose @ MOUNT, scan.points())) == pytest.approx(1, abs=1e-12)
    elevation = np.arcsin(scan.directions[:, 2]).reshape(scan.shape)
    assert elevation == pytest.approx(np.broadcast_to(np.array(EXACT.elevations)[:, None], scan.shape))
    assert scan.stamps.reshape(scan.shape)[1] == pytest.approx(2.5 + EXACT.column_times)


def test_a_deskewed_sweep_from_a_moving_vehicle_lies_on_the_walls():
    scan = EXACT.sweep(ROOM, curve(), rng(), 0.3)
    T_world_sensor = curve().at([0.3]).poses[0] @ MOUNT
    assert on_walls(se3.transform(T_world_sensor, scan.points())) == pytest.approx(1, abs=1e-12)
    assert np.ptp(scan.origins, axis=0).max() > 0.5  # it moves by 0.8 m during the sweep


def test_a_raw_sweep_is_that_of_each_column_from_its_own_pose():
    raw = dataclasses.replace(EXACT, motion_distortion=True)
    scan = raw.sweep(ROOM, curve(), rng(), 0.3)
    assert (scan.origins == 0).all()
    assert (scan.ranges == EXACT.sweep(ROOM, curve(), rng(), 0.3).ranges).all()
    T_world_sensor = curve().at([0.3]).poses[0] @ MOUNT
    skewed = on_walls(se3.transform(T_world_sensor, scan.points()))
    assert np.abs(skewed - 1).max() > 0.01
    own = curve().at(scan.stamps).poses @ MOUNT
    assert on_walls(se3.transform(own, scan.points())) == pytest.approx(1, abs=1e-12)


def test_columns_see_moving_solids_at_their_own_times():
    wall = trimesh.creation.box((0.2, 40, 40), transform=trimesh.transformations.translation_matrix((10.1, 0, 0)))
    world = MeshWorld([Solid(wall, Surface.VEHICLE, velocity=(-20.0, 0.0, 0.0))])
    lidar = SpatialLidar((0.0,), columns=360, range_sigma=0.0, T_body_sensor=np.eye(4))
    scan = lidar.cast(world, np.eye(4), rng(), 0.2)
    points, stamps = scan.points(), scan.stamps[scan.is_return]
    assert len(points) > 90
    assert points[:, 0] == pytest.approx(10 - 20 * stamps)


def test_status_follows_from_the_measured_range():
    lidar = dataclasses.replace(EXACT, range_limits=(7.0, 11.0), T_body_sensor=np.eye(4))
    scan = lidar.cast(ROOM, np.eye(4), rng())
    exact = (np.array([12, 8, 5]) / np.maximum(np.abs(scan.directions), 1e-12)).min(axis=1)
    limits = lidar.range_limits
    expected = np.where(exact < limits[0], RayStatus.BELOW_MINIMUM, RayStatus.RETURN)
    assert (scan.status == np.where(exact >= limits[1], RayStatus.NO_RETURN, expected)).all()
    assert set(scan.status) >= {RayStatus.RETURN, RayStatus.NO_RETURN}
    assert scan.ranges == pytest.approx(np.clip(exact, *limits))


def test_noise_and_dropout_have_their_size():
    lidar = SpatialLidar((0.0, 0.3), columns=20_000, range_sigma=0.03, dropout=0.1, T_body_sensor=np.eye(4))
    scan = lidar.cast(ROOM, np.eye(4), rng())
    exact = (np.array([12, 8, 5]) / np.maximum(np.abs(scan.directions), 1e-12)).min(axis=1)
    assert (scan.ranges - exact)[scan.is_return].std() == pytest.approx(0.03, rel=0.03)
    assert (scan.status == RayStatus.NO_RETURN).mean() == pytest.approx(0.1, abs=0.006)


def test_angle_noise_is_alike_along_and_across_the_elevation():
    """Seen from inside a sphere of no thickness, the true hit strays from the reported direction on both axes."""
    lidar = SpatialLidar((1.2,), columns=20_000, range_sigma=0.0, angle_sigma=0.002, T_body_sensor=np.eye(4))

    class Recorder:
        dimension = 3

        def cast(self, origins, directions, rng, times=None):
            self.directions = directions
            return ROOM.cast(origins, directions, rng, times)

    recorder = Recorder()
    scan = lidar.cast(recorder, np.eye(4), rng())
    across = np.cross([0, 0, 1.0], scan.directions)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    along = np.cross(scan.directions, across)
    error = recorder.directions.reshape(-1, 3) - scan.directions
    assert [np.einsum("ni,ni->n", error, axis).std() for axis in (across, along)] == pytest.approx(
        [0.002] * 2, rel=0.03
    )


def test_the_seed_decides():
    noisy = dataclasses.replace(EXACT, range_sigma=0.02, angle_sigma=0.001, dropout=0.05)
    first, again, other = (noisy.sweep(ROOM, curve(), rng(seed), 0.3) for seed in (1, 1, 2))
    assert (first.ranges == again.ranges).all()
    assert (first.ranges != other.ranges).any()


def test_a_planar_world_is_refused():
    import shapely

    with pytest.raises(SimulationError, match="2 dimensions"):
        EXACT.cast(FloorPlan((shapely.box(-1, -1, 1, 1),)), np.eye(4), rng())


def test_a_trajectory_that_ends_within_the_sweep_is_refused():
    with pytest.raises(GeometryError, match="beyond the trajectory"):
        EXACT.sweep(ROOM, curve(), rng(), 0.58)


def test_stamps_must_fit_the_poses():
    with pytest.raises(SimulationError, match="does not fit"):
        EXACT.cast_many(ROOM, np.eye(4)[None], rng(), [0.0, 1.0])


@pytest.mark.parametrize(
    "setting",
    [
        {"elevations": ()},
        {"elevations": (2.0,)},
        {"columns": 0},
        {"rotation_period": 0.0},
        {"range_limits": (5.0, 2.0)},
        {"range_sigma": -1.0},
        {"angle_sigma": np.nan},
        {"dropout": 1.5},
        {"T_body_sensor": np.diag([1, 1, -1, 1])},
        {"T_body_sensor": np.eye(3)},
    ],
)
def test_bad_settings_are_refused(setting):
    with pytest.raises(SimulationError, match=f"lidar {next(iter(setting))}"):
        dataclasses.replace(EXACT, **setting)
