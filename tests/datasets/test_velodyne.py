"""Sweeps are read by frame number; what is no ray is counted, what is cut short is refused."""

from pathlib import Path

import numpy as np
import pytest
from kitti_writer import write_points

from factorloc.datasets.velodyne import read_points, select_frames, sweep_files
from factorloc.errors import DataError


def test_points_that_are_no_rays_are_counted(tmp_path: Path) -> None:
    rows = np.array([[1, 2, 3], [0, 0, 0], [np.nan, 0, 0], [0, 0, 0], [0, 0, 4], [1, np.inf, 1]])
    write_points(tmp_path / "000000.bin", rows)
    points, origins, undefined = read_points(tmp_path / "000000.bin")
    np.testing.assert_array_equal(points, [[1, 2, 3], [0, 0, 4]])
    assert (origins, undefined) == (2, 2)


@pytest.mark.parametrize(("data", "reason"), [(b"", "is empty"), (bytes(47), "cut short, 47 bytes")])
def test_a_damaged_sweep_is_refused_by_name(tmp_path: Path, data: bytes, reason: str) -> None:
    (tmp_path / "3.bin").write_bytes(data)
    with pytest.raises(DataError, match=rf"3\.bin: {reason}"):
        read_points(tmp_path / "3.bin")
    with pytest.raises(DataError, match=r"4\.bin: cannot be read"):
        read_points(tmp_path / "4.bin")


def test_files_are_ordered_by_number_not_by_name(tmp_path: Path) -> None:
    for name in ("10.bin", "9.bin", "000011.bin", "._9.bin", "8.txt", "poses.bin"):
        (tmp_path / name).touch()
    assert list(sweep_files(tmp_path)) == [9, 10, 11]
    (tmp_path / "0009.bin").touch()
    with pytest.raises(DataError, match="1 frame numbers occur twice"):
        sweep_files(tmp_path)


def test_a_folder_without_sweeps_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="holds no sweep"):
        sweep_files(tmp_path)
    with pytest.raises(DataError, match="no such folder"):
        sweep_files(tmp_path / "velodyne")


def test_positions_select_frame_numbers() -> None:
    numbers = [0, 3, 6, 9]
    assert select_frames(Path(), numbers, slice(1, None, 2)) == [3, 9]
    assert select_frames(Path(), numbers, [0, -1]) == [0, 9]
    assert select_frames(Path(), numbers, np.array([2])) == [6]
    assert select_frames(Path(), numbers, np.array([True, False, False, True])) == [0, 9]


@pytest.mark.parametrize("frames", [[], [4], [2, 1], [1, 1], slice(4, None), [[0]]])
def test_a_bad_selection_names_the_option(frames) -> None:
    with pytest.raises(DataError, match="frames: "):
        select_frames(Path("sweeps"), [0, 3, 6, 9], frames)
