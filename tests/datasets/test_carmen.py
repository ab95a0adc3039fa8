import bz2
import gzip
import lzma
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from carmen_corridor import NO_RETURN, Corridor, flaser, odom

from factorloc.datasets import CarmenReader, KnownFile, open_drive, read_carmen
from factorloc.datasets.registry import KNOWN_FILES
from factorloc.errors import DataError, FactorlocWarning, GeometryError
from factorloc.geometry import se2
from factorloc.scan import RayStatus

CORRIDOR = Corridor.drive()
ORIGIN = (0, 0, 0)


def write(folder: Path, text: str, name: str = "hall.log") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def ring(beams: int, value: float = 2.0) -> str:
    return flaser([value] * beams, ORIGIN, ORIGIN, 0, 0) + "\n"


def test_a_raw_log_gives_its_robot_poses_as_odometry_and_no_truth(tmp_path: Path) -> None:
    drive = read_carmen(write(tmp_path, CORRIDOR.raw()))
    assert drive.truth is None
    assert drive.odometry_known.all()
    np.testing.assert_allclose(
        drive.odometry, se2.between(CORRIDOR.odometry[:-1], CORRIDOR.odometry[1:]), rtol=0, atol=3e-6
    )
    np.testing.assert_allclose(drive.stamps, CORRIDOR.stamps)
    np.testing.assert_allclose(drive.keys, 1000 + CORRIDOR.stamps)
    assert [scan.stamp for scan in drive.scans] == drive.stamps.tolist()


def test_a_corrected_log_gives_truth_and_the_odometry_between_scans(tmp_path: Path) -> None:
    drive = read_carmen(write(tmp_path, CORRIDOR.corrected()))
    np.testing.assert_allclose(drive.truth.poses, CORRIDOR.truth[::3], atol=1e-4)
    driven, true = (se2.between(poses[:-3:3], poses[3::3]) for poses in (CORRIDOR.odometry, CORRIDOR.truth))
    assert drive.odometry_known.all()
    np.testing.assert_allclose(drive.odometry, driven, atol=2e-4)
    assert np.abs(drive.odometry - true).max() > 0.01  # the two differ, so that the line above can tell


@pytest.mark.parametrize("how", ["name", "marks", "declared", "poses"])
def test_truth_never_leaks_into_odometry(tmp_path: Path, how: str) -> None:
    """However a corrected log is recognized, the poses in its laser messages do not move its odometry."""
    options = {"corrected": True} if how == "declared" else {}
    name = "hall-corrected.log" if how == "name" else "hall.log"
    text = CORRIDOR.corrected(marks=how == "marks")
    with pytest.warns(FactorlocWarning, match="confirm by corrected=True") if how == "poses" else nullcontext():
        drive = read_carmen(write(tmp_path, text, name), **options)
    driven = se2.between(CORRIDOR.odometry[:-3:3], CORRIDOR.odometry[3::3])
    np.testing.assert_allclose(drive.odometry, driven, atol=2e-4)
    if how == "poses":
        return  # they are what is recognized
    rng = np.random.default_rng(0)
    for robot_poses in (np.zeros_like(CORRIDOR.truth), CORRIDOR.truth + rng.normal(0, 9, CORRIDOR.truth.shape)):
        moved = CORRIDOR.corrected(robot_poses=robot_poses, marks=how == "marks")
        assert moved != text
        other = read_carmen(write(tmp_path, moved, name), **options)
        np.testing.assert_array_equal(other.odometry, drive.odometry)
        np.testing.assert_array_equal(other.truth.poses, drive.truth.poses)


@pytest.mark.parametrize("marks", [True, False])
def test_a_corrected_log_cannot_be_declared_raw(tmp_path: Path, marks: bool) -> None:
    path = write(tmp_path, CORRIDOR.corrected(marks=marks))
    with pytest.raises(DataError, match=r"hall.log: is not a raw log, as .* corrected=True"):
        read_carmen(path, corrected=False)


