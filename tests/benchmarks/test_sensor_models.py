"""The comparison of sensor models: its mathematics on toys, and all of it on a drive so small nobody minds the time."""

import json
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks import sensor_models
from benchmarks.filter_study import FailingLidar, Study, run_filters, starts_of
from benchmarks.held_out import ENDS, ends_of, paired_p, weigh
from benchmarks.left_out import leave_one_out, without
from benchmarks.pose_divergence import disc, from_truth, moved, to_truth
from benchmarks.sensor_model_choices import FIELD, MODELS, TrainingGrid, choose, make_model
from benchmarks.sensor_model_records import Records
from benchmarks.sensor_model_scenes import LOGS, SCENES, Motions, Scene, evenly, thinned
from factorloc.config import read_config
from factorloc.geometry import se2, se3
from factorloc.mapping import BrickStatistics, DecayRateMap, RayStatistics
from factorloc.scan import RayStatus, Scan

HALF = 2.5  # of the room's edge, m
LIMITS = (0.1, 6.0)


def scan_of_a_room(pose: np.ndarray, rng: np.random.Generator, stamp: float = 0.0, rays: int = 40) -> Scan:
    """A room with one open side: rays through it have no return."""
    angles = np.linspace(-np.pi, np.pi, rays, endpoint=False)
    c, s = np.cos(angles + pose[2]), np.sin(angles + pose[2])
    along = np.stack([c, s])
    along = np.copysign(np.maximum(abs(along), 1e-9), along)
    t = (np.copysign(HALF, along) - pose[:2, None]) / along
    ranges = np.where((t[0] < t[1]) & (c > 0), LIMITS[1], t.min(0) + rng.normal(0, 0.02, rays))
    scan = Scan.from_polar(angles, np.minimum(ranges, LIMITS[1]), LIMITS)
    return replace(scan, stamp=stamp)


def drive(count: int = 24) -> Scene:
    rng = np.random.default_rng(3)
    angle = np.linspace(0, 3, count)
    poses = np.stack([0.8 * np.cos(angle), 0.8 * np.sin(angle), angle + np.pi / 2], -1)
    scans = [scan_of_a_room(pose, rng, 0.5 * k) for k, pose in enumerate(poses)]
    statistics = RayStatistics.from_scans(scans[::2], poses[::2], resolution=0.25)
    odd = poses[1::2]
    odometry = Motions(se2.between(odd[:-1], odd[1:]), np.ones(len(odd) - 1, np.bool_))
    return Scene("room", statistics, scans[::2], poses[::2], scans[1::2], odd, odometry)


@pytest.fixture(scope="module")
def room() -> Scene:
    return drive()


@pytest.fixture(scope="module")
def pool():
    with ThreadPoolExecutor(2) as executor:
        yield executor


def test_a_planar_map_without_a_scan_is_the_map_of_the_others(room: Scene) -> None:
    left = 4
    others = [k for k in range(len(room.training)) if k != left]
    scans = [room.training[k] for k in others]
    rebuilt = RayStatistics.from_scans(scans, room.training_poses[others], grid=room.statistics.grid)
    subtracted = without(room.statistics, room.training[left], room.training_poses[left], margin=100.0)
    assert subtracted.grid == room.statistics.grid
    for name in ("hits", "misses", "path_fixed"):
        np.testing.assert_array_equal(getattr(subtracted, name), getattr(rebuilt, name))
    assert (subtracted.path_fixed < room.statistics.path_fixed).any()
    assert (subtracted.scans, subtracted.left_out) == (rebuilt.scans, rebuilt.left_out)


def test_the_part_of_a_map_that_rays_reach_gives_the_likelihood_of_the_whole(room: Scene) -> None:
    scan, pose = room.training[4], room.training_poses[4]
    narrow = replace(scan.select(np.arange(5)), stamp=0.0)
    statistics = RayStatistics.from_scans([*room.training, narrow], [*room.training_poses, pose], resolution=0.25)
    part, whole = without(statistics, narrow, pose), without(statistics, narrow, pose, margin=100.0)
    assert part.grid.cells < whole.grid.cells
    prior = make_model("DEC FMP", room, _choices()).prior
    expected = DecayRateMap(whole, prior, 0.01).log_likelihood(narrow, pose)
    np.testing.assert_allclose(DecayRateMap(part, prior, 0.01).log_likelihood(narrow, pose), expected, rtol=1e-9)


