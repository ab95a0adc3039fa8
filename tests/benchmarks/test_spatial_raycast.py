"""The spatial part of the raycast benchmark: its returns, and that all walks compute the same."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks import raycast, spatial_walks
from benchmarks.bars import Bar, plot_columns
from benchmarks.harness import Arguments, Benchmark
from benchmarks.reference import build_reference
from benchmarks.spatial_returns import DRIVE_0005, RANGE, STREET, SpatialDrive, load_spatial_drive, spatial_returns
from benchmarks.spatial_walks import NEW_ARRAYS, all_spatial_walks
from factorloc.errors import DataError, MapError
from factorloc.mapping import RayStatistics
from factorloc.scan import Scan


@pytest.fixture(scope="module")
def drive() -> SpatialDrive:
    """Two scans of a room of about 20 by 12 by 4 m, in general position."""
    rng = np.random.default_rng(1)
    half = np.array([10.07, 6.03, 2.11])
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[:, :3, 3] = [(-1.03, 0.51, 0.217), (1.31, -0.72, -0.193)]
    scans = []
    for pose in poses:
        directions = rng.standard_normal((2_000, 3))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        walls = ((np.sign(directions) * half - pose[:3, 3]) / directions).min(1)
        scans.append(Scan(directions, walls, np.zeros(len(walls), np.uint8), (0.5, RANGE)))
    return SpatialDrive("room", tuple(scans), poses)


def arguments(data: Path | None, **options: Any) -> Arguments:
    return Arguments(data, True, Path("a.json"), Path("a.png"), 1, {"scans": 0, "resolution": 0.0, **options})


@pytest.mark.parametrize("resolution", [0.2, 0.5])
def test_all_spatial_walks_agree(drive: SpatialDrive, resolution: float) -> None:
    returns = spatial_returns(drive, 1, resolution)
    assert len(returns.lengths) == 2_000
    walks = all_spatial_walks(returns, build_reference(), 2)
    assert {walk.threads for walk in walks} == {1, 2}
    assert raycast.check_agreement(walks) > 2_000 * 3 / resolution
    path, hits, all_path, all_hits = next(walk for walk in walks if walk.kind == NEW_ARRAYS).results()
    assert all_path == pytest.approx(returns.lengths.sum(), abs=0.01)
    assert all_hits == hits.sum() == 2_000
    assert path.sum() == pytest.approx(all_path[0])


def test_a_walk_that_is_one_cell_off_is_found(drive: SpatialDrive) -> None:
    walks = all_spatial_walks(spatial_returns(drive, 2, 0.2), None, 1)
    plain = walks[0]
    wrong = SimpleNamespace(
        kind=plain.kind,
        label="wrong",
        name="accumulation: wrong",
        run=lambda: None,
        results=lambda: (np.roll(plain.results()[0], 1), *plain.results()[1:]),
    )
    with pytest.raises(MapError, match="accumulation: wrong"):
        raycast.check_agreement([plain, wrong])  # type: ignore[list-item]


def test_rates_are_those_of_the_statistics(drive: SpatialDrive) -> None:
    returns = spatial_returns(drive, 2, 0.5)
    dense = RayStatistics.from_scans(drive.scans, drive.poses, grid=returns.grid)
    mean = dense.hits.sum() / dense.path_lengths.sum()
    expected = (dense.hits + 0.5 * mean) / (dense.path_lengths + 0.5)
    rimmed = returns.dense_rates.reshape([n + 2 for n in returns.grid.shape])
    np.testing.assert_allclose(rimmed[1:-1, 1:-1, 1:-1], expected, rtol=1e-6)
    np.testing.assert_allclose(rimmed[0], mean, rtol=1e-6)
    np.testing.assert_allclose(returns.brick_rates[:4096], mean, rtol=1e-6)


def test_a_grid_too_large_is_refused_before_it_is_made(drive: SpatialDrive, monkeypatch: pytest.MonkeyPatch) -> None:
    returns = spatial_returns(drive, 1, 0.5)
    asked = []

    def refuse(needed: int, what: str) -> None:
        asked.append(needed)
        raise MapError(what)

    monkeypatch.setattr(spatial_walks, "require_memory", refuse)
    with pytest.raises(MapError, match="dense grid"):
        all_spatial_walks(returns, None, 1)
    assert asked == [spatial_walks.BYTES_A_CELL * returns.dense_size]


def test_a_scene_has_figures_goals_and_bars(drive: SpatialDrive, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(raycast, "load_spatial_drive", lambda data, log: drive)
    bench = Benchmark("raycast", {})
    scene = raycast.spatial_scene(arguments(None), STREET, 0, 0.5, None, 1)
    name, settings, bars = raycast.measure(bench, scene, 1, 1)
    assert name == "street, 0.5 m"
    assert settings["scans walked"] == 2
    assert settings["maximum range (m)"] == 60
    assert bench.figures["street, 0.5 m: memory: map at rest, dense"][0] > 0
    goals = {goal.name: goal for goal in bench.goals}
    assert goals["street, 0.5 m: memory: bricks / dense"].most == 1 / 8
    assert goals["street, 0.5 m: accumulation: factorloc, 1 thread, rays of 75 cells"].least == 3
    against = "street, 0.5 m: accumulation: factorloc bricks, 1 thread / factorloc, 1 thread"
    assert goals[against].most == 1.6
    assert all(groups for groups in bars.values())
    other = raycast.spatial_scene(arguments(None), DRIVE_0005, 0, 0.5, None, 1)
    assert not other.most_memory


def test_every_log_has_its_scenes() -> None:
    logs = list(raycast.LOGS)
    assert len(raycast.scene_makers(arguments(Path(), log=logs), None)) == 1 + 2 + 2
    assert len(raycast.scene_makers(arguments(Path(), log=logs, resolution=0.3), None)) == 3
    assert len(raycast.scene_makers(arguments(None, log=logs), None)) == 1 + 2
    with pytest.raises(MapError, match="no real data"):
        raycast.scene_makers(arguments(None, log=[DRIVE_0005]), None)


def test_a_drive_that_cannot_be_read_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no real data"):
        load_spatial_drive(None, DRIVE_0005)
    with pytest.raises(DataError, match=r"frames_every3_full\.npz"):
        load_spatial_drive(tmp_path, DRIVE_0005)


@pytest.mark.data
def test_the_even_frames_of_the_drive_are_read(data_dir: Path) -> None:
    drive = load_spatial_drive(data_dir, DRIVE_0005)
    load_spatial_drive.cache_clear()
    assert len(drive.scans) == len(drive.poses) == 26
    reference = np.load(data_dir / "kitti_raw_0005" / "reference_poses.npz")["T_velo0_velo"]
    np.testing.assert_allclose(drive.poses[3][:3, :3], reference[18][:3, :3])
    assert all(scan.ranges.max() <= RANGE for scan in drive.scans)
    # No sensor lies on a plane of either raster, and all of them stay together.
    shift = drive.poses[:, :3, 3] - reference[::6, :3, 3]
    np.testing.assert_allclose(shift, np.tile(shift[0], (26, 1)))
    for resolution in raycast.SPATIAL_RESOLUTIONS:
        lines = drive.poses[0, :3, 3] / resolution
        assert np.abs(lines - lines.round()).min() > 0.02


def test_columns_share_rows_and_colours() -> None:
    one, two = Bar("a", 1.0, (0.9, 1.1)), Bar("b", 2.0, (1.0, 3.0))
    figure = plot_columns({"x": {"g": [one, two], "h": [], "n": []}, "y": {"g": [two], "h": [one], "n": []}}, "ns")
    first, second, nothing, lower = figure.axes
    assert first.patches[1].get_facecolor() == second.patches[0].get_facecolor()
    assert first.patches[1].get_window_extent().y0 == second.patches[0].get_window_extent().y0
    assert second.get_xlim() == first.get_xlim()
    assert first.get_xlim()[1] > 3.0  # the quartiles lie inside
    assert (len(nothing.patches), len(lower.patches)) == (0, 1)
    assert lower.get_title(loc="left") == "y: h"
