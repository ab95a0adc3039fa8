"""The benchmark of a large map: what it counts, compares and measures, and a run of it in a small town."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import maps_large, maps_large_stream
from benchmarks.harness import Arguments, Benchmark
from benchmarks.maps_large_settings import Job, LargeSettings
from benchmarks.maps_large_stream import session_scans
from benchmarks.ray_census import Census, Stream, same
from factorloc.config import read_config
from factorloc.errors import ConfigError, FactorlocError
from factorloc.mapping import BrickStatistics, Grid
from factorloc.mapping.cell_tiles import CellTiles
from factorloc.scan import RayStatus, Scan
from factorloc.simulation import Town

ROOT = Path(__file__).parents[2]
GRID = Grid((-15.0, -15.0, -15.0), 0.5, (60, 60, 60))


def scan_of(seed: int, rays: int = 200) -> Scan:
    rng = np.random.default_rng(seed)
    directions = rng.standard_normal((rays, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    return Scan(directions, rng.uniform(2.0, 10.0, rays), np.zeros(rays, np.uint8), (0.5, 20.0))


def pose_at(x: float) -> Any:
    pose = np.eye(4)
    pose[0, 3] = x
    return pose


def small(**changes: Any) -> LargeSettings:
    """Four very short sessions in a town of one block, on coarse cells."""
    settings = json.loads(maps_large.SETTINGS.read_text(encoding="utf-8"))
    settings |= {"town": {"columns": 1, "rows_of_blocks": 1}, "resolution": 1.0, "margin": 20.0, "region": [110, 110]}
    settings["sessions"] |= {"survey_length": 50.0, "route_length": 50.0, "moving_cars": 0, "pedestrians": 0}
    settings |= {"rays": 6000.0, "quick_rays": 3000.0, "count": 3, "block_rays": 1000, "part_block_rays": 600}
    settings |= {"orders": [[0, 1, 2], [2, 0, 1]], **changes}
    return LargeSettings(**settings)


def test_the_settings_ask_for_what_is_claimed() -> None:
    settings = read_config(maps_large.SETTINGS, LargeSettings)
    assert settings.rays >= settings.goals.rays >= 50e6
    assert settings.goals.peak == 2.0
    assert settings.count >= 4
    assert len({tuple(order) for order in settings.orders}) == len(settings.orders) >= 3
    assert all(sorted(order) == list(range(settings.count)) for order in settings.orders)
    assert settings.block_rays != settings.part_block_rays


def test_a_stream_forgets_its_scans_and_maps_them_all() -> None:
    stream = Stream(BrickStatistics.empty(GRID), 500)
    scans = [scan_of(k) for k in range(7)]
    poses = [pose_at(0.31 * k) for k in range(7)]
    for k, (scan, pose) in enumerate(zip(scans, poses, strict=True)):
        stream.take(scan, pose)
        assert stream.statistics.scans == 3 * ((k + 1) // 3)
    assert len(stream._scans) == 1
    assert same(stream.flush(), BrickStatistics.from_scans(scans, np.array(poses), grid=GRID))
    assert same(stream.flush(), stream.statistics)
    assert not stream._scans
    assert stream.seconds > 0


def test_maps_that_differ_in_one_count_are_not_the_same() -> None:
    statistics = BrickStatistics.empty(GRID)
    for k in range(2):
        statistics += BrickStatistics.from_scans([scan_of(k)], pose_at(0.1 * k)[None], grid=GRID)
    assert same(statistics, replace(statistics))
    assert not same(statistics, replace(statistics, scans=3))
    assert not same(statistics, BrickStatistics.empty(GRID))
    assert not same(statistics.to_dense(), statistics)
    number, tile = next(iter(statistics.cells.tiles.items()))
    narrow = tile.packed_path.narrow.copy()
    narrow[17] += 1
    other = replace(tile, packed_path=replace(tile.packed_path, narrow=narrow))
    assert not same(statistics, replace(statistics, cells=CellTiles({**statistics.cells.tiles, number: other})))
    assert not same(statistics, replace(statistics, cells=CellTiles({})))


def test_only_rays_that_differ_are_counted() -> None:
    census = Census()
    census.take(scan_of(1), pose_at(0.0))
    assert (census.rays, census.distinct, census.scans) == (200, 200, 1)
    census.take(scan_of(2), pose_at(0.0))  # where another was
    census.take(scan_of(1), pose_at(1.0))  # with the noise of another
    assert (census.rays, census.distinct) == (600, 200)
    scan = scan_of(3)
    census.take(scan.select(np.r_[:200, :50]), pose_at(2.0))
    assert (census.rays, census.distinct) == (850, 400)
    near = scan_of(4)
    status = near.status.copy()
    status[:20] = RayStatus.BELOW_MINIMUM
    census.take(replace(near, status=status), pose_at(3.0))
    assert (census.rays, census.distinct, census.scans) == (1030, 580, 5)


def test_sessions_are_cast_without_repetition() -> None:
    settings = small()
    town = Town(settings.town, settings.seed)
    census = Census()
    wanted = int(6000 / 3 / (64 * 10)) + 2
    for number in (0, 1):
        pairs = list(session_scans(town, number, Job(settings=settings, quick=False, threads=1, columns=10)))
        assert len(pairs) == wanted
        for pair in pairs:
            census.take(*pair)
    assert census.distinct == census.rays > 0
    quick = session_scans(town, 0, Job(settings=settings, quick=True, threads=1, columns=10))
    assert len(list(quick)) == int(3000 / 3 / 640) + 2
    with pytest.raises(ConfigError, match="drive further"):
        next(session_scans(town, 0, Job(settings=small(rays=1e6), quick=False, threads=1, columns=10)))


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path]:
    """What a process of its own reports of a small run, and its folder."""
    folder = tmp_path_factory.mktemp("large")
    given = Arguments(None, False, folder / "a.json", folder / "a.png", 1, {"columns": 10})
    return maps_large.run_apart(folder, small(), given), folder


def test_parts_and_files_are_the_streamed_map(report: tuple[dict[str, Any], Path]) -> None:
    found, folder = report
    assert found["merges equal"] == [True, True]
    assert found["read equal"]
    assert found["region equal"]
    assert 0 < found["region cells"] < found["cells"]
    assert found["distinct"] == found["rays"] >= 6000
    assert found["file bytes"] == (folder / "map.h5").stat().st_size
    assert [name for _, name in found["marks"]][:3] == ["session 0", "session 1", "session 2"]
    view, extent = maps_large.view_of(folder / "map.h5")
    assert view.shape == tuple(found["grid"][:2])
    assert extent[1] - extent[0] == pytest.approx(view.shape[0])
    assert np.nanmax(view) > 0


def test_what_is_missed_is_a_missed_goal(report: tuple[dict[str, Any], Path]) -> None:
    settings = small(goals={"rays": 5000.0, "peak": 1e-3})
    bench = Benchmark("maps_large", {})
    maps_large.add_figures(bench, report[0], settings, False)
    met = {goal.name: goal.met for goal in bench.goals}
    assert [name for name, good in met.items() if not good] == ["peak memory"]
    worse = report[0] | {"merges equal": [True, False], "read equal": False, "distinct": 4999}
    bench = Benchmark("maps_large", {})
    maps_large.add_figures(bench, worse, small(goals={"rays": 5000.0, "peak": 1e9}), True)
    assert [goal.name for goal in bench.goals if not goal.met] == [
        "rays cast twice",
        "orders of merging that give the streamed map",
        "the map read again is equal",
    ]
    assert not [goal for goal in bench.goals if goal.unit == "million"]  # a quick run casts fewer rays


def test_a_run_writes_its_report(
    report: tuple[dict[str, Any], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(folder: Path, settings: LargeSettings, given: Arguments) -> dict[str, Any]:
        assert settings == small()
        assert (given.quick, given.options["columns"]) == (True, 10)
        shutil.copy(report[1] / "map.h5", folder)
        return report[0]

    monkeypatch.setattr(maps_large, "run_apart", run)
    (tmp_path / "small.json").write_text(small().model_dump_json(), encoding="utf-8")
    files = ["--json", str(tmp_path / "a.json"), "--plot", str(tmp_path / "a.svg")]
    code = maps_large.main(["--quick", "--columns", "10", "--settings", str(tmp_path / "small.json"), *files])
    written = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    assert code == 0
    assert all(goal["met"] for goal in written["goals"])
    assert written["figures"]["peak memory while streaming"]["value"] > 0.05
    assert "session 2" in (tmp_path / "a.svg").read_text(encoding="utf-8")


def test_an_error_there_is_an_error_here(tmp_path: Path) -> None:
    given = Arguments(None, False, tmp_path / "a.json", tmp_path / "a.png", 1, {"columns": -1})
    with pytest.raises(FactorlocError, match=r"process that maps: .*job\.json: Job: columns"):
        maps_large.run_apart(tmp_path, small(), given)
    assert maps_large_stream.work([str(tmp_path / "none")]) == 2


_WATCHED = """
import numpy as np
from benchmarks.resident_memory import MemoryCurve, peak_resident, resident

with MemoryCurve(0.005) as curve:
    curve.mark("before")
    before = resident()
    block = np.ones(32_000_000)
    curve.mark("after")
    assert resident() >= before + 0.9 * block.nbytes
samples = curve.samples
assert (np.diff(samples[:, 0]) >= 0).all()
assert samples[-1, 1] >= before + 0.9 * block.nbytes
assert peak_resident() >= samples[:, 1].max() * 0.99
assert [name for _, name in curve.marks] == ["before", "after"]
print("seen")
"""


def test_the_memory_curve_sees_what_is_taken() -> None:
    # In a process of its own: in this one, other tests' garbage may be given back meanwhile.
    command = [sys.executable, "-c", _WATCHED]
    done = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True)
    assert done.stdout == "seen\n", done.stderr