def test_a_sparse_map_without_a_scan_is_the_map_of_the_others() -> None:
    rng = np.random.default_rng(5)
    scans = [Scan.from_points(rng.uniform(-4, 4, (30, 3)), (0.1, 20.0)) for _ in range(4)]
    poses = se3.exp(rng.normal(size=(4, 6)) * [0.1, 0.1, 1, 2, 2, 0.2])
    whole = BrickStatistics.from_scans(scans, poses, resolution=0.5)
    rebuilt = BrickStatistics.from_scans(scans[1:], poses[1:], grid=whole.grid)
    subtracted = without(whole, scans[0], poses[0])
    assert isinstance(subtracted, BrickStatistics)
    assert len(subtracted.keys) < len(whole.keys)
    for name in ("keys", "hits", "misses", "path_fixed"):
        np.testing.assert_array_equal(getattr(subtracted, name), getattr(rebuilt, name))
    assert subtracted.scans == 3


def test_leaving_one_out_sums_over_the_scans_and_their_rays(room: Scene, pool: ThreadPoolExecutor) -> None:
    prior = make_model("DEC FMP", room, _choices()).prior
    rows = [1, 5]
    scans, poses = [room.training[k] for k in rows], room.training_poses[rows]
    floors = (0.1, 1.0)
    families = {"DEC": lambda map_: [(floor, DecayRateMap(map_, prior, floor)) for floor in floors]}
    found = leave_one_out(room.statistics, scans, poses, families, pool)
    for floor in floors:
        maps = [without(room.statistics, scan, pose) for scan, pose in zip(scans, poses, strict=True)]
        each = [DecayRateMap(m, prior, floor).log_likelihood(s, p) for m, s, p in zip(maps, scans, poses, strict=True)]
        assert found["DEC"][floor] == pytest.approx(np.concatenate(each).mean())


def test_the_most_likely_is_chosen(room: Scene, pool: ThreadPoolExecutor) -> None:
    grid = TrainingGrid(
        decay_floors=(1e-9, 0.03, 100.0), reflection_floors=(1e-9, 0.01, 0.5), end_point_sigmas=(1.0, 50.0),
        unseen_rates=(0.1, 50.0), unseen_reflections=(0.1, 0.99),
        noise_sigmas=(0.05, 0.2), false_rates=(0.01,),
    )  # fmt: skip
    made = choose(room, grid, 6, 100, pool)
    assert (made.decay_floor, made.reflection_floor) == (0.03, 0.01)
    assert made.unseen_rate == 0.1  # rays through the open side leave the map; the mean of the prior stops them all
    assert (made.end_point_sigma, made.noise_sigma, made.false_rate) == (0.25, 0.05, 0.01)
    assert made.scores["DEC"]["0.03"] == max(made.scores["DEC"].values())
    floored, bare = (make_model(f"DEC {form}", room, made) for form in ("MLM", "MLM without floor"))
    assert (floored.floor, bare.floor) == (0.03, 0.0)
    assert make_model(FIELD, room, made).sigma == 0.25


def test_unseen_space_has_its_own_prior(room: Scene) -> None:
    plain, other = (make_model(f"DEC {form}", room, _choices()) for form in ("FMP", "FMP, best in unseen space"))
    seen = room.statistics.path_fixed > 0
    np.testing.assert_array_equal(other.mean[seen], plain.mean[seen])
    np.testing.assert_allclose(other.mean[~seen], 0.2)
    assert other.prior.mean == pytest.approx(0.2)
    plain, other = (make_model(f"REF {form}", room, _choices()) for form in ("FMP", "FMP, best in unseen space"))
    seen = room.statistics.visits > 0
    np.testing.assert_array_equal(other.mean[seen], plain.mean[seen])
    np.testing.assert_allclose(other.mean[~seen], 0.3)
    assert make_model("DEC MLM, best in unseen space", room, _choices()).rates[~seen] == pytest.approx(0.1)


