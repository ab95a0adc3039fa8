from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from factorloc.datasets import Drive, read_relations
from factorloc.errors import DataError

TEXT = "# t1 t2 x y z roll pitch yaw\n1.5 3.25 1 2 0 0 0 0.5\n\n3.25 9.000001 4 5 0.1 0.2 0.3 0.6\n"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    file = tmp_path / "hall.relations"
    file.write_text(TEXT)
    return file


def test_relations_are_read_and_found_among_keys(path: Path) -> None:
    relations = read_relations(path)
    assert len(relations) == 2
    np.testing.assert_array_equal(relations.planar(), [[1, 2, 0.5], [4, 5, 0.6]])
    np.testing.assert_array_equal(relations.motions[1], [4, 5, 0.1, 0.2, 0.3, 0.6])
    # Keys in file order, which runs backwards.
    np.testing.assert_array_equal(relations.rows([9.000001, 7, 1.5, 3.25]), [[2, 3], [3, 0]])


def test_stamps_of_epoch_seconds_keep_their_microseconds(tmp_path: Path) -> None:
    path = tmp_path / "hall.relations"
    path.write_text("976052857.337284 976052857.337285 0 0 0 0 0 0")
    keys = [976052857.337283, 976052857.337284, 976052857.337285]
    assert read_relations(path).rows(keys).tolist() == [[1, 2]]


def test_stamps_of_no_scan_or_of_several_are_an_error(path: Path) -> None:
    relations = read_relations(path)
    with pytest.raises(
        DataError, match=r"2 of 2 relations do not fit the log \(first: 3.250000 s belongs to no scan\)"
    ):
        relations.rows([1.5, 9.000001])
    with pytest.raises(DataError, match="belongs to 2 scans"):
        relations.rows([1.5, 3.25, 3.25, 9.000001])


@pytest.mark.parametrize("row", ["1 2 3", "1 2 x 0 0 0 0 0", "1 2 nan 0 0 0 0 0", "1 2 3 4 5 6 7 8 9"])
def test_a_damaged_row_is_an_error(tmp_path: Path, row: str) -> None:
    path = tmp_path / "hall.relations"
    path.write_text(TEXT + row + "\n")
    with pytest.raises(DataError, match=r"hall.relations: line 5 has not 8 finite numbers"):
        read_relations(path)


def test_no_relations_are_an_error(tmp_path: Path) -> None:
    path = tmp_path / "hall.relations"
    path.write_text("# nothing\n")
    with pytest.raises(DataError, match="holds no relations"):
        read_relations(path)


@pytest.mark.data
def test_real_relations_all_belong_to_scans(data_dir: Path, raw_log: Callable[[str], Drive]) -> None:
    relations = read_relations(data_dir / "carmen_raw/aces.relations")
    drive = raw_log("aces")
    rows = relations.rows(drive.keys)
    assert rows.shape == (1279, 2)
    # Neighbouring scans moved by odometry about as the relations say.
    path = drive.dead_reckoning().positions
    driven = np.linalg.norm(path[rows[:, 1]] - path[rows[:, 0]], axis=1)
    stated = np.linalg.norm(relations.planar()[:, :2], axis=1)
    near = np.abs(np.diff(rows, axis=1))[:, 0] < 50
    assert near.sum() > 100
    assert np.median(np.abs(driven - stated)[near]) < 0.05
