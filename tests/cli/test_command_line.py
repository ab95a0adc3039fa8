"""The command line: what it writes, and the one line it says when something is wrong."""

import json
import logging
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from factorloc import Trajectory
from factorloc.cli.app import app
from factorloc.cli.selection import select_scans
from factorloc.errors import ConfigError, FactorlocError
from factorloc.mapping import grid
from factorloc.simulation import office_plan, office_routes, simulate_drive, write_carmen


@pytest.fixture(autouse=True)
def quiet_logging() -> Iterator[None]:
    """The command line sets up logging for a process of its own; undo it for the tests after it."""
    package = logging.getLogger("factorloc")
    before = package.handlers[:], package.level, package.propagate
    yield
    package.handlers[:], package.level, package.propagate = before


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A mapping drive as corrected log, and a second drive as raw log."""
    folder = tmp_path_factory.mktemp("logs")
    plan, (first, second) = office_plan(), office_routes()
    mapping = simulate_drive(plan, first, seed=1)
    write_carmen(folder / "office-corrected.log", mapping, corrected=True)
    drive = simulate_drive(plan, second, seed=2, period=1.0)
    write_carmen(folder / "second.clf", drive)
    drive.truth.write_tum(folder / "truth.tum")
    return folder / "office-corrected.log", folder / "second.clf"


@pytest.fixture(scope="module")
def built(logs: tuple[Path, Path]) -> Path:
    target = logs[0].with_name("office.h5")
    result = CliRunner().invoke(app, ["map", "build", str(logs[0]), "-o", str(target)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return target


def test_map_build_writes_a_map_and_its_picture(built: Path) -> None:
    assert built.exists()
    assert built.with_suffix(".png").stat().st_size > 10_000
    result = CliRunner().invoke(app, ["info", str(built)], catch_exceptions=False)
    assert "resolution" in result.output
    assert "0.1 m" in result.output


def test_localize_leaves_every_file_and_finds_the_drive(built: Path, logs: tuple[Path, Path], tmp_path: Path) -> None:
    truth = Trajectory.read_tum(logs[1].with_name("truth.tum"), planar=True)
    x, y, heading = truth.poses[0] + [0.5, -0.4, 0.1]
    start = [f"{x:.3f}", f"{y:.3f}", f"{np.degrees(heading):.2f}"]
    command = ["localize", str(built), str(logs[1]), "--start", *start, "-o", str(tmp_path / "runs")]
    result = CliRunner().invoke(app, command, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    latest = tmp_path / "runs" / "latest"
    assert latest.is_symlink()
    for name in ("smoothed.tum", "smoothed.kitti", "smoothed_covariances.npy", "settings.json", "run.json", "map.png"):
        assert (latest / name).stat().st_size > 0, name
    found = Trajectory.read_tum(latest / "smoothed.tum", planar=True)
    assert np.hypot(*(found.positions - truth.positions).T).max() < 0.15
    covariances = np.load(latest / "smoothed_covariances.npy", allow_pickle=False)
    assert covariances.shape == (len(found), 3, 3)
    account = json.loads((latest / "run.json").read_text())
    assert account["results"]["smoothed"]["poses"] == len(found)
    shown = CliRunner().invoke(app, ["info", str(latest)], catch_exceptions=False)
    assert "smoothed" in shown.output

    metrics = tmp_path / "metrics.json"
    command = ["evaluate", str(latest / "smoothed.tum"), str(logs[1].with_name("truth.tum")), "--json", str(metrics)]
    result = CliRunner().invoke(app, command, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    assert json.loads(metrics.read_text())["metrics"]["absolute translation"]["rmse"] < 0.1


def test_settings_written_by_a_run_can_be_read_by_the_next(
    built: Path, logs: tuple[Path, Path], tmp_path: Path
) -> None:
    config = tmp_path / "settings.toml"
    config.write_text("information = 0.5\nblurs = [0.5, 0.0]\n[optimizer]\nmax_iterations = 3\n")
    command = ["localize", str(built), str(logs[1]), "--scans", "0:10", "--no-plots", "-o", str(tmp_path / "runs")]
    command += ["--start", "15", "1.5", "90", "--config", str(config)]
    result = CliRunner().invoke(app, command, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    settings = json.loads((tmp_path / "runs" / "latest" / "settings.json").read_text())
    assert settings["information"] == 0.5
    assert settings["optimizer"]["max_iterations"] == 3
    assert not list((tmp_path / "runs" / "latest").glob("*.png"))


@pytest.mark.parametrize(
    ("wanted", "rows"),
    [
        ("all", [0, 1, 2, 3, 4]),
        ("even", [0, 2, 4]),
        ("odd", [1, 3]),
        ("first-half", [0, 1]),
        ("second-half", [2, 3, 4]),
        ("1:4", [1, 2, 3]),
        ("::3", [0, 3]),
        ("-2:", [3, 4]),
    ],
)
def test_selections_name_scans(wanted: str, rows: list[int]) -> None:
    assert select_scans(5, wanted).tolist() == rows


@pytest.mark.parametrize("wanted", ["evn", "1", "a:b", "::0", "::-1", "9:", "1:2:3:4"])
def test_wrong_selections_are_refused(wanted: str) -> None:
    with pytest.raises(ConfigError, match="--scans"):
        select_scans(5, wanted)


def _failure(*command: str) -> str:
    result = CliRunner().invoke(app, list(command))
    assert isinstance(result.exception, FactorlocError), result.output
    assert "\n" not in str(result.exception)
    return str(result.exception)


def test_bad_input_is_one_line_that_names_the_file(built: Path, logs: tuple[Path, Path], tmp_path: Path) -> None:
    raw = str(logs[1])
    empty = tmp_path / "empty.log"
    empty.touch()
    broken = tmp_path / "settings.toml"
    broken.write_text("informaton = 1\n")
    assert "no such file" in _failure("map", "build", str(tmp_path / "missing-corrected.log"))
    assert "empty.log" in _failure("map", "build", str(empty))
    assert "--poses" in _failure("map", "build", raw)
    assert "--start" in _failure("localize", str(built), raw)
    assert "outside the map" in _failure("localize", str(built), raw, "--start", "500", "0", "0")
    assert "informaton" in _failure("localize", str(built), raw, "--start", "1", "1", "0", "--config", str(broken))
    assert "empty.log" in _failure("localize", str(empty), raw, "--start", "1", "1", "0")
    assert "run.json" in _failure("info", str(tmp_path))


def test_a_grid_beyond_memory_is_refused_with_its_size(
    logs: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Whatever the machine has: on a large one, such a grid would be made, and take all of it.
    monkeypatch.setattr(grid, "_available_memory", lambda: 2**30)
    message = _failure("map", "build", str(logs[0]), "--resolution", "0.001", "-o", str(tmp_path / "fine.h5"))
    assert "GiB" in message
    assert not (tmp_path / "fine.h5").exists()


def test_the_process_ends_with_one_line_and_code_1(tmp_path: Path) -> None:
    program = "from factorloc.cli import main; main()"
    run = subprocess.run(
        [sys.executable, "-c", program, "info", str(tmp_path / "no[where].clf")], capture_output=True, text=True
    )
    assert run.returncode == 1
    assert run.stderr.startswith("error: ")
    assert "no[where].clf" in run.stderr
    assert "Traceback" not in run.stderr


def test_help_shows_examples_and_imports_nothing_heavy() -> None:
    run = subprocess.run([sys.executable, "-m", "factorloc", "--help"], capture_output=True, text=True)
    assert "factorloc demo" in run.stdout
    heavy = "import sys, factorloc.cli.app; print({'numba', 'gtsam', 'matplotlib', 'scipy'} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", heavy], capture_output=True, text=True).stdout.strip() == "set()"