def test_poses_off_the_way_between_odometry_are_not_odometry(tmp_path: Path) -> None:
    lines = []
    for k in range(6):
        lines += [odom((k, 0, 0), k), flaser([1.0] * 180, (k, 2, 0), (k, 2, 0), k, k)]
    path = write(tmp_path, "\n".join([*lines, odom((6, 0, 0), 6)]))
    with pytest.raises(DataError, match="contradict"):
        read_carmen(path, corrected=False)
    with pytest.warns(FactorlocWarning, match="taken for a corrected log, as the poses of its scans contradict"):
        assert read_carmen(path).truth is not None


def test_a_corrected_log_is_recognized_though_the_robot_mostly_stands(tmp_path: Path) -> None:
    lines = [line for k in range(20) for line in (odom(ORIGIN, k), flaser([1.0] * 180, ORIGIN, ORIGIN, k, k))]
    for k in range(20, 25):
        anchor = (0.05 * k, 0.01, 0)
        lines += [odom((0.05 * k, 0, 0), k), flaser([1.0] * 180, anchor, anchor, k, k), odom(anchor, 0)]
    path = write(tmp_path, "\n".join(lines))
    with pytest.raises(DataError, match="contradict"):
        read_carmen(path, corrected=False)


def test_a_scan_that_comes_before_its_odometry_is_raw(tmp_path: Path) -> None:
    poses = [(0.1 * k, 0, 0) for k in range(9)]
    lines = [line for k, p in enumerate(poses) for line in (flaser([1.0] * 180, p, p, k, k), odom(p, k))]
    drive = read_carmen(write(tmp_path, "\n".join(lines)))
    assert drive.truth is None
    np.testing.assert_allclose(drive.odometry, [[0.1, 0, 0]] * 8, atol=1e-9)


def test_a_robot_that_stands_still_is_raw(tmp_path: Path) -> None:
    lines = [line for k in range(4) for line in (odom(ORIGIN, k), flaser([1.0] * 180, ORIGIN, ORIGIN, k, k))]
    assert read_carmen(write(tmp_path, "\n".join([*lines, odom(ORIGIN, 9)]))).truth is None
    assert read_carmen(write(tmp_path, ring(180))).truth is None


def test_odometry_is_never_composed_across_a_scan(tmp_path: Path) -> None:
    """Anchors 100 m apart: any motion that crosses one would show it."""
    lines = []
    for k in range(3):
        anchor = np.array([100.0 * k, 0, 0])
        lines += ["NEFF 1", flaser([1.0 + k] * 180, anchor, anchor, k, k)]
        lines += [odom(anchor + np.array([step, 0, 0]), k) for step in (0, 0.2, 0.5)]
    drive = read_carmen(write(tmp_path, "\n".join(lines)))
    np.testing.assert_allclose(drive.odometry, [[0.5, 0, 0]] * 2, atol=1e-12)
    np.testing.assert_allclose(drive.truth.positions[:, 0], [0, 100, 200])


@pytest.mark.parametrize(
    ("between", "known"),
    [
        ([], False),
        ([odom((0, 0, 0), 1)], False),
        ([odom((0, 0, 0), 1), odom((1, 0, 0), 2)], True),
        ([odom((0, 0, 0), 1), "SYNC x", odom((1, 0, 0), 2)], True),
        # What is not understood may be a scan that anchored the odometry anew.
        ([odom((0, 0, 0), 1), "RLASER 1 2 3", odom((1, 0, 0), 2)], False),
    ],
)
def test_a_motion_is_known_only_where_odometry_saw_it(tmp_path: Path, between: list[str], known: bool) -> None:
    lines = [flaser([1.0] * 180, ORIGIN, ORIGIN, 0, 0), *between, flaser([2.0] * 180, (9, 9, 0), (9, 9, 0), 1, 1)]
    drive = read_carmen(write(tmp_path, "\n".join(lines)), corrected=True)
    assert drive.odometry_known.tolist() == [known]
    np.testing.assert_allclose(drive.odometry, [[float(known), 0, 0]])