def test_rays_are_told_apart_by_their_ends(room: Scene) -> None:
    statistics = room.statistics
    hit = np.argwhere(statistics.hits > 0)[0]
    free = np.argwhere((statistics.hits == 0) & (statistics.misses > 0))[0]
    unseen = np.argwhere(statistics.path_fixed == 0)[0]
    centres = np.array([[statistics.grid.centres(axis)[cell[axis]] for axis in (0, 1)] for cell in (hit, free, unseen)])
    pose = np.array([0.01, 0.02, 0.3])
    points = np.vstack([se2.transform(se2.inverse(pose), centres), [[1000.0, 0.0]], [[90.0, 90.0]]])
    scan = Scan.from_points(points, (0.001, 500.0))
    assert ends_of(statistics, scan, pose).tolist() == [0, 1, 2, 3, 2]


def test_held_out_scans_are_added_up(room: Scene, pool: ThreadPoolExecutor) -> None:
    rows = np.array([0, 3])
    ends = [ends_of(room.statistics, room.held_out[k], room.poses[k]) for k in rows]
    model = make_model("DEC FMP", room, _choices())
    found = weigh(model, room, rows, ends, pool)
    each = [model.log_likelihood(room.held_out[k], room.poses[k]) for k in rows]
    assert found.mean == pytest.approx(np.concatenate(each).mean())
    assert found.nats == pytest.approx([values.mean() for values in each])
    assert found.of_ends[3] == pytest.approx(sum(v[k == 3].sum() for v, k in zip(each, ends, strict=True)))
    assert sum(found.counts) == 80
    assert len(found.counts) == len(ENDS)
    bare = weigh(make_model("DEC MLM without floor", room, _choices()), room, rows, ends, pool)
    assert sum(bare.impossible) == bare.counts[1]  # exactly the returns from seen cells without hits
    assert (bare.mean == -math.inf) == (bare.counts[1] > 0)


def test_paired_tests() -> None:
    rng = np.random.default_rng(1)
    worse = rng.normal(size=200)
    assert paired_p(worse + rng.normal(0.3, 1, 200), worse) < 0.01
    assert paired_p(worse, worse + rng.normal(0.3, 1, 200)) > 0.99
    assert math.isnan(paired_p(worse, worse))
    # What neighbours have in common is not counted as often as it is seen.
    common = np.repeat(rng.normal(0.3, 1, 10), 20)
    assert paired_p(common + worse, worse) < 1e-4 < paired_p(common + worse, worse, 20)
    assert math.isnan(paired_p(worse[:30], worse[1:31], 20))


def test_divergences_of_a_normal_likelihood() -> None:
    rng = np.random.default_rng(2)
    radius, s, sigma = 2.0, 0.2, 0.35
    offsets = disc(400_000, radius, rng)
    assert np.hypot(*offsets.T).max() <= radius
    np.testing.assert_allclose((offsets**2).sum(1).mean(), radius**2 / 2, rtol=0.01)  # uniform over the area
    logs = -0.5 * (offsets**2).sum(1) / s**2 - 1234.0
    # Of normal distributions: 2 log(sigma/s) + (s/sigma)^2 - 1; sums over samples lack log(count / area).
    exact = 2 * np.log(sigma / s) + (s / sigma) ** 2 - 1
    count_of_area = np.log(len(offsets) / (np.pi * radius**2))
    assert to_truth(logs, offsets, sigma) + count_of_area == pytest.approx(exact, abs=0.01)
    assert from_truth(logs, offsets, sigma) == pytest.approx(2 * np.log(s / sigma) + (sigma / s) ** 2 - 1, abs=0.02)
    assert from_truth(logs, offsets, s) == pytest.approx(0.0, abs=1e-9)


def test_divergences_where_poses_are_impossible() -> None:
    offsets = np.array([[0.0, 0.0], [1.0, 0.0]])
    assert math.isnan(to_truth(np.full(2, -np.inf), offsets, 1.0))
    assert math.isnan(from_truth(np.full(2, -np.inf), offsets, 1.0))
    assert to_truth(np.array([-5.0, -np.inf]), offsets, 1.0) == pytest.approx(np.log(2 * np.pi))
    assert from_truth(np.array([-5.0, -np.inf]), offsets, 1.0) == math.inf


