"""``factorloc localize --facades``: trajectory, bounds and picture of a drive among buildings."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from typer.testing import CliRunner

from factorloc import Trajectory
from factorloc.cli.app import app
from factorloc.errors import ConfigError
from factorloc.mapping import FacadeMap, MapUncertainty, write_facade_map
from factorloc.mapping.building_outlines import BuildingOutlines, Outline
from factorloc.result import Bounds
from factorloc.simulation import FloorPlan, PlanarLidar, Route, simulate_drive, write_carmen

HOUSES = [(-16, 6, -3, 16), (0, 7, 12, 18), (15, 6, 28, 15), (-15, -16, -1, -6), (2, -17, 13, -7), (17, -15, 30, -6)]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a facade map, the log of a drive past its houses and the truth."""
    folder = tmp_path_factory.mktemp("facades")
    houses = [shapely.box(*house) for house in HOUSES]
    drawn = [
        shapely.transform(house, lambda xy, k=k: xy + np.array([0.2 * (-1) ** k, 0.1]))
        for k, house in enumerate(houses)
    ]
    outlines = BuildingOutlines(tuple(Outline(polygon) for polygon in drawn), attribution="© surveyors")
    write_facade_map(folder / "facades.h5", FacadeMap.from_outlines(outlines, MapUncertainty(0.3, 0.05)))
    lidar = PlanarLidar(beams=361, field_of_view=np.pi)
    route = Route(((-10.0, 0.0), (20.0, 0.0)), speed=2.0)
    drive = simulate_drive(FloorPlan(tuple(houses)), route, lidar, seed=2, period=1.0)
    write_carmen(folder / "drive.clf", drive)
    drive.truth.write_tum(folder / "truth.tum")
    bounds = {"along_per_metre": 0.2, "across_per_metre": 0.1, "turn_per_metre": 0.02, "least_length": 0.1}
    bounds |= {"least_turn": 0.03}
    (folder / "settings.json").write_text(
        json.dumps({"localization": {"odometry": bounds, "feasible": {"confidence": 0.99}}})
    )
    return folder


def test_a_drive_is_tracked_among_facades(recorded: Path, tmp_path: Path) -> None:
    truth = Trajectory.read_tum(recorded / "truth.tum", planar=True)
    x, y, heading = truth.poses[0] + np.array([1.0, -0.5, 0.03])
    command = ["localize", "--facades", str(recorded / "facades.h5"), str(recorded / "drive.clf")]
    command += ["--start", f"{x:.3f}", f"{y:.3f}", f"{np.degrees(heading):.2f}", "-o", str(tmp_path / "runs")]
    command += ["--known-to", "3", "4", "--config", str(recorded / "settings.json")]
    result = CliRunner().invoke(app, command, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    assert "© surveyors" in result.output
    latest = tmp_path / "runs" / "latest"
    found = Trajectory.read_tum(latest / "tracked.tum", planar=True)
    sets = json.loads((latest / "tracked_bounds.json").read_text())
    assert len(sets) == len(found) == len(truth)
    inside = [
        Bounds(tuple(one["orientation"]), tuple(np.array(p) for p in one["polygons"])).contains(pose)
        for one, pose in zip(sets, truth.poses, strict=True)
    ]
    assert np.mean(inside) > 0.9
    assert (latest / "bounds.png").stat().st_size > 10_000
    assert json.loads((latest / "run.json").read_text())["attribution"] == "© surveyors"


@pytest.mark.parametrize(
    ("command", "word"),
    [
        (["localize", "map.h5"], "recording"),
        (["localize", "map.h5", "log.clf", "--facades", "town.osm"], "takes the place of MAP"),
        (["localize", "log.clf", "--facades", "town.osm", "--poles", "posts.geojson"], "two maps"),
    ],
)
def test_what_does_not_fit_together_gets_one_line(command: list[str], word: str) -> None:
    with pytest.raises(ConfigError, match=word):
        CliRunner().invoke(app, command, catch_exceptions=False)
