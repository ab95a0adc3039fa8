"""The drive on its first few frames, and what its reader makes of the packed file."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks import kitti0005
from benchmarks.kitti_frames import KittiFrames, read_frames
from factorloc.config import read_config
from factorloc.errors import DataError
from factorloc.geometry import se3
from factorloc.localization import LidarOdometry
from factorloc.scan import Scan


def pack_frames(folder: Path) -> None:
    (folder / "kitti_raw_0005").mkdir()
    axes = {"x": [400, 0, 600], "y": [0, 800, 0], "z": [20, 20, 20]}
    np.savez(
        folder / "kitti_raw_0005" / "frames_every3_full.npz",
        **{axis: np.array(values, np.int16) for axis, values in axes.items()},
        scale=0.005,
        count=np.array([2, 1]),
        frame=np.array([0, 3]),
    )
    poses = se3.exp(np.outer(np.arange(4.0), [0, 0, 0.1, 1, 0, 0]))
    np.savez(folder / "kitti_raw_0005" / "reference_poses.npz", T_velo0_velo=poses, oxts_t=0.1 * np.arange(4))


def test_frames_have_the_poses_and_times_of_their_numbers(tmp_path: Path) -> None:
    pack_frames(tmp_path)
    frames = read_frames(tmp_path, (0.9, 120.0))
    assert len(frames) == 2
    np.testing.assert_allclose(frames.scans[0].points(), [[2.0, 0.0, 0.1], [0.0, 4.0, 0.1]])
    np.testing.assert_allclose(frames.reference.stamps, [0.0, 0.3])
    np.testing.assert_allclose(se3.log(frames.poses[1]), [0, 0, 0.3, 3, 0, 0], atol=1e-12)
    assert len(frames.select(slice(1, None, 2))) == 1


def test_missing_frames_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(DataError, match="FACTORLOC_DATA"):
        read_frames(None, (0.9, 120.0))
    assert kitti0005.main(["--data", str(tmp_path)]) == 2
    assert "frames_every3_full.npz" in capsys.readouterr().err


def test_dead_reckoning_bridges_a_lost_motion() -> None:
    step = se3.exp(np.array([0, 0, 0.1, 1, 0, 0]))
    scan = Scan.from_points([[1.0, 0.0, 0.0]], (0.5, 10.0))
    driving = KittiFrames([scan] * 4, se3.identity((4,)))
    known, none = np.array([True, False, True]), np.zeros(3)
    motions = np.array([step, se3.identity(), step])
    odometry = LidarOdometry(motions, np.zeros((3, 6, 6)), known, none, none)
    path = kitti0005.dead_reckoning(driving, odometry)
    np.testing.assert_allclose(se3.log(path.poses[-1]), [0, 0, 0.3, 3, 0, 0], atol=1e-12)


@pytest.mark.data
def test_a_quick_run_writes_its_report_and_its_picture(data_dir: Path, tmp_path: Path) -> None:
    settings = read_config(kitti0005.SETTINGS, kitti0005.DriveSettings)
    small = settings.replaced(resolution=0.5, range_limits=(0.9, 25.0), directions=1)
    (tmp_path / "small.json").write_text(small.model_dump_json(), encoding="utf-8")
    files = ["--json", str(tmp_path / "k.json"), "--plot", str(tmp_path / "k.svg")]
    options = ["--frames", "6", "--settings", str(tmp_path / "small.json"), "--data", str(data_dir)]
    code = kitti0005.main(["--quick", *options, *files])
    report = json.loads((tmp_path / "k.json").read_text(encoding="utf-8"))
    assert code == (0 if all(goal["met"] for goal in report["goals"]) else 1)
    assert report["settings"]["scans localized"] == 3
    assert "consistency" in report["settings"]["reference"]
    assert 0 < report["figures"]["smoothed position RMSE"]["value"] < 0.3
    assert report["figures"]["memory of the tables"]["value"] > 0
    assert "<svg" in (tmp_path / "k.svg").read_text(encoding="utf-8")