def test_poses_are_moved_in_the_map() -> None:
    offsets = np.array([[1.0, 2.0], [0.0, -1.0]])
    pose = np.array([3.0, 4.0, 1.0])
    np.testing.assert_allclose(moved(pose, offsets), [[4.0, 6.0, 1.0], [3.0, 3.0, 1.0]])
    spatial = se3.exp(np.array([0.1, 0.2, 1.0, 3, 4, 5]))
    found = moved(spatial, offsets)
    np.testing.assert_allclose(found[:, :3, 3] - spatial[:3, 3], [[1, 2, 0], [0, -1, 0]])
    np.testing.assert_array_equal(found[:, :3, :3], [spatial[:3, :3]] * 2)


def test_failing_rays_are_the_same_for_all_models(room: Scene) -> None:
    scan = room.held_out[2]
    first = FailingLidar(make_model("DEC FMP", room, _choices()), 0.1, 7).failed(scan)
    second = FailingLidar(make_model("REF FMP", room, _choices()), 0.1, 7).failed(scan)
    assert (first.status == RayStatus.BELOW_MINIMUM).sum() == 4
    np.testing.assert_array_equal(first.status, second.status)
    assert set(first.ranges[first.status == RayStatus.BELOW_MINIMUM]) == {LIMITS[0]}
    other = FailingLidar(make_model("DEC FMP", room, _choices()), 0.1, 7).failed(room.held_out[3])
    assert (first.status != other.status).any()


def test_runs_begin_at_evenly_spread_places() -> None:
    assert starts_of(100, 20, 5).tolist() == [0, 20, 40, 60, 80]
    assert starts_of(10, 20, 3).tolist() == [0, 0, 0]
    assert evenly(10, 0).tolist() == list(range(10))
    assert evenly(10, 5).tolist() == [1, 3, 5, 7, 9]
    assert len(evenly(7, 100)) == 7


def test_a_filter_finds_its_way_and_repeats_itself(room: Scene, pool: ThreadPoolExecutor) -> None:
    settings = _settings().filters
    study, start = Study(particles=200, scans=8), (0.2, 0.1, 0.1)
    model = make_model("DEC FMP", room, _choices())
    errors = np.array(run_filters(model, room, study, settings, start, 3, 11, pool))
    assert errors.shape == (3, 8)
    assert errors[:, -3:].mean() < 0.2
    np.testing.assert_array_equal(errors, run_filters(model, room, study, settings, start, 3, 11, pool))
    assert study.name == "200 particles"
    assert Study(particles=3, scans=2, failures=True, tempering=0.02).name == "3 particles, failures, tempering 0.02"


def test_odometry_in_space_has_the_noise_it_is_said_to_have() -> None:
    poses = se3.exp(np.outer(np.arange(2000.0), [0, 0, 0.01, 0.1, 0, 0]))
    noise = np.array([0.01, 0.01, 0.01, 0.05, 0.05, 0.05])
    scene = Scene("space", RayStatistics.empty(_cube()), [], poses, [], poses, None, noise)
    given = scene.motions(5, 1905, np.random.default_rng(1))
    errors = se3.log(se3.between(se3.between(poses[5:1904], poses[6:1905]), given.motions))
    np.testing.assert_allclose(errors.std(0), noise, rtol=0.1)
    np.testing.assert_allclose(given.covariances[0], np.diag(noise**2))
    assert given.known.all()


def test_spatial_scans_are_thinned() -> None:
    scan = Scan.from_points(np.random.default_rng(1).normal(size=(100, 3)), (0.0, 50.0))
    assert len(thinned(scan, 30)) == 30
    assert len(thinned(scan, 300)) == 100


def test_records_are_taken_up_only_with_the_same_settings(tmp_path: Path) -> None:
    path, names = tmp_path / "r.json", []
    first = Records(path, {"a": 1}, names.append)
    assert first.get("x", lambda: [1.0, math.inf]) == [1.0, math.inf]
    assert Records(path, {"a": 1}, names.append).get("x", lambda: pytest.fail("made again")) == [1.0, math.inf]
    assert Records(path, {"a": 2}, names.append).get("x", lambda: 3) == 3
    assert names == ["x"] * 3
    first.discard()
    assert not path.exists()


