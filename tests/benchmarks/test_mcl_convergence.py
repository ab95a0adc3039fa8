"""The convergence benchmark with few places, few rays and few scans."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely

from benchmarks import mcl_convergence as benchmark
from benchmarks import mcl_outcomes
from benchmarks.tours import Roadmap, TourSettings
from factorloc.config import read_config
from factorloc.errors import ConfigError, SimulationError
from factorloc.simulation import FloorPlan, office_plan

SIZE = (30.0, 20.0)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    settings = json.loads(benchmark.SETTINGS.read_text(encoding="utf-8"))
    settings["tours"] |= {"survey": 4.0}
    settings["lidar"] |= {"beams": 61}
    settings["models"] = ["end-point"]
    settings["filter"] |= {"kld": {"least": 200, "most": 4000}, "recovery": {"probes": 50, "candidates": 2000}}
    settings["guess"] |= {"runs": 2, "scans": 12}
    settings["anywhere"] |= {"runs": 1, "scans": 6}
    path = tmp_path_factory.mktemp("mcl") / "tiny.json"
    path.write_text(json.dumps(settings), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def roadmap() -> Roadmap:
    settings = read_config(benchmark.SETTINGS, benchmark.ConvergenceSettings).tours
    return Roadmap(office_plan(), SIZE, settings, 3)


def test_tours_touch_nothing_and_begin_anywhere(roadmap: Roadmap) -> None:
    plan = office_plan()
    starts = []
    for number in range(12):
        tour = roadmap.tour(30.0, np.random.default_rng([3, number]))
        assert tour.length >= 30
        starts.append(tour.waypoints[0])
        if number < 3:
            tour.check(plan)
    assert (np.ptp(starts, axis=0) > [15, 8]).all()
    again = roadmap.tour(30.0, np.random.default_rng([3, 11]))
    assert again == tour


def test_a_survey_passes_every_place(roadmap: Roadmap) -> None:
    survey = roadmap.survey(np.random.default_rng(1))
    places = roadmap.places[np.unique(roadmap.ways[roadmap.usable])]
    apart = np.linalg.norm(places[:, None] - np.array(survey.waypoints), axis=-1).min(1)
    assert apart.max() <= roadmap.settings.survey
    assert (np.ptp(survey.waypoints, axis=0) > [25, 15]).all()


def test_a_plan_without_ways_is_refused() -> None:
    settings = TourSettings(places=50, clearance=0.1, legs=(0.8, 1.0), radius=0.3, sharpest=100, survey=1)
    cupboard = FloorPlan(walls=(shapely.LineString([(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)]),))
    with pytest.raises(SimulationError, match="ways between"):
        Roadmap(cupboard, (1.0, 1.0), settings, 1)


def test_convergence_is_to_the_end() -> None:
    assert mcl_outcomes.converged_at(np.array([False, True, True])) == 1
    assert mcl_outcomes.converged_at(np.array([True, True])) == 0
    assert mcl_outcomes.converged_at(np.array([True, False, True])) == 2
    assert mcl_outcomes.converged_at(np.array([True, True, False])) is None


def test_the_interval_is_that_of_wilson() -> None:
    """Its ends are where the share is 1.96 standard deviations of theirs away."""
    for successes, runs in ((95, 100), (99, 100), (3, 7)):
        for end in mcl_outcomes.wilson(successes, runs):
            deviation = np.sqrt(end * (1 - end) / runs)
            assert abs(successes / runs - end) == pytest.approx(1.959964 * deviation)
    assert mcl_outcomes.wilson(100, 100)[0] == pytest.approx(0.963, abs=1e-3)
    assert mcl_outcomes.wilson(100, 100)[1] == pytest.approx(1)


def test_headings_go_round() -> None:
    position, heading = mcl_outcomes.errors(np.array([[3.0, 4.0, 3.1]]), np.array([[0.0, 0.0, -3.1]]))
    assert position == pytest.approx([5])
    assert heading == pytest.approx([np.degrees(2 * np.pi - 6.2)])


def test_committed_settings_hold_the_goals() -> None:
    settings = read_config(benchmark.SETTINGS, benchmark.ConvergenceSettings)
    assert settings.success == (0.5, 5.0)
    assert (settings.guess.position, settings.guess.heading) == (2.5, 5.0)
    assert (settings.street.position, settings.street.heading) == (2.5, 5.0)
    assert (settings.guess.runs, settings.guess.scans) == (100, 50)
    assert (settings.anywhere.runs, settings.anywhere.scans) == (100, 200)
    assert settings.goals == {"guess": 99.0, "anywhere": 95.0}
    assert settings.filter.estimate == "mean"


def test_a_small_run_writes_its_report_and_its_picture(tiny: Path, tmp_path: Path) -> None:
    files = ["--json", str(tmp_path / "m.json"), "--plot", str(tmp_path / "m.svg")]
    code = benchmark.main(["--kinds", "guess", "anywhere", "--settings", str(tiny), *files])
    report = json.loads((tmp_path / "m.json").read_text(encoding="utf-8"))
    assert code == (0 if all(goal["met"] for goal in report["goals"]) else 1)
    names = [f"{kind}, end-point: converged" for kind in ("guess", "anywhere")]
    assert [goal["name"] for goal in report["goals"]] == names
    assert report["figures"]["guess, end-point: runs"]["value"] == 2
    assert report["figures"]["guess, end-point: converged"]["value"] == 100
    assert report["settings"]["scenes"]["office"]["size, m"] == [30.0, 20.0]
    assert "<svg" in (tmp_path / "m.svg").read_text(encoding="utf-8")


def test_kinds_must_exist(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert benchmark.main(["--kinds", "moon"]) == 2
    assert "moon" in capsys.readouterr().err
    with pytest.raises(ConfigError, match="legs"):
        TourSettings(places=50, clearance=0.1, legs=(0.1, 1.0), radius=0.3, sharpest=100, survey=1)
