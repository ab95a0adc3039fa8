"""``factorloc localize --poles`` on a short street, written as files and read back."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from typer.testing import CliRunner

from factorloc import Trajectory
from factorloc.cli.app import app
from factorloc.errors import FactorlocError
from factorloc.mapping.pole_map import PoleMap
from factorloc.mapping.pole_map_storage import write_pole_map
from factorloc.mapping.poles import Poles
from factorloc.simulation import Pole, PoleKind, Route, Scene, simulate_drive, vlp_16, write_nclt
from factorloc.simulation.ground import Ground


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a drive of 30 m between posts, and maps of them."""
    root = tmp_path_factory.mktemp("street")
    rng = np.random.default_rng(3)
    places = [(x + float(rng.uniform(-1, 1)), side + float(rng.uniform(-1, 1)))
              for x in range(-12, 46, 6) for side in (5.0, -6.0)]  # fmt: skip
    posts = tuple(Pole(k, PoleKind.POST, x, y, 0.3, 0.0, 3.0) for k, (x, y) in enumerate(places))
    scene = Scene(Ground(shapely.box(-80, -60, 120, 60)), poles=posts)
    route = Route(((0.0, 0.0), (30.0, 0.0)), 5.0, 8.0, 1.0)
    write_nclt(root, simulate_drive(scene.world, route, vlp_16(columns=720), seed=2, period=0.125), "2012-01-08")
    n = len(places)
    poles = Poles(np.array(places), np.full(n, 0.3), np.tile([0.0, 3.0], (n, 1)), np.ones(n))
    write_pole_map(root / "posts.geojson", PoleMap.of(poles))
    write_pole_map(root / "far.geojson", PoleMap.of(poles.transformed([4.5e5, 5.4e6, 0.0])))
    return root


def run(street: Path, name: str, output: Path, *options: str):
    command = ["localize", "--poles", str(street / name), str(street / "2012-01-08"), "-o", str(output)]
    return CliRunner().invoke(app, [*command, *options])


@pytest.mark.parametrize("method", ["smoother", "mcl"])
def test_a_drive_is_localized_among_poles(street: Path, tmp_path: Path, method: str) -> None:
    options = ["--start", "1.2", "-0.8", "3", "--method", method, "--threads", "1"]
    result = run(street, "posts.geojson", tmp_path, *options)
    assert result.exit_code == 0, result.output
    name = "smoothed" if method == "smoother" else "filtered"
    found = Trajectory.read_tum(tmp_path / "latest" / f"{name}.tum", planar=True)
    assert len(found) == 31
    metrics = json.loads((tmp_path / "latest" / "metrics.json").read_text())
    assert set(metrics) == {name}
    assert np.abs(found.positions[15:, 1]).max() < 0.5
    account = json.loads((tmp_path / "latest" / "run.json").read_text())
    assert account["map"] == "posts.geojson"
    assert account["results"][name]["rejected"]["local maps without poles"] < 31
    assert (tmp_path / "latest" / "map.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("name", "options", "line"),
    [
        ("far.geojson", ["--start", "0", "0", "0"], "another coordinate system"),
        ("posts.geojson", ["--global", "--method", "mcl"], "takes the place of MAP"),
        ("nothing.geojson", ["--start", "0", "0", "0"], "nothing.geojson"),
    ],
)
def test_what_does_not_fit_is_one_line(street: Path, tmp_path: Path, name: str, options: list[str], line: str) -> None:
    result = run(street, name, tmp_path, *options)
    assert isinstance(result.exception, FactorlocError)
    assert line in str(result.exception)
