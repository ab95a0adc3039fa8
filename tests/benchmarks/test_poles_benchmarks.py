"""What the benchmarks of poles count: detections, truth, rays, and the settings that are frozen."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from benchmarks import poles_extraction, poles_kitti
from benchmarks.kitti_frames import read_frames
from benchmarks.poles_detection import DetectionRates, match
from benchmarks.poles_extraction_scenes import street_stretches
from factorloc.config import read_config
from factorloc.mapping import LocalMap, PoleMap, Poles, local_maps
from factorloc.mapping.grid import Grid
from factorloc.simulation import StreetSettings, vlp_16

full_size = pytest.mark.skipif(
    os.environ.get("NUMBA_DISABLE_JIT", "0") != "0", reason="local maps of full size want compiled kernels"
)


def test_matching_takes_as_many_as_possible_and_one_each() -> None:
    found, true = np.array([[0.0, 0], [0.4, 0], [5, 5]]), np.array([[0.35, 0], [0.8, 0.0]])
    assert match(found, true, 0.5).tolist() == [[0, 0], [1, 1]]
    assert match(found[:0], true, 0.5).shape == (0, 2)
    assert match(found, true + 50, 0.5).shape == (0, 2)


def test_rates_count_only_what_local_maps_cover() -> None:
    def poles(*x: float) -> Poles:
        n = len(x)
        return Poles(np.stack([x, np.zeros(n)], 1), np.full(n, 0.1), np.tile([0.0, 2.0], (n, 1)), np.ones(n))

    reference = PoleMap.of(poles(12, 14, 19.8, 40))
    corners = np.array([[-10.0, -10.0], [10.0, 10.0]])
    here = LocalMap(np.array([0]), 0.0, np.array([10.0, 0, 0]), poles(2.1, -5), corners, np.zeros(3))
    rates = DetectionRates.of([here], reference, 0.5, 0.5)
    assert (rates.in_view, rates.seen, rates.detections, rates.unmatched) == (2, 1, 2, 1)
    assert rates.miss_rate == 0.5
    assert rates.false_rate == 1 / 400
    assert rates.position_sigma == pytest.approx(0.1 / np.sqrt(2))


@full_size
def test_truth_has_returns_where_the_lidar_has_seen_it() -> None:
    street = StreetSettings(length=120.0)
    stretch = next(street_stretches(street, vlp_16(columns=900), 5, 5.0, 2))
    seen = stretch.returns > 0
    distances = np.linalg.norm(stretch.truth.positions - stretch.centre[:2], axis=1)
    assert 3 <= seen.sum() < len(seen)
    assert np.median(distances[seen]) < np.median(distances[~seen])
    part = stretch.begin(1.5)
    assert 1 <= len(part.scans) < len(stretch.scans)
    assert part.returns.sum() < stretch.returns.sum()


@full_size
def test_clipped_rays_lie_within_the_grid_and_end_where_they_did() -> None:
    stretch = next(street_stretches(StreetSettings(length=120.0), vlp_16(columns=400), 5, 2.0, 2))
    grid = Grid(tuple(np.floor(stretch.centre) - [5, 5, 2]), 0.1, (100, 100, 30))
    origins, directions, lengths = poles_extraction.clip(list(stretch.scans), stretch.poses, grid)
    for ends in (origins, origins + directions * lengths[:, None]):
        assert (ends > -1e-6).all()
        assert (ends < np.array(grid.upper) - grid.origin + 1e-6).all()
    assert 0 < len(lengths) <= stretch.rays
    assert lengths.sum() < 0.9 * sum(scan.ranges.sum() for scan in stretch.scans)


def test_settings_are_read_and_frozen_rates_say_how_they_were_measured() -> None:
    extraction = read_config(poles_extraction.SETTINGS, poles_extraction.ExtractionSettings)
    assert set(extraction.lidars) <= set(poles_extraction.LIDARS)
    read_config(poles_kitti.SETTINGS, poles_kitti.PolesKittiSettings)
    frozen = json.loads(poles_kitti.SETTINGS.with_name("poles_kitti_detection.json").read_text(encoding="utf-8"))
    assert 0 < frozen["miss_rate"] < 1
    assert set(frozen["units"]) == {key for key in frozen if key.startswith(("miss", "false", "position"))}


@pytest.mark.data
@full_size
def test_the_frozen_rates_are_those_of_the_drive(data_dir: Path) -> None:
    settings = read_config(poles_kitti.SETTINGS, poles_kitti.PolesKittiSettings)
    frames = read_frames(data_dir, settings.range_limits)
    odd = frames.select(slice(1, None, 2))
    path = poles_kitti.noisy_odometry(data_dir, odd, settings.odometry)
    maps = list(local_maps(odd.scans, path, settings.mapping.poles))
    pole_map = poles_kitti.map_of(frames.select(slice(0, None, 2)), settings)
    rates = poles_kitti.compared(maps, odd, pole_map, settings)
    kept = poles_kitti.SETTINGS.with_name("poles_kitti_detection.json")
    assert poles_kitti.frozen(rates, settings, len(maps)) == json.loads(kept.read_text(encoding="utf-8"))
