"""GPS and attitude become Cartesian poses about a first fix."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from kitti_writer import FIX, write_oxts

from factorloc.datasets.oxts import enu_poses, read_oxts
from factorloc.errors import DataError
from factorloc.geometry import se3

LEVEL = (0.0, 0.0, 0.0)


def pose(*row: float) -> np.ndarray:
    return enu_poses([row], FIX)[0]


def test_axes_point_forward_left_and_up() -> None:
    # Yaw counts from east; roll lifts the left side; pitch lowers the front.
    np.testing.assert_allclose(pose(*FIX, *LEVEL), np.eye(4), atol=1e-9)
    np.testing.assert_allclose(pose(*FIX, 0, 0, np.pi / 2)[:3, :3] @ [1, 0, 0], [0, 1, 0], atol=1e-12)
    assert pose(*FIX, 0.1, 0, 0)[2, 1] == pytest.approx(np.sin(0.1))
    assert pose(*FIX, 0, 0.1, 0)[2, 0] == pytest.approx(-np.sin(0.1))


@given(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4), st.floats(-3.1, 3.1))
def test_angles_turn_about_x_then_y_then_z(roll: float, pitch: float, yaw: float) -> None:
    turns = [se3.exp(np.append(np.eye(3)[2 - k] * angle, np.zeros(3))) for k, angle in enumerate((yaw, pitch, roll))]
    np.testing.assert_allclose(
        pose(*FIX, roll, pitch, yaw)[:3, :3], (turns[0] @ turns[1] @ turns[2])[:3, :3], atol=1e-9
    )


def test_positions_are_metres_east_north_and_up() -> None:
    lat, lon, alt = FIX
    # Radii of curvature of WGS 84 at 49 degrees: 6372 km along the meridian, 6390 km across it.
    np.testing.assert_allclose(
        pose(lat + 1e-4, lon, alt, *LEVEL)[:3, 3], [0, np.radians(1e-4) * 6371.9e3, 0], atol=1e-3
    )
    east = np.radians(1e-4) * 6390.3e3 * np.cos(np.radians(lat))
    np.testing.assert_allclose(pose(lat, lon + 1e-4, alt, *LEVEL)[:3, 3], [east, 0, 0], atol=1e-3)
    np.testing.assert_allclose(pose(lat, lon, alt + 3, *LEVEL)[:3, 3], [0, 0, 3], atol=1e-6)


@given(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.floats(-3, 3))
def test_the_frame_is_cartesian_whatever_its_origin(north: float, east: float, yaw: float) -> None:
    # Distances and relative attitudes do not depend on where the plane touches the earth.
    rows = [(49.0, 8.4, 100, 0, 0, 0), (49.0 + north, 8.4 + east, 130, 0.1, 0.2, yaw)]
    here, there = enu_poses(rows, FIX), enu_poses(rows, (49.05, 8.3, 0))
    np.testing.assert_allclose(se3.between(*here), se3.between(*there), atol=1e-6)
    assert abs(here[0, 0, 0] - 1) < 1e-9
    assert np.abs(here - there).max() > 1


def test_damaged_rows_are_counted(tmp_path: Path) -> None:
    for k in range(5):
        write_oxts(tmp_path, k, (*FIX, 0, 0, 1))
    folder = tmp_path / "oxts" / "data"
    (folder / "0000000001.txt").write_text("49.0 8.4\n")
    (folder / "0000000002.txt").write_text("no fix\n")
    write_oxts(tmp_path, 3, (91.0, 8.4, 0, 0, 0, 0))
    (folder / "readme.txt").touch()
    rows, report = read_oxts(folder)
    assert list(rows) == [0, 4]
    assert report.damaged_lines == 3
    assert "3 damaged frames left out" in str(report)
    assert "first at frame 1" in str(report)
    for k in (0, 4):
        write_oxts(tmp_path, k, (np.nan, 0, 0))
    with pytest.raises(DataError, match="holds no sound row"):
        read_oxts(folder)
