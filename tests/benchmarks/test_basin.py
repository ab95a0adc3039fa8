"""The basin of convergence on a street so short and a lidar so coarse that nobody minds the time."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks import basin
from benchmarks.basin_competitors import PYRAMID, REGISTER, PointMap
from benchmarks.basin_scenes import street_scene
from benchmarks.starts import displaced, random_starts
from factorloc.config import read_config
from factorloc.errors import ConfigError
from factorloc.geometry import se3


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    settings = json.loads(basin.SETTINGS.read_text(encoding="utf-8"))
    settings["resolution"] = 0.4
    settings["offsets"] = [[0.1, 0.5], [1, 5]]
    settings["street"] |= {"street": {"length": 100.0}, "columns": 180, "range_limits": [1.0, 25.0], "period": 2.0}
    settings["street"] |= {"queries": 2, "margin": 40.0}
    settings["goals"] = {"street": {"least": {"success from 0.1 m, 0.5 deg": 50.0}}}
    path = tmp_path_factory.mktemp("basin") / "tiny.json"
    path.write_text(json.dumps(settings), encoding="utf-8")
    return path


def test_starts_are_as_far_off_as_said() -> None:
    poses = se3.exp(np.random.default_rng(1).normal(size=(50, 6)))
    found = random_starts(poses, 2.0, np.radians(10), 0.1, np.random.default_rng(2))
    motion = se3.between(poses, found)
    np.testing.assert_allclose(np.linalg.norm(motion[:, :2, 3], axis=1), 2.0)
    np.testing.assert_allclose(np.abs(motion[:, 2, 3]), 0.2)
    turn = np.degrees(np.abs(se3.log(motion)[:, :3]))
    np.testing.assert_allclose(turn, np.broadcast_to([1.0, 1.0, 10.0], turn.shape))
    assert np.ptp(np.arctan2(motion[:, 1, 3], motion[:, 0, 3])) > np.pi
    np.testing.assert_allclose(displaced(poses, np.zeros(3), np.zeros(3)), poses)


def test_a_pose_is_found_within_both_bounds_only() -> None:
    truth = se3.identity((4,))
    found = displaced(truth, np.diag([0.1, 0.3, 0.0])[[0, 1, 2, 2]], np.radians([[0, 0, 0.4]] * 2 + [[0, 0, 0.6]] * 2))
    found[3] = np.nan
    outcome = basin.judge(found, truth, (0.2, 0.5))
    assert outcome.converged.tolist() == [True, False, False, False]
    np.testing.assert_allclose(outcome.rotation[:3], [0.4, 0.4, 0.6])
    assert np.isinf(outcome.position[3])


def test_committed_settings_hold_the_goals() -> None:
    settings = read_config(basin.SETTINGS, basin.BasinSettings)
    assert settings.judged in settings.offsets
    assert settings.street.queries // 4 >= 12
    assert settings.street.queries >= 24
    assert settings.goals["street"].least == {"success from 1 m, 5 deg": 100.0, "success from 2 m, 10 deg": 95.0}
    assert settings.goals["street"].most == {"median position error": 0.02}
    assert settings.goals["0005"].least == {"success from 1 m, 5 deg": 95.0}


def test_a_goal_must_name_a_figure() -> None:
    with pytest.raises(ConfigError, match="no figure 'speed' of me"):
        basin.add_goals(basin.BasinBenchmark("basin", {}), "me", basin.Goals(most={"speed": 1.0}))


def test_a_quick_street_writes_its_report_and_its_picture(
    tiny: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = ["--json", str(tmp_path / "b.json"), "--plot", str(tmp_path / "b.svg")]
    code = basin.main(["--scenes", "street", "--settings", str(tiny), *files])
    report = json.loads((tmp_path / "b.json").read_text(encoding="utf-8"))
    assert code == (0 if all(goal["met"] for goal in report["goals"]) else 1)
    assert [goal["name"] for goal in report["goals"]] == [f"street, {REGISTER}: success from 0.1 m, 0.5 deg"]
    assert report["settings"]["scenes"]["street"]["queries"] == 2
    settings = read_config(tiny, basin.BasinSettings)
    for who in (REGISTER, PYRAMID, *settings.rivals.reaches):
        for figure in (*basin.COLUMNS, "success from 0.1 m, 0.5 deg", "success from 1 m, 5 deg"):
            assert f"street, {who}: {figure}" in report["figures"]
    assert "<svg" in (tmp_path / "b.svg").read_text(encoding="utf-8")
    assert REGISTER in capsys.readouterr().out


def test_rivals_find_a_pose_they_begin_at(tiny: Path) -> None:
    settings = read_config(tiny, basin.BasinSettings)
    scene = street_scene(settings.street, settings.resolution, settings.seed)
    for rival in PointMap(scene.points, settings.rivals).rivals():
        found = rival.align(rival.prepare(scene.scans[0]), scene.truth[0])
        assert basin.judge(found[None], scene.truth[:1], (0.2, 0.5)).converged.all(), rival.name


def test_a_scene_must_exist(capsys: pytest.CaptureFixture[str]) -> None:
    assert basin.main(["--scenes", "moon"]) == 2
    assert "moon" in capsys.readouterr().err
