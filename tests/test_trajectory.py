"""Trajectories survive their file formats, interpolate on geodesics, and name what is wrong with a file."""

import bz2
import gzip
import lzma
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from strategies import trajectories

from factorloc.errors import DataError, FactorlocError, GeometryError
from factorloc.geometry import se2, se3, wrap
from factorloc.trajectory import Trajectory

few = settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])


def square() -> Trajectory:
    """Four corners of a unit square, driven counter-clockwise, one a second."""
    corners = [[0, 0, 0], [1, 0, np.pi / 2], [1, 1, np.pi], [0, 1, -np.pi / 2]]
    return Trajectory(np.arange(4.0), np.array(corners, float))


@few
@given(trajectories(3))
def test_tum_files_round_trip(tmp_path: Path, driven: Trajectory) -> None:
    driven.write_tum(tmp_path / "t.tum")
    read = Trajectory.read_tum(tmp_path / "t.tum")
    np.testing.assert_allclose(read.stamps, driven.stamps, atol=1e-6)
    np.testing.assert_allclose(read.poses, driven.poses, atol=1e-8)


@few
@given(trajectories(2))
def test_planar_trajectories_round_trip(tmp_path: Path, driven: Trajectory) -> None:
    driven.write_tum(tmp_path / "t.tum")
    driven.write_kitti(tmp_path / "t.txt")
    for read in (
        Trajectory.read_tum(tmp_path / "t.tum", planar=True),
        Trajectory.read_kitti(tmp_path / "t.txt", driven.stamps, planar=True),
    ):
        assert read.dimension == 2
        np.testing.assert_allclose(read.positions, driven.positions, atol=1e-7)
        np.testing.assert_allclose(wrap(read.headings - driven.headings), 0, atol=1e-7)
        np.testing.assert_allclose(read.stamps, driven.stamps, atol=1e-6)


@few
@given(trajectories(3))
def test_kitti_files_round_trip(tmp_path: Path, driven: Trajectory) -> None:
    driven.write_kitti(tmp_path / "t.txt")
    read = Trajectory.read_kitti(tmp_path / "t.txt")
    np.testing.assert_array_equal(read.stamps, np.arange(len(driven)))
    np.testing.assert_allclose(read.poses, driven.poses, atol=1e-7)


@pytest.mark.parametrize(("ending", "compress"), [("gz", gzip.compress), ("bz2", bz2.compress), ("xz", lzma.compress)])
def test_compressed_files_are_read(tmp_path: Path, ending: str, compress: object) -> None:
    square().write_tum(tmp_path / "t.tum")
    packed = tmp_path / f"t.tum.{ending}"
    packed.write_bytes(compress((tmp_path / "t.tum").read_bytes()))  # type: ignore[operator]
    np.testing.assert_allclose(Trajectory.read_tum(packed, planar=True).positions, square().positions, atol=1e-9)


