import dataclasses

import numpy as np
import pytest
import trimesh

from factorloc.datasets.kitti_odometry import read_kitti_odometry
from factorloc.errors import FactorlocError, SimulationError
from factorloc.geometry import se3
from factorloc.simulation import MeshWorld, Route, Solid, SpatialLidar, Surface, simulate_drive, write_kitti

LIDAR = SpatialLidar((0.2, 0.0, -0.2), columns=40, T_body_sensor=se3.exp([0.01, 0.02, 0.1, 0.3, 0, 1.7]))
ROUTE = Route(((0, 0), (8, 0), (8, 8)), radius=3.0, speed=5.0)


def block(size, centre, surface):
    mesh = trimesh.creation.box(size)
    mesh.apply_translation(centre)
    return Solid(mesh, surface)


WORLD = MeshWorld(
    [block((80, 80, 1), (0, 0, -0.5), Surface.GROUND), block((20, 1, 9), (3, 12, 4.5), Surface.FACADE)],
)


@pytest.fixture(scope="module")
def drive():
    return simulate_drive(WORLD, ROUTE, LIDAR, seed=3, keep_scans=False)


def test_a_sequence_reads_back_as_it_was_driven(drive, tmp_path):
    write_kitti(tmp_path, drive, "07")
    found = read_kitti_odometry(tmp_path / "sequences" / "07", range_limits=LIDAR.range_limits)
    assert len(found.scans) == len(drive)
    assert found.stamps == pytest.approx(drive.stamps - drive.stamps[0])
    # The map frames differ; points of all scans in the frame of the first scan must not.
    first = found.truth.poses[0] @ found.scans[0].T_body_sensor
    own = drive.truth.poses[0] @ np.array(LIDAR.T_body_sensor)
    for k, scan in enumerate(drive.scans):
        read = se3.transform(se3.inverse(first) @ found.truth.poses[k] @ found.scans[k].T_body_sensor, points(found, k))
        true = se3.transform(se3.inverse(own) @ drive.truth.poses[k] @ scan.T_body_sensor, scan.points())
        assert read == pytest.approx(true, abs=2e-5)  # single precision
    assert any((~scan.is_return).any() for scan in drive.scans)


def points(found, k):
    return found.scans[k].points()


def test_the_layout_is_that_of_the_benchmark(drive, tmp_path):
    write_kitti(tmp_path, drive)
    folder = tmp_path / "sequences" / "00"
    assert sorted(path.name for path in folder.iterdir()) == ["calib.txt", "times.txt", "velodyne"]
    assert sorted(path.name for path in (folder / "velodyne").iterdir())[1] == "000001.bin"
    rows = np.fromfile(folder / "velodyne" / "000000.bin", "<f4").reshape(-1, 4)
    assert rows[:, :3] == pytest.approx(drive.scans[0].points(), rel=1e-6, abs=1e-5)
    assert (rows[:, 3] == 0).all()
    camera = np.loadtxt(tmp_path / "poses" / "00.txt").reshape(-1, 3, 4)
    assert camera[0] == pytest.approx(np.eye(4)[:3])
    # The camera looks ahead: the first 8 m are along its z axis, then the route turns left, to its -x.
    lever = np.array(LIDAR.T_body_sensor)[0, 3]
    assert camera[2, 2, 3] == pytest.approx(5 * (drive.stamps[2] - drive.stamps[0]), abs=0.1 + lever)
    assert camera[-1, 0, 3] < -5
    assert (folder.stat().st_mode & 0o777) == 0o755


def test_another_camera_gives_the_same_truth(drive, tmp_path):
    write_kitti(tmp_path, drive, "00")
    write_kitti(tmp_path, drive, "01", T_camera_lidar=se3.exp([0.1, 1.2, -0.3, 0.5, 0.1, 0.2]))
    lidar_poses = []
    for name in ("00", "01"):
        calibration = (tmp_path / "sequences" / name / "calib.txt").read_text().split()
        Tr = np.vstack([np.array(calibration[1:], float).reshape(3, 4), [0, 0, 0, 1]])
        camera = np.loadtxt(tmp_path / "poses" / f"{name}.txt").reshape(-1, 3, 4)
        camera = np.concatenate([camera, np.tile([[[0, 0, 0, 1.0]]], (len(camera), 1, 1))], axis=1)
        lidar_poses.append(np.linalg.inv(Tr) @ camera @ Tr)
    assert lidar_poses[0] == pytest.approx(lidar_poses[1], abs=1e-9)


def test_what_is_there_is_not_overwritten(drive, tmp_path):
    write_kitti(tmp_path, drive)
    with pytest.raises(SimulationError, match="is there already"):
        write_kitti(tmp_path, drive)


def test_nothing_is_left_behind_when_a_scan_fails(drive, tmp_path):
    class Broken:
        def __init__(self, scans):
            self.scans = scans

        def __len__(self):
            return len(self.scans)

        def __iter__(self):
            yield self.scans[0]
            raise OSError(28, "No space left on device")

    with pytest.raises(FactorlocError, match="No space left"):
        write_kitti(tmp_path, dataclasses.replace(drive, scans=Broken(drive.scans)))
    assert [path for path in tmp_path.rglob("*") if path.name not in ("sequences", "poses")] == []


def test_bad_drives_and_names_are_refused(drive, tmp_path):
    planar = dataclasses.replace(drive, truth=drive.truth.to_2d())
    with pytest.raises(SimulationError, match="2-D"):
        write_kitti(tmp_path, planar)
    with pytest.raises(SimulationError, match="plain name"):
        write_kitti(tmp_path, drive, "../00")
    turned = [*drive.scans[:1], dataclasses.replace(drive.scans[1], T_body_sensor=np.eye(4))]
    with pytest.raises(SimulationError, match="differs"):
        write_kitti(tmp_path, dataclasses.replace(drive, scans=turned))
    assert list((tmp_path / "sequences").iterdir()) == []
