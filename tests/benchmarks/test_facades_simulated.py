"""Localization in simulated districts: settings, a tiny run from end to end, and runs that go on."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks import facades_simulated
from benchmarks.facade_outcomes import PUBLISHED, PUBLISHED_ROWS, Outcomes, add_figures, kept
from benchmarks.facades_districts import SETTINGS as DISTRICTS
from benchmarks.facades_districts import District, DistrictSettings, districts
from benchmarks.facades_kitti0005 import SETTINGS as DRIVE
from benchmarks.facades_kitti0005 import HybridDriveSettings
from benchmarks.facades_settings import SETTINGS, SimulatedSettings
from benchmarks.facades_simulated import add_goals, main
from benchmarks.harness import Benchmark
from factorloc.config import read_config
from factorloc.result import Bounds

settings = read_config(SETTINGS, SimulatedSettings)


def test_the_goals_are_those_that_were_agreed() -> None:
    osm, lod2 = settings.kinds["osm-like"], settings.kinds["lod2-like"]
    assert (settings.start_position, settings.start_heading) == (5.0, 5.0)
    assert osm.shots["encloses"] == lod2.shots["encloses"] == (0.98, None)
    assert [osm.shots[f"{side} radius"][1] for side in ("smaller", "larger", "orientation")] == [3.2, 5.0, 2.4]
    assert [lod2.shots[f"{side} radius"][1] for side in ("smaller", "larger", "orientation")] == [1.0, 4.4, 1.8]
    for kind, table in ((osm, "II, OSM"), (lod2, "I, LOD2")):
        published = dict(zip((row for row, _ in PUBLISHED_ROWS), PUBLISHED[table], strict=True))
        for name, (least, most) in kind.tracking.items():
            assert published[name] == (least if most is None else most)


def test_settings_of_the_real_drive_are_read() -> None:
    drive = read_config(DRIVE, HybridDriveSettings)
    assert drive.shift == 2.0
    assert drive.goals["feasible sets without a pose"] == 0.0


@pytest.fixture
def tiny(monkeypatch: pytest.MonkeyPatch) -> DistrictSettings:
    places = read_config(DISTRICTS, DistrictSettings)
    places = places.replaced(
        towns=places.towns.replaced(blocks=1),
        lidar=places.lidar.replaced(columns=360),
        drives=places.drives.replaced(length=60.0, spacing=10.0),
    )

    def few(_: DistrictSettings, split: str, __: Path | None) -> Iterator[District]:
        yield replace(next(districts(places, split, None)), shot_count=2, drive_count=1)

    monkeypatch.setattr(facades_simulated, "districts", few)
    return places


@pytest.mark.usefixtures("tiny")
def test_a_tiny_run_gives_all_figures_and_goes_on_where_it_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A commit made meanwhile is other code, for which nothing that was kept is good.
    monkeypatch.setattr(facades_simulated, "commit", lambda: "the same")
    given = ["--split", "tuning", "--cache", str(tmp_path / "scans"), "--outcomes", str(tmp_path / "outcomes")]
    files = ["--json", str(tmp_path / "one.json"), "--plot", str(tmp_path / "one.png"), "--threads", "1"]
    assert main([*given, *files]) in (0, 1)
    run = json.loads((tmp_path / "one.json").read_text("utf-8"))
    figures = run["figures"]
    assert figures["poses"]["value"] == 2
    assert figures["drives"]["value"] == 1
    for part in ("shots", "tracking"):
        for kind in settings.kinds:
            assert 0 <= figures[f"{part}, {kind}: encloses"]["value"] <= 1
            assert figures[f"{part}, {kind}: smaller radius"]["value"] > 0
            assert figures[f"{part}, {kind}: bounded outside"]["value"] == 0
    assert figures["tracking, osm-like: MCL RMSE"]["value"] > 0
    assert figures["published table II, OSM: larger radius"]["value"] == 5.23
    goals = {goal["name"] for goal in run["goals"]}
    assert {"shots, osm-like: encloses", "tracking, lod2-like: bounded RMSE less MCL's"} <= goals
    parts = {path: path.stat().st_mtime_ns for path in (tmp_path / "outcomes").iterdir()}
    assert len(parts) == 2
    files[1] = str(tmp_path / "two.json")
    main([*given, *files])
    again = json.loads((tmp_path / "two.json").read_text("utf-8"))["figures"]
    assert again == figures
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "outcomes").iterdir()} == parts


def outcomes() -> Outcomes:
    square = Bounds.around(np.zeros(3), 2.0, 0.1)
    return Outcomes(
        sets=[square, Bounds((0.0, 0.1), ()), square],
        truth=[np.array([1.0, 1.0, 0.05]), np.zeros(3), np.array([3.0, 0.0, 0.0])],
        bounded=[np.array([1.0, 1.5, 0.05]), np.full(3, np.nan), np.zeros(3)],
        unbounded=[np.array([1.0, 2.0, 0.05]), np.full(3, np.nan), np.zeros(3)],
        outside=[(False, False), (False, True)],
        violated=[False, True, False],
        single=[False, True, True],
        seconds=[0.1, 0.2, 0.3],
    )


def test_an_empty_set_encloses_nothing_and_has_no_radius() -> None:
    bench = Benchmark("facades_simulated", {})
    add_figures(bench, "shots", "osm-like", outcomes(), 3.0)
    figures = {name.removeprefix("shots, osm-like: "): value for name, (value, _) in bench.figures.items()}
    assert figures["encloses"] == pytest.approx(1 / 3)
    assert figures["assumptions violated"] == pytest.approx(1 / 3)
    assert figures["smaller radius"] == figures["larger radius"] == pytest.approx(2.0)
    assert figures["bounded RMSE"] == pytest.approx(np.sqrt((0.5**2 + 3.0**2) / 2))
    assert figures["unbounded outside"] == 0.5
    add_goals(bench, "shots", "osm-like", {"encloses": (0.98, None), "smaller radius": (None, 3.2)})
    assert [goal.met for goal in bench.goals] == [False, True]


def test_kept_outcomes_are_the_same(tmp_path: Path) -> None:
    made = []

    def make() -> dict[str, Outcomes]:
        made.append(1)
        return {"osm-like": outcomes()}

    first, second = (kept(tmp_path, ("a", "b"), make)["osm-like"] for _ in range(2))
    assert made == [1]
    assert kept(None, ("a", "b"), make)["osm-like"].single == first.single
    np.testing.assert_equal(second.to_plain(), first.to_plain())
    assert second.sets[0].contains(first.truth[0])
    second.join(first)
    assert len(second.sets) == 6