def test_comments_commas_and_blank_lines_are_no_poses(tmp_path: Path) -> None:
    path = tmp_path / "t.tum"
    path.write_text("# stamp x y z ...\n\n1.5, 1,2,3, 0,0,0,2  # a quaternion of length 2\r\n")
    read = Trajectory.read_tum(path, world="utm", body="imu")
    np.testing.assert_array_equal(read.poses[0], se3.from_quaternion([1, 2, 3], [0, 0, 0, 1]))
    assert (read.stamps[0], read.world, read.body) == (1.5, "utm", "imu")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "holds no poses"),
        ("# nothing\n", "holds no poses"),
        ("0 0 0 0 0 0 1\n", "line 1 has not 8 finite numbers"),
        ("0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1 9\n", "line 2 has not 8 finite numbers"),
        ("# head\n0 0 0 nan 0 0 0 1\n", "line 2 has not 8 finite numbers"),
        ("0 0 0 zero 0 0 0 1\n", "line 1 has not 8 finite numbers"),
        ("0 0 0 0 0 0 0 0\n", "quaternions: one is zero"),
    ],
)
def test_a_bad_tum_file_is_named_in_one_line(tmp_path: Path, text: str, complaint: str) -> None:
    path = tmp_path / "bad.tum"
    path.write_text(text)
    with pytest.raises(DataError, match=complaint) as caught:
        Trajectory.read_tum(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("1 0 0 0 0 1 0 0 0 0 1\n", "line 1 has not 12 finite numbers"),
        ("2 0 0 0 0 1 0 0 0 0 1 0\n", "not a rigid motion"),
        ("1 0 0 0 0 1 0 0 0 0 -1 0\n", "not a rigid motion"),
        ("0 0 0 0 0 0 0 0 0 0 0 0\n", "not a rigid motion"),
        ("1e308 1e308 0 0 1e308 -1e308 0 0 0 0 1 0\n", "not a rigid motion"),
    ],
)
def test_a_bad_kitti_file_is_named_in_one_line(tmp_path: Path, text: str, complaint: str) -> None:
    path = tmp_path / "bad.txt"
    path.write_text(text)
    with pytest.raises(DataError, match=complaint) as caught:
        Trajectory.read_kitti(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


@few
@given(st.binary(max_size=200) | st.text("0123456789.-e nai#,\n", max_size=200).map(str.encode))
def test_any_bytes_are_a_trajectory_or_one_clear_error(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "noise.tum"
    path.write_bytes(content)
    for reader in (Trajectory.read_tum, Trajectory.read_kitti):
        try:
            assert len(reader(path)) > 0
        except FactorlocError as error:
            assert "\n" not in str(error)


def test_a_failed_reading_of_stamps_leaves_no_doubt_which(tmp_path: Path) -> None:
    square().write_kitti(tmp_path / "t.txt")
    with pytest.raises(GeometryError, match=r"^stamps: shape \(2,\) does not fit 4 poses"):
        Trajectory.read_kitti(tmp_path / "t.txt", [0.0, 1.0])


@few
@given(trajectories(2, least=2), st.floats(0, 1))
def test_interpolation_lies_on_the_geodesic(driven: Trajectory, part: float) -> None:
    stamp = driven.stamps[0] + part * (driven.stamps[1] - driven.stamps[0])
    stamp = min(stamp, driven.stamps[1])
    exact = (stamp - driven.stamps[0]) / (driven.stamps[1] - driven.stamps[0])
    expected = se2.interpolate(driven.poses[0], driven.poses[1], exact)
    np.testing.assert_allclose(driven.at(stamp).poses[0], expected, atol=1e-12)


@few
@given(trajectories(2, least=2))
def test_interpolation_at_its_own_times_returns_its_own_poses(driven: Trajectory) -> None:
    again = driven.at(driven.stamps)
    np.testing.assert_allclose(again.positions, driven.positions, atol=1e-11)
    np.testing.assert_allclose(wrap(again.headings - driven.headings), 0, atol=1e-11)


@few
@given(trajectories(3, least=2))
def test_spatial_interpolation_at_its_own_times_returns_its_own_poses(driven: Trajectory) -> None:
    np.testing.assert_allclose(driven.at(driven.stamps).poses, driven.poses, atol=1e-10)


@pytest.mark.parametrize("wanted", [-0.001, 3.001, np.nan, [1.0, np.nan], np.inf])
def test_times_outside_are_refused(wanted: float) -> None:
    with pytest.raises(GeometryError, match=r"^stamps: .*beyond the trajectory"):
        square().at(wanted)


def test_interpolation_needs_increasing_times() -> None:
    driven = square()
    for stamps in ([0.0, 1.0, 1.0, 2.0], [0.0, 2.0, 1.0, 3.0]):
        with pytest.raises(GeometryError, match="increasing stamps"):
            Trajectory(np.array(stamps), driven.poses).at(0.5)
    with pytest.raises(GeometryError, match="at least two poses"):
        driven.select([0]).at(0.0)


def test_length_positions_and_headings() -> None:
    driven = square()
    assert driven.length == 3
    assert driven.to_3d().length == 3
    np.testing.assert_array_equal(driven.to_3d().positions[:, 2], 0)
    np.testing.assert_allclose(driven.to_3d().headings, driven.headings, atol=1e-15)
    np.testing.assert_allclose(driven.to_3d().to_2d().poses, driven.poses, atol=1e-15)
    assert driven.to_2d() is driven
    assert driven.to_3d().to_3d().dimension == 3


def test_selection_by_mask_index_and_slice() -> None:
    driven = Trajectory(square().stamps, square().poses, np.arange(36.0).reshape(4, 3, 3))
    for keep in ([False, True, False, True], [1, 3], slice(1, None, 2)):
        some = driven.select(keep)
        np.testing.assert_array_equal(some.stamps, [1, 3])
        np.testing.assert_array_equal(some.poses, driven.poses[1::2])
        np.testing.assert_array_equal(some.covariances, driven.covariances[1::2])  # type: ignore[index]


def test_an_empty_trajectory_is_possible() -> None:
    empty = Trajectory(np.zeros(0), np.zeros((0, 3)))
    assert (len(empty), empty.length) == (0, 0)
    assert len(Trajectory(np.zeros(0), np.zeros((0, 4, 4)))) == 0
    assert len(square().select(np.zeros(4, bool))) == 0


@pytest.mark.parametrize(
    ("stamps", "poses", "covariances", "field"),
    [
        ([0.0], np.zeros((2, 3)), None, "stamps"),
        ([0.0, np.nan], np.zeros((2, 3)), None, "stamps"),
        ([0.0, 1.0], np.zeros((2, 4)), None, "poses"),
        ([0.0], np.zeros(3), None, "poses"),
        ([0.0], np.eye(4)[None, None], None, "poses"),
        ([0.0, 1.0], np.full((2, 3), np.nan), None, "poses"),
        ([0.0], np.zeros((1, 4, 4)), None, "poses"),
        ([0.0, 1.0], np.zeros((2, 3)), np.zeros((2, 6, 6)), "covariances"),
        ([0.0], np.eye(4)[None], np.zeros((1, 3, 3)), "covariances"),
        ([0.0], np.zeros((1, 3)), np.full((1, 3, 3), np.nan), "covariances"),
    ],
)
def test_what_cannot_be_is_refused_by_name(
    stamps: list[float], poses: np.ndarray, covariances: np.ndarray | None, field: str
) -> None:
    with pytest.raises(GeometryError, match=f"^{field}: "):
        Trajectory(np.array(stamps), poses, covariances)


@pytest.mark.data
@pytest.mark.parametrize("sequence", ["05", "06", "07"])
def test_published_kitti_trajectories_are_read(data_dir: Path, tmp_path: Path, sequence: str) -> None:
    path = data_dir / "kitti_poses" / f"{sequence}.txt"
    if not path.is_file():
        pytest.skip(f"no {path}")
    driven = Trajectory.read_kitti(path)
    np.testing.assert_array_equal(driven.poses[0].round(6), np.eye(4))
    table = np.loadtxt(path)
    np.testing.assert_allclose(driven.poses[:, :3, :].reshape(-1, 12), table, atol=1e-5)
    driven.write_kitti(tmp_path / "again.txt")
    np.testing.assert_allclose(Trajectory.read_kitti(tmp_path / "again.txt").poses, driven.poses, atol=1e-6)
