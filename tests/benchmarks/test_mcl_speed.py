"""The benchmark of weighing particles: all competitors compute the same, and a run says what it should."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import mcl_speed, particle_weights
from benchmarks.harness import Benchmark
from benchmarks.particle_weights import (
    BRICKS,
    DECAY,
    FIELD,
    OWN,
    PLAIN,
    REFLECTION,
    TREE,
    all_weighers,
    check_agreement,
)
from benchmarks.particle_weights_scenes import GLOBAL, TRACKING, Drive, Scene, load_drive, make_scene
from benchmarks.returns import OFFICE
from factorloc.config import read_config
from factorloc.errors import ConfigError, DataError, MapError
from factorloc.geometry import se3
from factorloc.scan import RayStatus, Scan

NEAR = (0.5, 0.1)


@pytest.fixture(scope="module")
def office() -> Scene:
    return make_scene(load_drive(None, OFFICE, 12), 0.1, 2)


@pytest.fixture(scope="module")
def room() -> Scene:
    """Four scans of a room of about 20 by 12 by 4 m, some rays without return."""
    rng = np.random.default_rng(1)
    half = np.array([10.07, 6.03, 2.11])
    poses = np.tile(np.eye(4), (4, 1, 1))
    poses[:, :3, 3] = rng.uniform(-1, 1, (4, 3))
    scans = []
    for pose in poses:
        directions = rng.standard_normal((500, 3))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        walls = ((np.sign(directions) * half - pose[:3, 3]) / directions).min(1)
        none = rng.random(len(walls)) < 0.1
        status = np.where(none, RayStatus.NO_RETURN, RayStatus.RETURN).astype(np.uint8)
        scans.append(Scan(directions, np.where(none, 30.0, walls), status, (0.5, 30.0)))
    return make_scene(Drive("street", "room", scans, poses), 0.2, 2)


@pytest.mark.parametrize("spread", [TRACKING, GLOBAL])
def test_all_weighers_agree(office: Scene, spread: str) -> None:
    weighers = all_weighers(office, 0.01, 2)
    assert {weigher.threads for weigher in weighers} == {1, 2}
    for query in office.queries(spread, 200, 60, NEAR, np.random.default_rng(1)):
        assert len(query.scan) == 60
        check_agreement(weighers, query)
        tree = next(weigher for weigher in weighers if weigher.label == TREE)
        own = next(weigher for weigher in weighers if weigher.kind == FIELD)
        # What the tree is timed with differs from the field by the ends' places in their cells alone.
        assert np.corrcoef(tree.weigh(query), own.weigh(query))[0, 1] > 0.99
    assert all(weigher.table_bytes > 0 for weigher in weighers)


def test_weighers_in_space_agree(room: Scene) -> None:
    weighers = all_weighers(room, 0.01, 1)
    assert {weigher.label for weigher in weighers} == {OWN, BRICKS, PLAIN}
    query = room.queries(TRACKING, 30, 200, (3.0, 1.0), np.random.default_rng(1))[0]
    check_agreement(weighers, query)
    # Rays that begin outside of the map and never meet it, too.
    far = query.poses.copy()
    far[:15, :3, 3] += [0.0, 0.0, 100.0]
    far[15:, :3, 3] += [12.0, 0.0, 0.0]
    check_agreement(weighers, replace(query, poses=far))


@pytest.mark.parametrize("kind", [FIELD, DECAY, REFLECTION])
def test_a_weigher_that_is_wrong_is_found(office: Scene, kind: str) -> None:
    weighers = [weigher for weigher in all_weighers(office, 0.01, 1) if weigher.kind == kind]
    query = office.queries(TRACKING, 50, 60, NEAR, np.random.default_rng(1))[0]
    moved = replace(query, poses=query.poses + np.array([0.02, 0.0, 0.0]))
    plain = next(weigher for weigher in weighers if weigher.label == PLAIN)
    wrong = replace(plain, label="wrong", weigh=lambda _: plain.weigh(moved))
    with pytest.raises(MapError, match=f"{kind}: wrong"):
        check_agreement([*weighers, wrong], query)


def test_particles_lie_where_they_should(office: Scene, room: Scene) -> None:
    rng = np.random.default_rng(1)
    near, everywhere = (office.queries(spread, 500, 180, NEAR, rng)[0].poses for spread in (TRACKING, GLOBAL))
    distance = np.linalg.norm(near[:, :2] - office.poses[0, :2], axis=1)
    assert 0.3 < np.median(distance) < distance.max() <= NEAR[0]
    turn = np.angle(np.exp(1j * (near[:, 2] - office.poses[0, 2])))
    assert 0.05 < np.abs(turn).max() <= NEAR[1]
    cells = np.floor((everywhere[:, :2] - office.statistics.grid.origin) / 0.1).astype(int)
    assert (office.statistics.misses[tuple(cells.T)] > 0).all()  # type: ignore[index]
    assert (office.statistics.hits[tuple(cells.T)] == 0).all()  # type: ignore[index]
    spatial = room.queries(TRACKING, 200, 100, NEAR, rng)[0]
    motion = se3.between(np.tile(room.poses[0], (200, 1, 1)), spatial.poses)
    assert np.linalg.norm(motion[:, :3, 3], axis=1).max() <= NEAR[0]
    assert np.abs(np.linalg.norm(se3.log(motion)[:, :3], axis=1)).max() <= NEAR[1]
    assert spatial.particle_returns < spatial.particle_beams == 200 * 100


def test_the_map_is_made_of_other_scans() -> None:
    drive = load_drive(None, OFFICE, 7)
    scene = make_scene(drive, 0.1, 10)
    assert scene.statistics.scans == 4
    assert [scan.stamp for scan in scene.scans] == [drive.scans[k].stamp for k in (1, 3, 5)]
    with pytest.raises(DataError, match="no real data"):
        load_drive(None, "0005")


def test_a_call_of_the_tree_takes_its_arrays(office: Scene) -> None:
    weighers = {weigher.name: weigher for weigher in all_weighers(office, 0.01, 1)}
    query = office.queries(TRACKING, 500, 180, NEAR, np.random.default_rng(1))[0]
    ends = 500 * int(query.scan.is_return.sum())
    tree = mcl_speed.arrays_of_a_call(weighers[f"{FIELD}: {TREE}"], query)
    assert tree * 2**20 > ends * 16
    assert mcl_speed.arrays_of_a_call(weighers[f"{FIELD}: {OWN}"], query) < tree / 10


def test_a_goal_without_competitor_is_an_error() -> None:
    settings = read_config(mcl_speed.SETTINGS, mcl_speed.SpeedSettings)
    bench = Benchmark("mcl_speed", {})
    mcl_speed.summarize(bench, settings)
    assert not bench.goals, "of a drive in space alone the likelihood field is not timed"
    for wrong in (f"{DECAY} / beluga", f"ray casting / {PLAIN}"):
        with pytest.raises(ConfigError, match="no such competitor"):
            mcl_speed.summarize(bench, settings.replaced(goals={wrong: 0.5}))


def test_goals_take_the_worst_case_apart_in_plane_and_space() -> None:
    settings = read_config(mcl_speed.SETTINGS, mcl_speed.SpeedSettings)
    bench = Benchmark("mcl_speed", {})
    for case, value in (("a", 0.3), ("b", 0.7), ("street, 0.2 m", 0.9)):
        bench.figure(f"{case}: {DECAY}: {mcl_speed.TIME}, factorloc / {PLAIN}", value, "1")
        bench.figure(f"{case}: {FIELD}: {mcl_speed.TIME}, factorloc / {TREE}", value / 10, "1")
    mcl_speed.summarize(bench, settings)
    goals = {goal.name: goal for goal in bench.goals}
    assert goals[f"{DECAY} in the plane, time / {PLAIN}, worst of 2"].value == 0.7
    assert not goals[f"{DECAY} in space, time / {PLAIN}, worst of 1"].met


def test_a_quick_run_writes_its_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    settings = json.loads(mcl_speed.SETTINGS.read_text(encoding="utf-8"))
    small = {"particles": [20, 30], "beams": [30, 60], "resolutions": [0.1], "queries": 2}
    (tmp_path / "small.json").write_text(json.dumps({**settings, **small}), encoding="utf-8")
    files = ["--json", str(tmp_path / "a.json"), "--plot", str(tmp_path / "a.svg")]
    options = ["--log", OFFICE, "--scans", "10", "--rounds", "1", "--settings", str(tmp_path / "small.json")]
    code = mcl_speed.main(["--quick", *options, *files])
    report: dict[str, Any] = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    assert code == (0 if all(goal["met"] for goal in report["goals"]) else 1)
    assert len(report["goals"]) == 2
    speeds = {name for name in report["figures"] if name.startswith("office, 0.1 m, tracking, 30 x 60: ")}
    assert f"office, 0.1 m, tracking, 30 x 60: {DECAY}: {PLAIN}" in speeds
    assert not [name for name in report["figures"] if "20 x" in name]
    assert report["figures"]["peak resident memory of the run"]["value"] > 50
    assert "<svg" in (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert "reflection posterior" in capsys.readouterr().out


def test_dense_rates_are_refused_where_they_do_not_fit(room: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(needed: int, what: str) -> None:
        raise MapError(f"{what}: {needed}")

    monkeypatch.setattr(particle_weights, "require_memory", refuse)
    with pytest.raises(MapError, match="dense grid"):
        all_weighers(room, 0.01, 1)
