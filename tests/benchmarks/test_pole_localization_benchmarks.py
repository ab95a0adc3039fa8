"""Parts of the benchmarks of pole localization that could be wrong without a run showing it."""

import json
from pathlib import Path

import gtsam
import numpy as np
import pytest

from benchmarks import poles_kitti_simulated, poles_longterm, poles_speed, victoria_park
from benchmarks.longterm_poles import new_ground
from benchmarks.longterm_sessions import Recording, record
from factorloc.config import read_config
from factorloc.errors import DataError
from factorloc.geometry import se2, se3
from factorloc.mapping.poles import Poles


def small_world() -> poles_longterm.LongtermSettings:
    settings = read_config(poles_longterm.SETTINGS, poles_longterm.LongtermSettings)
    lidar = settings.lidar.replaced(beams=4, columns=16, spacing=60.0)
    town = settings.town.replaced(columns=1, rows_of_blocks=1)
    changes = settings.changes.replaced(route_length=100.0, survey_length=100.0)
    return settings.replaced(lidar=lidar, town=town, changes=changes)


def test_settings_are_read_and_the_world_follows_from_a_part_of_them() -> None:
    settings = read_config(poles_longterm.SETTINGS, poles_longterm.LongtermSettings)
    assert settings.sessions == 27
    assert settings.sessions * settings.changes.route_length > 27_000
    assert settings.changes.months_between * (settings.sessions - 1) == pytest.approx(15, abs=0.1)
    assert settings.lidar.beams * settings.lidar.columns <= 20_000
    assert settings.filter.particles == 5000
    # Whatever is done in the world leaves recordings as they are.
    assert settings.replaced(runs=1).world == settings.world


def test_a_recording_is_kept_and_its_scans_are_those_that_were_cast(tmp_path: Path) -> None:
    settings = small_world()
    first = record(settings.world, 1, tmp_path)
    again = record(settings.world, 1, tmp_path, lambda number: pytest.fail("was cast anew"))
    assert np.array_equal(first.ranges, again.ranges)
    scan = again.scan(1)
    assert len(scan) == 64
    assert (scan.ranges[scan.is_return] < 40).all()
    assert first.covariances.shape == (len(first) - 1, 6, 6)
    way = np.linalg.norm(first.odometry[:, :3, 3], axis=1).sum()
    true_way = np.linalg.norm(np.diff(first.truth[:, :3, 3], axis=0), axis=1).sum()
    assert way == pytest.approx(true_way, rel=0.1)


def test_new_ground_is_what_lies_off_earlier_ways() -> None:
    lidar = small_world().lidar
    truth = se3.from_se2(np.column_stack([np.arange(30.0), np.zeros(30), np.zeros(30)]))
    recording = Recording(1, lidar, truth, np.zeros((29, 4, 4)), np.zeros((29, 6, 6)), np.zeros((30, 64), np.uint16))
    assert len(new_ground(recording, np.zeros((0, 2)), 10.0)) == 30
    assert new_ground(recording, np.array([[0.0, 0.0], [9.0, 0.0]]), 10.0).tolist() == list(range(19, 30))


def test_the_longest_way_above_a_limit() -> None:
    errors = poles_longterm.Outcome()
    truth = np.zeros((6, 3))
    errors.add(np.array([[0.6, 0, 0], [0.7, 0, 0], [0.1, 0, 0], [0.8, 0, 0], [0.9, 0, 0], [0.8, 0, 0.1]]), truth, 1.0)
    assert errors.longest_above(0.5, 2.0) == 6.0
    assert errors.longest_above(1.0, 2.0) == 0.0
    mean, rmse, angle, _ = errors.row()
    assert mean == pytest.approx(0.65)
    assert rmse > mean
    assert angle == pytest.approx(np.degrees(0.1) / 6)


def test_the_park_is_read_as_a_chain() -> None:
    park = victoria_park.Park.read(gtsam.findExampleDataFile("victoria_park.txt"))
    assert len(park.motions) == 6968
    assert len(park.points) == 3640
    assert len(np.unique(park.tree_of)) == 151
    assert (np.diff(park.pose_of) >= 0).all()
    part = victoria_park.Park.read(gtsam.findExampleDataFile("victoria_park.txt"), 500)
    assert len(part.motions) == 499
    assert part.pose_of.max() < 500
    assert len(part.detections) == 500


def test_simulated_detections_have_the_rates_they_are_drawn_with(tmp_path: Path) -> None:
    settings = read_config(poles_kitti_simulated.SETTINGS, poles_kitti_simulated.SimulatedKittiSettings)
    rates = poles_kitti_simulated.Rates.read(poles_kitti_simulated.SETTINGS.with_name(settings.detection))
    rng = np.random.default_rng(1)
    poles = rng.uniform(-60, 60, (400, 2))
    pose = np.array([1.0, 2.0, 0.7])
    seen = se2.transform(se2.inverse(pose), poles)
    inside = (np.abs(seen) <= rates.side / 2).all(1).sum()
    counts = [len(rates.detect(poles, pose, rng)) for _ in range(300)]
    expected = inside * (1 - rates.miss) + rates.false * rates.side**2
    assert np.mean(counts) == pytest.approx(expected, rel=0.05)
    assert isinstance(rates.detect(np.zeros((0, 2)), pose, rng), Poles)
    with pytest.raises(DataError, match="no detection rates"):
        poles_kitti_simulated.Rates.read(tmp_path / "nothing.json")
    (tmp_path / "half.json").write_text(json.dumps({"miss_rate": 0.1}))
    with pytest.raises(DataError, match="local_map"):
        poles_kitti_simulated.Rates.read(tmp_path / "half.json")


def test_a_tenth_of_particles_is_no_goal() -> None:
    settings = read_config(poles_speed.SETTINGS, poles_speed.PoleSpeedSettings)
    assert (settings.particles, settings.poles) == (5000, 30)


@pytest.mark.data
def test_published_maps_lie_along_the_true_paths() -> None:
    from benchmarks.harness import default_data

    data = default_data()
    if data is None or not (data / "kitti_poles").is_dir():
        pytest.skip("no kitti_poles in FACTORLOC_DATA")
    for name in ("05", "06", "07"):
        sequence = poles_kitti_simulated.Sequence.read(data, name, 1.0)
        apart = np.hypot(*(sequence.poles[:, None] - sequence.truth[None, ::5, :2]).transpose(2, 0, 1)).min(1)
        assert np.median(apart) < 15
        steps = np.hypot(*np.diff(sequence.truth[:, :2], axis=0).T)
        assert np.median(steps) < 2.0
        ahead = se2.between(sequence.truth[:-1], sequence.truth[1:])
        assert np.median(ahead[:, 0]) > 0.9 * np.median(steps)