def test_committed_settings() -> None:
    settings = _settings()
    assert settings.gain == 0.0
    assert set(settings.full.scenes) == set(SCENES) == {*LOGS, "0005"}
    assert settings.full.held_out == 0
    assert settings.full.runs >= 10
    assert {(s.particles, s.failures) for s in settings.filters.studies} >= {(300, False), (300, True), (3000, False)}
    assert settings.figure.start == (0.1, 0.1, 0.1)


def test_no_data_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert sensor_models.main(["--scenes", "nowhere", "--json", str(tmp_path / "s.json")]) == 2
    assert "unknown; take some of aces" in capsys.readouterr().err


def test_a_whole_run_on_a_tiny_drive(
    room: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    values = json.loads(sensor_models.SETTINGS.read_text(encoding="utf-8"))
    values["training"] = {
        "decay_floors": [0.01], "reflection_floors": [0.01], "unseen_rates": [0.1], "unseen_reflections": [0.1],
        "end_point_sigmas": [1.0], "noise_sigmas": [0.05], "false_rates": [0.01],
    }  # fmt: skip
    values["divergence"] |= {"wide_samples": 8, "narrow_samples": 8}
    values["filters"]["studies"] = [{"particles": 30, "scans": 3}, {"particles": 30, "scans": 3, "failures": True}]
    values["figure"] |= {"scenes": ["intel"], "particles": 30, "scans": 3}
    values["block"] = 4
    values["full"] = {
        "scenes": ["intel"], "training_scans": 2, "held_out": 0, "divergence_scans": 2, "runs": 2, "directions": 1
    }  # fmt: skip
    (tmp_path / "tiny.json").write_text(json.dumps(values), encoding="utf-8")
    monkeypatch.setattr(sensor_models, "open_scene", lambda *_: room)
    smoothed = {"decay-rate": {"tracked": 0.1, "smoothed": 0.05, "rotation": 0.2, "seconds": 0.001}}
    monkeypatch.setattr(sensor_models, "smoothers", lambda *_: smoothed)
    files = ["--json", str(tmp_path / "s.json"), "--plot", str(tmp_path / "s.svg")]
    code = sensor_models.main(["--settings", str(tmp_path / "tiny.json"), *files])
    said = capsys.readouterr().out
    report = json.loads((tmp_path / "s.json").read_text(encoding="utf-8"))
    assert code == (0 if all(goal["met"] for goal in report["goals"]) else 1)
    assert [goal["name"] for goal in report["goals"]] == [f"intel, {k}: gain of FMP per ray" for k in ("REF", "DEC")]
    figures = {name: figure["value"] for name, figure in report["figures"].items()}
    gain = figures["intel, DEC FMP: nats per ray"] - figures["intel, DEC MLM: nats per ray"]
    assert figures["intel, DEC: gain of FMP"] == pytest.approx(gain)
    parts = [figures[f"intel, DEC: gain of FMP, part of '{end}'"] for end in ENDS]
    assert sum(parts) == pytest.approx(gain)
    assert figures["intel, 30 particles, failures, end point: position error"] > 0
    assert (
        figures["all, 30 particles, DEC FMP: position error"] == figures["intel, 30 particles, DEC FMP: position error"]
    )
    assert figures["intel, figure 8.3, DEC FMP: position error"] < 0.5
    assert figures["intel, decay-rate: smoothed"] == 0.05
    assert "published: Campus" in said
    assert set(report["settings"]["seconds (wall, processor)"]) >= {f"intel/{model}" for model in MODELS}
    assert "<svg" in (tmp_path / "s.svg").read_text(encoding="utf-8")
    assert not (tmp_path / "s.parts.json").exists()


def _settings() -> sensor_models.Settings:
    return read_config(sensor_models.SETTINGS, sensor_models.Settings)


def _choices():
    from benchmarks.sensor_model_choices import Choices

    return Choices(
        decay_floor=0.01, reflection_floor=0.01, unseen_rate=0.1, unseen_reflection=0.1, posterior_unseen_rate=0.2,
        posterior_unseen_reflection=0.3, end_point_sigma=0.25, noise_sigma=0.05, false_rate=0.01, scores={},
    )  # fmt: skip


def _cube():
    from factorloc.mapping import Grid

    return Grid((0.0, 0.0, 0.0), 1.0, (2, 2, 2))
