"""``factorloc localize --method mcl``: the same files as the smoother's, from particles."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from factorloc import Trajectory
from factorloc.cli.app import app
from factorloc.errors import ConfigError, FactorlocError
from factorloc.mapping import RayStatistics, write_map
from factorloc.simulation import PlanarLidar, office_plan, office_routes, simulate_drive, write_carmen


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a map, the log of a second drive and its truth."""
    folder = tmp_path_factory.mktemp("mcl")
    plan, (first, second) = office_plan(), office_routes()
    lidar = PlanarLidar(beams=181, field_of_view=np.pi)
    mapped = simulate_drive(plan, first, lidar, seed=1, period=1.0)
    write_map(folder / "office.h5", RayStatistics.from_scans(mapped.scans, mapped.truth.poses))
    drive = simulate_drive(plan, second, lidar, seed=2, period=1.0)
    write_carmen(folder / "second.clf", drive)
    drive.truth.write_tum(folder / "truth.tum")
    return folder


def localize(recorded: Path, output: Path, *options: str) -> Path:
    command = ["localize", str(recorded / "office.h5"), str(recorded / "second.clf"), "--method", "mcl"]
    command += ["--scans", "0:25", "--no-plots", "-o", str(output), *options]
    result = CliRunner().invoke(app, command, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    assert "filtered" in result.output
    return output / "latest"


@pytest.mark.parametrize("model", ["decay-rate", "reflection-posterior", "end-point"])
def test_a_drive_is_filtered_from_a_wrong_start(recorded: Path, tmp_path: Path, model: str) -> None:
    truth = Trajectory.read_tum(recorded / "truth.tum", planar=True).select(slice(0, 25))
    x, y, heading = truth.poses[0] + [0.8, -0.6, 0.1]
    start = ["--start", f"{x:.3f}", f"{y:.3f}", f"{np.degrees(heading):.2f}"]
    options = ["--particles", "5000", "--model", model, "--seed", "3", "--poses", str(recorded / "truth.tum")]
    latest = localize(recorded, tmp_path / "runs", *start, *options)
    found = Trajectory.read_tum(latest / "filtered.tum", planar=True)
    assert np.hypot(*(found.positions - truth.positions)[10:].T).max() < 0.2
    assert np.load(latest / "filtered_covariances.npy", allow_pickle=False).shape == (25, 3, 3)
    assert set(json.loads((latest / "metrics.json").read_text())) == {"filtered"}
    account = json.loads((latest / "run.json").read_text())
    assert account["results"]["filtered"]["rejected"]["resamplings"] > 0
    assert (account["method"], account["model"], account["seed"]) == ("mcl", model, 3)
    settings = json.loads((latest / "settings.json").read_text())
    assert settings["kld"]["most"] == 5000
    again = localize(recorded, tmp_path / "again", *start, *options, "--config", str(latest / "settings.json"))
    assert (again / "filtered.tum").read_text() == (latest / "filtered.tum").read_text()


def test_the_start_may_be_unknown(recorded: Path, tmp_path: Path) -> None:
    latest = localize(recorded, tmp_path / "runs", "--global", "--model", "end-point", "--particles", "3000")
    assert json.loads((latest / "run.json").read_text())["results"]["filtered"]["poses"] == 25
    assert not (latest / "metrics.json").exists()


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (["--global"], "--global"),
        (["--global", "--method", "mcl", "--start", "1", "1", "0"], "--global"),
        (["--method", "mcl", "--start", "500", "0", "0"], "outside the map"),
        (["--method", "mcl"], "--start"),
        (["--method", "mcl", "--model", "sonar", "--start", "1", "1", "0"], "sonar"),
    ],
)
def test_what_does_not_fit_is_one_line(recorded: Path, tmp_path: Path, options: list[str], line: str) -> None:
    command = ["localize", str(recorded / "office.h5"), str(recorded / "second.clf"), "-o", str(tmp_path), *options]
    result = CliRunner().invoke(app, command)
    assert isinstance(result.exception, FactorlocError), result.output
    assert line in str(result.exception)
    assert "\n" not in str(result.exception)


def test_settings_of_the_smoother_are_none_of_the_filter(recorded: Path, tmp_path: Path) -> None:
    config = tmp_path / "settings.toml"
    config.write_text("smoothing_blur = 0.5\n")
    command = ["localize", str(recorded / "office.h5"), str(recorded / "second.clf"), "--method", "mcl"]
    result = CliRunner().invoke(app, [*command, "--start", "1", "1", "0", "--config", str(config)])
    assert isinstance(result.exception, ConfigError)
    assert "smoothing_blur" in str(result.exception)