@pytest.mark.filterwarnings("ignore::factorloc.errors.FactorlocWarning")
@pytest.mark.parametrize("damaged", ["FLASER 180 1 2", "ODOM 1 2", "\x00\x01"])
def test_no_motion_is_known_across_a_damaged_line(tmp_path: Path, damaged: str) -> None:
    ends = [flaser([r] * 180, ORIGIN, ORIGIN, r, r) for r in (1.0, 2.0)]
    lines = [
        ends[0],
        odom((0, 0, 0), 1),
        damaged,
        odom((5, 0, 0), 2),
        ends[1],
        odom(ORIGIN, 0),
        odom((1, 0, 0), 0),
        ends[0],
    ]
    drive = read_carmen(write(tmp_path, "\n".join(lines)), corrected=True)
    assert drive.odometry_known.tolist() == [False, True]
    np.testing.assert_allclose(drive.odometry, [[0, 0, 0], [1, 0, 0]])
    assert drive.reports[0].damaged_lines == 1


@pytest.mark.parametrize("value", [50.0, 50.5, NO_RETURN, 81.91, np.inf])
def test_ranges_at_or_past_the_limit_are_no_returns(tmp_path: Path, value: float) -> None:
    text = flaser([3.0] * 90 + [value] * 90, ORIGIN, ORIGIN, 0, 0)
    scan = read_carmen(write(tmp_path, text)).scans[0]
    assert scan.range_limits == (0, 50)
    assert scan.status.tolist() == [RayStatus.RETURN] * 90 + [RayStatus.NO_RETURN] * 90
    assert scan.ranges.tolist() == [3.0] * 90 + [50.0] * 90


def test_ranges_below_the_minimum_are_marked(tmp_path: Path) -> None:
    path = write(tmp_path, flaser([0.1] * 90 + [0.5] * 90, ORIGIN, ORIGIN, 0, 0))
    scan = read_carmen(path, range_limits=(0.3, None)).scans[0]
    assert scan.range_limits == (0.3, 50)
    assert scan.status.tolist() == [RayStatus.BELOW_MINIMUM] * 90 + [RayStatus.RETURN] * 90


def test_zeros_are_returns_unless_a_minimum_is_set_and_are_spoken_of(tmp_path: Path) -> None:
    path = write(tmp_path, flaser([0.0] * 2 + [1.0] * 178, ORIGIN, ORIGIN, 0, 0))
    drive = read_carmen(path)
    assert drive.scans[0].is_return.all()
    assert "2 ranges are 0" in str(drive.reports[0])
    drive = read_carmen(path, range_limits=(0.01, 50))
    assert (drive.scans[0].status == RayStatus.BELOW_MINIMUM).sum() == 2
    assert drive.reports[0].notes == ()


def test_the_maximum_range_comes_from_the_best_source(tmp_path: Path) -> None:
    parameter = "PARAM robot_front_laser_max 12.5 nohost 0\n"
    laser = "ROBOTLASER1 0 -1 2 0.5 30 0.01 0 3 1 2 40 0 0 0 0 0 0 0 0 0 0 0 0 1 robot 1\n"

    def limit(text: str, name: str = "hall.log", **options) -> float:
        return read_carmen(write(tmp_path, text, name), **options).scans[0].range_limits[1]

    assert limit(parameter + laser, range_limits=(0, 9)) == 9
    assert limit(parameter + laser, "edmonton.log") == 30
    assert limit(parameter + ring(180), "edmonton.log") == 12.5
    assert limit(ring(180), "edmonton.log") == limit(ring(361), "edmonton-corrected.log", corrected=True) == 10
    assert limit(ring(181)) == 50
    assert "50 m assumed" in str(read_carmen(tmp_path / "hall.log").reports[0])


@pytest.mark.parametrize("beams", [360, 361])
def test_half_degree_beams_of_unknown_reach_need_a_limit(tmp_path: Path, beams: int) -> None:
    path = write(tmp_path, ring(beams))
    with pytest.raises(DataError, match=f"no maximum range of its {beams} beams; set range_limits"):
        read_carmen(path)
    assert len(read_carmen(path, range_limits=(0, 80)).scans[0]) == beams


