"""Sequences of the odometry benchmark: truth of the camera's place in a vehicle's axes, the lidar where it was."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from kitti_writer import TR, sweep, text, write_points, write_sequence

from factorloc.datasets import KittiOdometryReader, open_drive, read_kitti_odometry
from factorloc.datasets.kitti_odometry import T_CAMERA_BODY
from factorloc.errors import DataError, FactorlocWarning
from factorloc.geometry import se3
from factorloc.scan import RayStatus


@pytest.fixture
def sequence(tmp_path: Path) -> Path:
    return write_sequence(tmp_path)


def test_the_body_has_the_axes_of_a_vehicle(sequence: Path) -> None:
    drive = open_drive(sequence)
    assert (drive.name, drive.dimension, len(drive)) == ("kitti-07", 3, 4)
    # The camera sees along its z; the vehicle drives along its x.
    np.testing.assert_allclose(drive.truth.poses[:, :3, :3], np.tile(np.eye(3), (4, 1, 1)), atol=1e-9)
    np.testing.assert_allclose(drive.truth.positions, np.arange(4)[:, None] * [1, 0, 0], atol=1e-9)
    np.testing.assert_allclose(drive.stamps, [0, 0.1, 0.2, 0.3], atol=1e-6)
    assert drive.keys.tolist() == [0, 1, 2, 3]


def test_the_lidar_sits_where_the_calibration_says(sequence: Path) -> None:
    scan = open_drive(sequence).scans[2]
    expected = np.eye(4)
    expected[:3, 3] = [-0.3, 0.01, 0.07]
    np.testing.assert_allclose(scan.T_body_sensor, expected, atol=1e-9)
    np.testing.assert_allclose(scan.points(), sweep(2)[:3], atol=1e-5)
    # By the camera's own axes: p_cam = Tr p_velo.
    seen = se3.transform(T_CAMERA_BODY @ scan.T_body_sensor, scan.points())
    np.testing.assert_allclose(seen, scan.points() @ TR[:, :3].T + TR[:, 3], atol=1e-5)
    assert scan.status.tolist() == [RayStatus.RETURN] * 3 + [RayStatus.BELOW_MINIMUM, RayStatus.NO_RETURN]
    assert scan.range_limits == (0.9, 120.0)


def test_there_is_no_odometry(sequence: Path) -> None:
    drive = open_drive(sequence)
    assert not drive.odometry_known.any()
    np.testing.assert_array_equal(drive.odometry, np.tile(np.eye(4), (3, 1, 1)))
    shutil.rmtree(sequence.parents[1] / "poses")
    blind = open_drive(sequence)
    assert blind.truth is None
    assert "no truth" in str(blind.reports[0])
    np.testing.assert_array_equal(blind.odometry, drive.odometry)


def test_poses_lie_beside_the_root_too_or_where_told(sequence: Path, tmp_path: Path) -> None:
    poses = tmp_path / "poses" / "07.txt"
    given = read_kitti_odometry(sequence, poses=poses).truth.poses
    (tmp_path / "dataset").mkdir()
    moved = shutil.move(tmp_path / "sequences", tmp_path / "dataset")
    np.testing.assert_array_equal(open_drive(Path(moved) / "07").truth.poses, given)
    with pytest.raises(DataError, match="no such file"):
        read_kitti_odometry(Path(moved) / "07", poses=tmp_path / "poses" / "08.txt")


def test_only_frames_asked_for_are_read(sequence: Path) -> None:
    (sequence / "velodyne" / "000001.bin").write_bytes(b"damaged")
    drive = open_drive(sequence, frames=slice(0, None, 2))
    assert drive.keys.tolist() == [0, 2]
    np.testing.assert_allclose(drive.truth.positions[:, 0], [0, 2])
    assert drive.reports[0].ignored == {"not selected": 2}
    with pytest.raises(DataError, match=r"000001\.bin: cut short, 7 bytes"):
        open_drive(sequence)


def test_frames_are_matched_by_number_and_those_without_a_partner_counted(sequence: Path) -> None:
    (sequence / "velodyne" / "000001.bin").unlink()
    for k in (4, 5):
        write_points(sequence / "velodyne" / f"{k:06d}.bin", sweep(k))
    with (sequence / "times.txt").open("a") as times:
        times.write("0.4\n")
    reason = (
        "2 damaged frames left out: 1 x sweep without a pose of the truth (first at frame 4); 1 x sweep without a time"
    )
    with pytest.warns(FactorlocWarning, match="2 damaged frames left out") as caught:
        drive = open_drive(sequence)
    assert reason in str(caught[0].message)
    assert drive.keys.tolist() == [0, 2, 3]
    np.testing.assert_allclose(drive.truth.positions[:, 0], [0, 2, 3])
    np.testing.assert_allclose([scan.points()[0, 0] for scan in drive.scans], [2, 4, 5])
    np.testing.assert_allclose(drive.stamps, [0, 0.2, 0.3], atol=1e-6)


def test_points_left_out_are_counted_over_all_sweeps(sequence: Path) -> None:
    write_points(sequence / "velodyne" / "000001.bin", np.vstack([sweep(1), np.zeros((3, 3))]))
    drive = open_drive(sequence)
    assert "3 points at (0, 0, 0), no measurement, left out" in drive.reports[0].notes
    assert len(drive.scans[1]) == 5
    write_points(sequence / "velodyne" / "000002.bin", np.full((2, 3), np.nan))
    with pytest.warns(FactorlocWarning, match="2 points that are not finite"):
        drive = open_drive(sequence)
    assert len(drive.scans[2]) == 0


def test_a_calibration_without_the_lidar_says_what_to_do(sequence: Path) -> None:
    calib = sequence / "calib.txt"
    calib.write_text(f"P0: {text(np.eye(3, 4))}\n")
    with pytest.raises(DataError, match=r"calib\.txt: holds no line Tr .* T_body_sensor="):
        open_drive(sequence)
    calib.write_text("Tr: 1 2 3\n")
    with pytest.raises(DataError, match="Tr has not 9 finite numbers"):
        open_drive(sequence)
    calib.write_text(f"Tr: {text(2 * TR)}\n")
    with pytest.raises(DataError, match="Tr is not a rigid motion"):
        open_drive(sequence)
    calib.unlink()
    with pytest.raises(DataError, match=r"calib\.txt: no such file; .* T_body_sensor="):
        open_drive(sequence)
    mount = se3.exp([0.1, 0, 0, 1, 2, 3])
    np.testing.assert_array_equal(open_drive(sequence, T_body_sensor=mount).scans[0].T_body_sensor, mount)


@pytest.mark.parametrize(
    ("content", "reason"),
    [("", "holds no times"), ("0.0\nsoon\n", "line 2 is no time: 'soon'"), ("inf\n", "no finite time")],
)
def test_damaged_times_are_refused(sequence: Path, content: str, reason: str) -> None:
    (sequence / "times.txt").write_text(content)
    with pytest.raises(DataError, match=f"times.txt: .*{reason}"):
        open_drive(sequence)


def test_other_folders_are_not_taken_for_sequences(sequence: Path, tmp_path: Path) -> None:
    assert KittiOdometryReader().matches(sequence)
    assert not KittiOdometryReader().matches(tmp_path)
    with pytest.raises(DataError, match=r"no known format; .*sequences/NN with velodyne/"):
        open_drive(tmp_path)
