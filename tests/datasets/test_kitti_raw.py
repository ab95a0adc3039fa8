"""Drives of the raw data: OXTS is the truth and never odometry, matched by frame number."""

import runpy
import shutil
from pathlib import Path

import numpy as np
import pytest
from kitti_writer import FIX, IMU_TO_VELO, sweep, write_drive, write_oxts

from factorloc.datasets import KittiRawReader, open_drive
from factorloc.datasets.kitti_files import unix_time
from factorloc.errors import DataError, FactorlocWarning
from factorloc.geometry import se3


@pytest.fixture
def raw(tmp_path: Path) -> Path:
    return write_drive(tmp_path)


def test_the_body_is_the_inertial_unit(raw: Path) -> None:
    drive = open_drive(raw)
    assert (drive.name, drive.dimension, len(drive)) == ("2011_09_26_drive_0099_sync", 3, 4)
    np.testing.assert_allclose(drive.scans[0].T_body_sensor[:3], np.hstack([np.eye(3), -IMU_TO_VELO[:, 3:]]), atol=1e-9)
    np.testing.assert_allclose(drive.scans[1].points(), sweep(1)[:3], atol=1e-5)
    step = drive.truth.positions[1]
    np.testing.assert_allclose(step, [0, np.radians(1e-5) * 6371.9e3, 0.5], atol=1e-4)
    np.testing.assert_allclose(drive.truth.headings, np.pi / 2, atol=1e-3)
    # The front is up by 0.02, the left side by 0.01.
    np.testing.assert_allclose(drive.truth.poses[0][2, :2], [np.sin(0.02), np.sin(0.01) * np.cos(0.02)], atol=1e-6)
    np.testing.assert_allclose(np.diff(drive.stamps), 0.1, atol=1e-5)
    assert "about lat 49.000000000 lon 8.400000000 alt 112.000 m" in str(drive.reports[0])


def test_truth_never_becomes_odometry(raw: Path) -> None:
    drive = open_drive(raw)
    assert np.linalg.norm(drive.truth.positions[-1]) > 3
    shutil.rmtree(raw / "oxts")
    blind = open_drive(raw)
    assert blind.truth is None
    for one in (drive, blind):
        assert not one.odometry_known.any()
        assert one.odometry_covariances is None
        np.testing.assert_array_equal(one.odometry, np.tile(np.eye(4), (3, 1, 1)))


def test_sweeps_and_rows_are_matched_by_number(raw: Path) -> None:
    (raw / "velodyne_points" / "data" / "0000000001.bin").unlink()
    (raw / "oxts" / "data" / "0000000002.txt").unlink()
    with pytest.warns(FactorlocWarning, match="1 x sweep without a pose of the truth .first at frame 2"):
        drive = open_drive(raw)
    assert drive.keys.tolist() == [0, 3]
    assert drive.scans[1].points()[0, 0] == 5
    assert drive.truth.positions[1, 2] == pytest.approx(1.5, abs=1e-5)
    assert (drive.reports[0].lines, drive.reports[1].lines) == (3, 3)


def test_parts_of_a_drive_share_their_map_frame(raw: Path) -> None:
    whole, part = open_drive(raw), open_drive(raw, frames=[2, 3])
    np.testing.assert_array_equal(part.truth.poses, whole.truth.poses[2:])


def test_a_damaged_row_costs_its_sweep(raw: Path) -> None:
    write_oxts(raw, 1, (np.nan, *FIX))
    with pytest.warns(FactorlocWarning, match=r"oxts/data: 1 damaged frames left out"):
        assert open_drive(raw).keys.tolist() == [0, 2, 3]


def test_a_frame_without_a_time_is_a_blank_line(raw: Path) -> None:
    stamps = raw / "velodyne_points" / "timestamps.txt"
    lines = stamps.read_text().splitlines()
    stamps.write_text("\n".join([lines[0], "", *lines[2:]]) + "\n")
    with pytest.warns(FactorlocWarning, match="1 x sweep without a time .first at frame 1"):
        assert open_drive(raw).keys.tolist() == [0, 2, 3]
    stamps.write_text("2011-09-26\n")
    with pytest.raises(DataError, match=r"timestamps\.txt: line 1 is no time: '2011-09-26'"):
        open_drive(raw)


def test_times_count_from_1970() -> None:
    assert unix_time("1970-01-02 01:01:01.25\n") == 86400 + 3600 + 61.25
    assert unix_time("2011-09-26 13:02:25.964389445") == pytest.approx(1317042145.964389445, abs=1e-6)
    assert unix_time("2011-09-26 00:00:00000") == 1316995200


def test_a_missing_calibration_names_file_and_option(raw: Path) -> None:
    (raw.parent / "calib_imu_to_velo.txt").unlink()
    with pytest.raises(DataError, match=r"2011_09_26/calib_imu_to_velo\.txt: no such file; .* T_body_sensor="):
        open_drive(raw)
    mount = se3.exp([0, 0.1, 0, 1, 0, 0.8])
    np.testing.assert_array_equal(open_drive(raw, T_body_sensor=mount).scans[0].T_body_sensor, mount)
    (raw.parent / "calib_imu_to_velo.txt").write_text("R: 1 0 0\n")
    with pytest.raises(DataError, match=r"calib_imu_to_velo\.txt: R, T has not 9 finite numbers"):
        open_drive(raw)


def test_the_layout_is_told_by_its_folder(raw: Path) -> None:
    assert KittiRawReader().matches(raw)
    assert not KittiRawReader().matches(raw.parent)


@pytest.fixture(scope="session")
def street(data_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Drive 0005 in KITTI's own layout, every third frame in full."""
    script = data_dir / "tools" / "unpack_kitti_raw_0005.py"
    if not script.is_file():
        pytest.skip(f"no {script}")
    target = tmp_path_factory.mktemp("kitti")
    load = np.load
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", [script.name, str(target)])
        patch.setattr(np, "load", lambda path: dict(load(path)))  # unpack each array once
        runpy.run_path(str(script), run_name="__main__")
    return target / "2011_09_26" / "2011_09_26_drive_0005_sync"


@pytest.mark.data
def test_a_street_is_read_in_full(street: Path, data_dir: Path) -> None:
    with pytest.raises(DataError, match="calib_imu_to_velo"):
        open_drive(street)
    drive = open_drive(street, frames=[0, 1, 20, -1], T_body_sensor=np.eye(4))
    assert drive.keys.tolist() == [0, 3, 60, 153]
    packed = np.load(data_dir / "kitti_raw_0005" / "frames_every3_full.npz")
    assert [len(scan) for scan in drive.scans] == packed["count"][[0, 1, 20, -1]].tolist()
    first = slice(0, packed["count"][0])
    cloud = np.stack([packed[axis][first] * float(packed["scale"]) for axis in "xyz"], -1)
    inside = (np.linalg.norm(cloud, axis=1) >= 0.9) & (np.linalg.norm(cloud, axis=1) < 120)
    np.testing.assert_allclose(drive.scans[0].points(), cloud[inside], atol=1e-5)
    reference = np.load(data_dir / "kitti_raw_0005" / "reference_poses.npz")
    rows = drive.keys.astype(int)
    np.testing.assert_allclose(drive.truth.positions[:, :2], reference["oxts_xy_enu"][rows], atol=0.01)
    np.testing.assert_allclose(drive.truth.headings, reference["oxts_yaw_enu"][rows], atol=1e-4)
    np.testing.assert_allclose(drive.stamps - drive.stamps[0], reference["oxts_t"][rows], atol=1e-5)
    assert drive.reports[0].lines == 52
    assert drive.reports[1].used == {"rows": 154}