def test_bad_limits_are_an_error(tmp_path: Path) -> None:
    path = write(tmp_path, ring(180))
    with pytest.raises(GeometryError, match="range_limits"):
        read_carmen(path, range_limits=(5, 1))
    path = write(tmp_path, "PARAM robot_front_laser_max far nohost 0\n" + ring(180))
    with pytest.raises(DataError, match="robot_front_laser_max is 'far'; expected a number"):
        read_carmen(path)


def test_beams_point_where_they_should(tmp_path: Path) -> None:
    scan = read_carmen(write(tmp_path, ring(360)), range_limits=(0, 80)).scans[0]
    angles = np.arctan2(*scan.directions.T[::-1])
    np.testing.assert_allclose(np.degrees(angles), -90 + np.arange(360) / 2, atol=1e-10)


def test_the_laser_offset_moves_the_truth_from_laser_to_body(tmp_path: Path) -> None:
    offset = "PARAM robot_frontlaser_offset 0.0 nohost 0\nPARAM robot_frontlaser_offset -0.25 nohost 0\n"
    pose = (3, 4, np.pi / 2)
    drive = read_carmen(write(tmp_path, offset + flaser([1.0] * 180, pose, pose, 0, 0)), corrected=True)
    np.testing.assert_array_equal(drive.scans[0].T_body_sensor, [-0.25, 0, 0])
    np.testing.assert_allclose(drive.truth.poses, [[3, 4.25, np.pi / 2]], atol=1e-6)
    np.testing.assert_allclose(se2.compose(drive.truth.poses[0], drive.scans[0].T_body_sensor), pose, atol=1e-6)


def test_robotlaser_messages_carry_their_mount_in_raw_logs(tmp_path: Path) -> None:
    lines = [
        f"ROBOTLASER1 0 -1 2 0.5 30 0.01 0 3 1 2 {k} 0 {k + 0.2} 0.1 0.4 {k} 0 0.4 0 0 0 0 0 {k} robot {k}"
        for k in range(3)
    ]
    drive = read_carmen(write(tmp_path, "\n".join([*lines, ring(180)])))
    np.testing.assert_allclose(drive.scans[0].T_body_sensor, se2.between([0, 0, 0.4], [0.2, 0.1, 0.4]), atol=1e-12)
    np.testing.assert_allclose(drive.odometry, [se2.between([0, 0, 0.4], [1, 0, 0.4])] * 2, atol=1e-12)
    assert drive.reports[0].used == {"ROBOTLASER1": 3}
    assert drive.reports[0].ignored == {"FLASER": 1}


@pytest.mark.parametrize(("ending", "opener"), [("gz", gzip.open), ("bz2", bz2.open), ("xz", lzma.open)])
def test_compressed_logs_read_alike(tmp_path: Path, ending: str, opener) -> None:
    plain = open_drive(write(tmp_path, CORRIDOR.raw()))
    path = tmp_path / f"hall.clf.{ending}"
    with opener(path, "wt") as stream:
        stream.write(CORRIDOR.raw())
    assert CarmenReader().matches(path)
    drive = open_drive(path)
    np.testing.assert_array_equal(drive.odometry, plain.odometry)
    assert drive.name == plain.name == "hall"


@pytest.mark.data
@pytest.mark.parametrize("known", [k for k in KNOWN_FILES if "corrected" in k.path], ids=lambda known: known.path)
def test_real_corrected_logs_read_whole(data_dir: Path, known: KnownFile) -> None:
    drive = open_drive(known.verify(data_dir))
    report = drive.reports[0]
    assert report.damaged_lines == 0
    assert report.used["FLASER"] == len(drive) == report.ignored["NEFF"]
    assert drive.truth.length > 100
    # Seattle's logger stood still once between two scans.
    assert (~drive.odometry_known).sum() == ("seattle" in known.path)
    true = se2.between(drive.truth.poses[:-1], drive.truth.poses[1:])[drive.odometry_known]
    measured = drive.odometry[drive.odometry_known]
    assert np.median(np.abs(true - measured)[:, 0]) < 0.1  # odometry resembles the truth
    assert (true != measured).any(axis=1).all()  # and is never the truth itself
    returns = np.concatenate([scan.ranges[scan.is_return] for scan in drive.scans])
    assert returns.min() > 0 and returns.max() < drive.scans[0].range_limits[1] < 81
