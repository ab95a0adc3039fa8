"""``factorloc map poles`` and what ``factorloc info`` says of its file."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from factorloc.cli.app import app
from factorloc.cli.pole_command import EPSILON
from factorloc.cli.pole_localization import filter_settings
from factorloc.errors import DataError, MapError
from factorloc.mapping import PoleMap, Poles, read_pole_map, write_pole_map
from factorloc.simulation import StreetSettings, hdl_32e, simulate_drive, street_route, street_scene, write_kitti

full_size = pytest.mark.skipif(
    os.environ.get("NUMBA_DISABLE_JIT", "0") != "0", reason="local maps of full size want compiled kernels"
)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short drive along a street, as a KITTI sequence; nothing is smaller than real but the number of scans."""
    folder = tmp_path_factory.mktemp("street")
    scene = street_scene(StreetSettings(), 3)
    lidar = hdl_32e(columns=1000)
    drive = simulate_drive(scene.world, street_route(), lidar, seed=3, period=0.25, keep_scans=False)
    some = slice(20, 32)  # the format holds no odometry
    part = replace(drive, scans=drive.scans[some], truth=drive.truth.select(some), odometry=drive.odometry[:0])
    write_kitti(folder, part, "00")
    return folder


def run(*arguments: str) -> str:
    result = CliRunner().invoke(app, list(arguments), catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return " ".join(result.output.split())


@full_size
def test_a_drive_becomes_a_map_with_its_place_and_picture(recorded: Path, tmp_path: Path) -> None:
    output = tmp_path / "poles.geojson"
    told = run("map", "poles", str(recorded / "sequences" / "00"), "-o", str(output), "--origin", "49", "8.4", "30")
    found = read_pole_map(output)
    assert f"{len(found)} poles" in told
    assert output.with_suffix(".png").stat().st_size > 10_000
    assert found.georeference is not None
    assert np.degrees(found.georeference.T_crs_map[2]) == pytest.approx(30)
    told = run("info", str(output))
    assert "pole map" in told
    assert "found where in view" in told


@full_size
def test_a_second_drive_tells_what_the_filter_should_expect(recorded: Path, tmp_path: Path) -> None:
    sequence, output = str(recorded / "sequences" / "00"), tmp_path / "poles.geojson"
    told = run("map", "poles", sequence, "-o", str(output), "--second", sequence, "--no-picture")
    assert "poles in view found" in told
    found = read_pole_map(output)
    told_epsilon = float(found.provenance[EPSILON])
    assert 0 < told_epsilon < 0.1
    assert filter_settings(found).epsilon == told_epsilon
    assert filter_settings(replace(found, provenance={})).epsilon == 0.1
    with pytest.raises(MapError, match="make the map again"):
        filter_settings(replace(found, provenance={EPSILON: "much"}))


@full_size
def test_poses_may_be_refined_before(recorded: Path, tmp_path: Path) -> None:
    output = tmp_path / "poles.h5"
    told = run("map", "poles", str(recorded / "sequences" / "00"), "-o", str(output), "--refine", "--no-picture")
    assert "trajectory refined by 11 motions between scans (0 failed)" in told
    assert read_pole_map(output).provenance["refined"] == "yes"


@full_size
def test_settings_may_come_from_a_file_and_finding_nothing_is_one_line(recorded: Path, tmp_path: Path) -> None:
    settings = tmp_path / "strict.toml"
    settings.write_text("[poles]\nleast_score = 0.999\nleast_height = 4.9\n", encoding="utf-8")
    with pytest.raises(MapError, match="none became a pole"):
        run("map", "poles", str(recorded / "sequences" / "00"), "--scans", "0:2", "--settings", str(settings))
    assert not Path("poles.geojson").exists()


def test_planar_recordings_are_refused() -> None:
    log = Path(__file__).parents[2] / "datasets" / "samples" / "corridor.log"
    with pytest.raises(DataError, match="found in space"):
        run("map", "poles", str(log))


def test_info_tells_our_own_file_and_published_arrays(tmp_path: Path) -> None:
    write_pole_map(tmp_path / "map.h5", PoleMap.of(Poles([[1, 2]], [0.1], [[0, 1]], [1.0])))
    assert "local coordinates only" in run("info", str(tmp_path / "map.h5"))
    np.savez(tmp_path / "map.npz", poleparams=np.eye(2))
    assert "poles 2" in run("info", str(tmp_path / "map.npz"))
