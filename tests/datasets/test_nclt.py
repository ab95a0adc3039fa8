"""NCLT sessions: files in the published format, written by hand and by the simulator."""

from pathlib import Path

import numpy as np
import pytest
import shapely

from factorloc.datasets import open_drive
from factorloc.datasets.nclt import NCLT_RECORD, read_nclt
from factorloc.datasets.nclt_odometry import NcltSensors, fuse_odometry
from factorloc.errors import DataError, SimulationError
from factorloc.geometry import se2, se3, wrap
from factorloc.simulation import Pole, PoleKind, Route, Scene, SimulatedDrive, simulate_drive, vlp_16
from factorloc.simulation.ground import Ground
from factorloc.simulation.nclt_export import write_nclt


@pytest.fixture(scope="module")
def drive() -> SimulatedDrive:
    posts = tuple(Pole(k, PoleKind.POST, 6.0 * k, 5.0 * (-1) ** k, 0.3, 0.0, 3.0) for k in range(8))
    scene = Scene(Ground(shapely.box(-60, -60, 80, 80)), poles=posts)
    route = Route(((0.0, 0.0), (20.0, 0.0), (20.0, 15.0)), 5.0, 4.0, 1.0)
    return simulate_drive(scene.world, route, vlp_16(columns=90), seed=2, period=0.2)


@pytest.fixture(scope="module")
def session(drive, tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("nclt")
    write_nclt(root, drive, "2012-02-05")
    return root / "2012-02-05"


def test_a_session_of_the_simulator_is_read_back(drive, session) -> None:
    found = open_drive(session)
    assert found.name == "nclt-2012-02-05"
    assert len(found) == len(drive)
    assert np.diff(found.stamps) == pytest.approx(np.diff(drive.stamps), abs=2e-6)
    assert found.truth is not None
    assert found.truth.poses == pytest.approx(drive.truth.poses, abs=1e-6)
    for ours, theirs in zip(found.scans, drive.scans, strict=True):
        there = se3.transform(theirs.T_body_sensor, theirs.points())
        here = se3.transform(ours.T_body_sensor, ours.points())
        there = there[np.linalg.norm(there - ours.T_body_sensor[:3, 3], axis=1) >= 1.01]
        assert abs(len(here) - len(there)) <= 5
        if len(here) == len(there):
            assert np.abs(here - there).max() <= 0.0026


def test_its_odometry_is_what_wheels_gyro_and_imu_say(drive, session) -> None:
    found = read_nclt(session)
    assert found.odometry_known.all()
    e = se2.between(se3.to_se2(drive.odometry), se3.to_se2(found.odometry))
    assert np.hypot(e[:, 0], e[:, 1])[3:].max() < 0.05
    assert np.abs(e[3:, 2]).max() < 0.01
    assert np.linalg.eigvalsh(found.odometry_covariances).min() > 0


def test_records_are_as_published(tmp_path) -> None:
    folder = tmp_path / "2012-01-08" / "velodyne_sync"
    folder.mkdir(parents=True)
    hits = np.array([(20_000 + 200, 20_000 + 400, 20_000 - 100, 7, 31)], NCLT_RECORD)  # 1 m ahead, 2 right, 0.5 up
    (folder / "1326030000000000.bin").write_bytes(hits.tobytes())
    (folder / "1326030000200000.bin").write_bytes(hits.tobytes())
    rows = "1326029999000000,1,2,3,0.1,0.2,0.3\n1326030001000000,1,2,3,0.1,0.2,0.3\n"
    (tmp_path / "2012-01-08" / "groundtruth_2012-01-08.csv").write_text(rows)
    found = read_nclt(tmp_path / "2012-01-08")
    scan = found.scans[0]
    assert se3.transform(scan.T_body_sensor, scan.points())[0] == pytest.approx([1.0, -2.0, 0.5])
    assert found.truth.poses[0, :3, 3] == pytest.approx([1.0, -2.0, -3.0])
    assert se3.to_se2(found.truth.poses)[0, 2] == pytest.approx(-0.3)
    assert not found.odometry_known.any()
    assert "no wheels.csv" in str(found.reports[0])


@pytest.mark.parametrize(
    ("name", "content", "line"),
    [
        ("velodyne_sync/1326030000400000.bin", b"1234567", "no whole number of 8-byte hits"),
        ("velodyne_sync/1326030000400000.bin", bytes(7) + b"\xff", "beams beyond 31"),
        ("wheels.csv", b"1326030000000000,1.0\n", "rows of 2 numbers; wheels has 3"),
        ("kvh.csv", b"utime,heading\n", "no table of numbers"),
    ],
)
def test_damage_is_one_line(session, tmp_path, name, content, line) -> None:
    import shutil

    copy = tmp_path / "2012-02-05"
    shutil.copytree(session, copy)
    for extra in copy.glob("groundtruth*"):
        extra.unlink()
    (copy / name).write_bytes(content)
    with pytest.raises(DataError, match=line):
        read_nclt(copy)


def test_a_session_is_not_written_over(drive, session) -> None:
    with pytest.raises(SimulationError, match="is there already"):
        write_nclt(session.parent, drive, session.name)


def test_the_filter_knows_how_wrong_it_is() -> None:
    rng = np.random.default_rng(4)
    times = np.arange(0.0, 60.0, 0.02)
    stamps = np.arange(0.5, 59.0, 0.5)
    speed, rate = 2.0 + np.sin(times / 5), 0.3 * np.sin(times / 3)
    truth = np.zeros((len(times), 3))
    for k in range(len(times) - 1):
        truth[k + 1] = se2.compose(truth[k], se2.exp(np.array([speed[k], 0.0, rate[k]]) * 0.02))
    wheels = np.column_stack([times, speed - rate * 0.28, speed + rate * 0.28])
    wheels[:, 1:] += rng.normal(0, 0.05, (len(times), 2))
    gyro = np.column_stack([times, wrap(truth[:, 2] + rng.normal(0, 0.0007, len(times)))])
    imu = np.column_stack([times, rate + 0.03 + rng.normal(0, 0.02, len(times))])
    motions, covariances, known = fuse_odometry(NcltSensors(wheels, gyro, imu), stamps)
    at = truth[np.searchsorted(times, stamps - 1e-9)]
    e = se2.log(se2.between(motions, se2.between(at[:-1], at[1:])))[5:]
    nees = np.einsum("ni,nij,nj->n", e, np.linalg.inv(covariances[5:]), e)
    assert known.all()
    assert np.hypot(e[:, 0], e[:, 1]).mean() < 0.02
    assert 0.02 < nees.mean() / 3 < 3
    gap = wheels[(times < 20) | (times > 24)]
    assert (~fuse_odometry(NcltSensors(gap, gyro, imu), stamps)[2]).sum() == 4  # of 4 s, less one at each end
