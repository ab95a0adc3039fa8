"""Drive 0005 among its buildings, two starts only: what is found, and that no estimate leaves its set."""

import json
from pathlib import Path

import pytest

from benchmarks import facades_kitti0005
from factorloc.errors import FactorlocWarning


def test_without_data_it_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert facades_kitti0005.main(["--data", str(tmp_path)]) == 2
    assert "frames_every3_full.npz" in capsys.readouterr().err


@pytest.mark.data
def test_a_quick_run_is_consistent_with_the_reference(data_dir: Path, tmp_path: Path) -> None:
    given = ["--data", str(data_dir), "--quick", "--threads", "1"]
    files = ["--json", str(tmp_path / "drive.json"), "--plot", str(tmp_path / "drive.png")]
    with pytest.warns(FactorlocWarning, match="left out 2 roofs"):
        assert facades_kitti0005.main([*given, *files]) == 0
    run = json.loads((tmp_path / "drive.json").read_text("utf-8"))
    assert all(goal["met"] for goal in run["goals"])
    assert run["figures"]["points of facades a scan"]["value"] > 50
    assert len(list(tmp_path.glob("*.png"))) >= 3
