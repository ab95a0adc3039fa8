"""``factorloc map facades`` and ``info``: what they write and say."""

from __future__ import annotations

import json
import logging
import warnings
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from factorloc.cli.app import app
from factorloc.errors import ConfigError, DataError
from factorloc.mapping import read_facade_map

pytest.importorskip("pyogrio")


@pytest.fixture(autouse=True)
def quiet_logging() -> Iterator[None]:
    package = logging.getLogger("factorloc")
    before = package.handlers[:], package.level, package.propagate
    yield
    package.handlers[:], package.level, package.propagate = before


@pytest.fixture
def houses(tmp_path: Path) -> Path:
    """Two houses that share a wall, as an export of OpenStreetMap."""
    a, b = 2e-4, 1e-4
    rows = [
        {
            "type": "Feature",
            "properties": {"osm_id": str(k), "building": "yes", "height": "9"},
            "geometry": {
                "type": "Polygon",
                "coordinates": [[[8.4 + x, 49.0], [8.4 + x + a, 49.0], [8.4 + x + a, 49.0 + b], [8.4 + x, 49.0 + b], [8.4 + x, 49.0]]],  # noqa: E501
            },
        }
        for k, x in enumerate((0.0, a))
    ]  # fmt: skip
    path = tmp_path / "houses.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": rows}))
    return path


def run(*words: object) -> str:
    result = CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def test_a_facade_map_is_written_drawn_and_described(houses: Path, tmp_path: Path) -> None:
    target = tmp_path / "facades.h5"
    said = run("map", "facades", houses, "-o", target, "--shift", 1.5, "--vertex-error", 0.2)
    assert "6 facades of 2 buildings" in said
    assert "© OpenStreetMap contributors, ODbL" in said
    assert target.with_suffix(".png").stat().st_size > 10_000
    made = read_facade_map(target)
    assert (made.uncertainty.shift, made.uncertainty.vertex) == (1.5, 0.2)
    described = run("info", target)
    for word in ("facade map", "shift 1.5 m", "OpenStreetMap", "2 walls between buildings", "exact"):
        assert word in described


def test_geojson_goes_in_and_out_with_its_attribution(houses: Path, tmp_path: Path) -> None:
    target = tmp_path / "facades.geojson"
    run("map", "facades", houses, "-o", target, "--no-picture", "--attribution", "© the town")
    assert not target.with_suffix(".png").exists()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        described = run("info", target)
    assert "building map" in described
    assert "© the town" in described
    assert "6 shapes without an area" in described


def test_faults_are_one_line(houses: Path, tmp_path: Path) -> None:
    runner = CliRunner()
    wrong = runner.invoke(app, ["map", "facades", str(houses), "-o", str(tmp_path / "facades.png")])
    assert isinstance(wrong.exception, ConfigError)
    missing = runner.invoke(app, ["map", "facades", str(tmp_path / "none.osm")])
    assert isinstance(missing.exception, DataError)
    assert "none.osm: no such file" in str(missing.exception)
