"""Ray statistics: equal to a naive walk, independent of order, parts and threads, and never silently short."""

import dataclasses
from functools import partial

import naive
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from naive import Ray
from ray_cases import (
    DIAGONALS,
    EIGHTHS,
    IDENTITY,
    STATUSES,
    counted,
    exact_grids,
    exact_rays,
    grids,
    packed,
    rays_near,
    sweep,
)
from strategies import poses_2d

from factorloc import _jit
from factorloc.errors import GeometryError, MapError
from factorloc.mapping import Grid, RayStatistics, accumulation
from factorloc.mapping import ray_statistics as module
from factorloc.rays import pack
from factorloc.scan import RayStatus, Scan

UNIT = naive.UNIT


def walk(rays: list[Ray], grid: Grid) -> RayStatistics:
    return RayStatistics.empty(grid).add(packed(rays), IDENTITY)


def same(a: RayStatistics, b: RayStatistics) -> bool:
    """Equal to the last bit."""
    arrays = ("hits", "misses", "path_fixed")
    equal = all(np.array_equal(getattr(a, name), getattr(b, name)) for name in arrays)
    return equal and (a.grid, a.scans, a.left_out) == (b.grid, b.scans, b.left_out)


def assert_naive(rays: list[Ray], grid: Grid) -> None:
    found, expected = walk(rays, grid), naive.ray_statistics(rays, grid)
    assert np.array_equal(found.hits, expected.hits)
    assert np.array_equal(found.misses, expected.misses)
    # Each of the two crossings of a cell is rounded to the unit.
    assert np.abs(found.path_lengths - expected.path).max() <= len(rays) * 1e-6
    assert np.array_equal(found.visits, expected.hits + expected.misses)
    statuses = [ray.status for ray in rays]
    assert found.left_out == {
        "below minimum range": statuses.count(RayStatus.BELOW_MINIMUM),
        "ended outside the grid": statuses.count(RayStatus.RETURN) - expected.hits.sum(),
    }


@given(st.data())
def test_equal_to_the_naive_walk(data: st.DataObject) -> None:
    grid = data.draw(grids())
    rays = data.draw(rays_near(grid, 8))
    assume(not any(naive.is_ambiguous(ray, grid) for ray in rays))
    assert_naive(rays, grid)


@given(exact_grids(), st.lists(exact_rays(), min_size=1, max_size=5))
def test_along_an_axis_and_on_the_lines(grid: Grid, rays: list[Ray]) -> None:
    assert_naive(rays, grid)
    assert np.array_equal(walk(rays, grid).path_lengths, naive.ray_statistics(rays, grid).path)


@given(exact_grids(), EIGHTHS, EIGHTHS, DIAGONALS, st.integers(1, 60), STATUSES)
def test_from_corner_to_corner(grid: Grid, x: float, y: float, direction, length: int, status: RayStatus) -> None:
    assert_naive([Ray(np.array([x, y]), direction, length / 7, status)], grid)


@pytest.mark.parametrize("quarter", range(-4, 5))
@pytest.mark.parametrize("tilt", [0.0, 1e-17, -1e-16, 1e-15, -1e-14])
def test_rounding_along_a_line_moves_nothing_along_the_ray(quarter: int, tilt: float) -> None:
    # Which side of the line such a ray runs on is a matter of rounding, but not how far it goes.
    rng = np.random.default_rng(quarter + 4)
    grid = Grid((0, 0), 0.1, (20, 20))
    angle = quarter * np.pi / 2 + tilt
    direction = np.array([np.cos(angle), np.sin(angle)])
    for _ in range(25):
        origin = np.round(rng.uniform(0.2, 1.8, 2) / 0.1) * 0.1
        ray = Ray(origin, direction, rng.choice([0.33, 0.57, 1.04, 2.61]), RayStatus.RETURN)
        found, expected = walk([ray], grid), naive.ray_statistics([ray], grid)
        across = 1 if quarter % 2 == 0 else 0
        assert found.path_lengths.sum(across) == pytest.approx(expected.path.sum(across), abs=3e-6)
        assert np.array_equal(found.hits.sum(across), expected.hits.sum(across))
        visits = found.visits.sum(across)
        assert visits.max() <= 2
        assert visits.sum() - expected.hits.sum() - expected.misses.sum() in (-1, 0, 1)


@given(grids(), st.data())
def test_path_lengths_add_up_to_the_ray(grid: Grid, data: st.DataObject) -> None:
    (ray,) = data.draw(rays_near(grid, 1, (RayStatus.NO_RETURN,)))
    inside = naive.lengths_by_cell(ray, grid)
    inside.pop(None, None)
    assert walk([ray], grid).path_lengths.sum() == pytest.approx(sum(inside.values()), abs=2 * UNIT)
    wide = Grid(np.array(grid.origin) - 100, 50.0, (7, 7))
    assert walk([ray], wide).path_fixed.sum() == int(ray.length / UNIT)


def test_what_each_status_leaves_behind() -> None:
    grid = Grid((0, 0), 1.0, (10, 1))
    scan = Scan.from_polar([0.0, 0.0, 0.0], [0.2, 3.75, np.inf], (0.5, 6.5))
    found = RayStatistics.from_scans([scan], [[0.25, 0.5, 0]], grid=grid)
    assert found.hits.ravel().tolist() == [0, 0, 0, 0, 1, 0, 0, 0, 0, 0]
    # The ray without return carves up to the maximum range, the one below the minimum nothing.
    assert found.misses.ravel().tolist() == [2, 2, 2, 2, 1, 1, 1, 0, 0, 0]
    assert found.path_lengths.ravel().tolist() == [1.5, 2, 2, 2, 1, 1, 0.75, 0, 0, 0]
    assert found.left_out == {"below minimum range": 1, "ended outside the grid": 0}
    assert found.scans == 1
    assert (found.hits.dtype, found.misses.dtype, found.path_fixed.dtype) == (np.uint32, np.uint32, np.int64)


def test_a_ray_of_no_length() -> None:
    grid = Grid((0, 0), 1.0, (2, 2))
    for status, hits in [(RayStatus.RETURN, 1), (RayStatus.NO_RETURN, 0)]:
        found = walk([Ray(np.array([0.5, 1.5]), np.array([1.0, 0.0]), 0.0, status)], grid)
        assert found.hits.tolist() == [[0, hits], [0, 0]]
        assert not found.misses.any()
        assert not found.path_fixed.any()


@given(poses_2d(), st.integers(0, 9))
def test_scans_are_moved_by_pose_and_mount(pose: np.ndarray, seed: int) -> None:
    scan = sweep(seed, 3)
    rays = naive.rays(scan, pose)
    found = RayStatistics.from_scans([scan], [pose], resolution=0.5) if scan.is_return.any() else None
    assume(found is not None and not any(naive.is_ambiguous(ray, found.grid) for ray in rays))
    expected = naive.ray_statistics(rays, found.grid)
    assert np.array_equal(found.hits, expected.hits)
    assert np.array_equal(found.misses, expected.misses)
    assert expected.hits.sum() == scan.is_return.sum()
    assert found.left_out["ended outside the grid"] == 0


SCANS = [sweep(seed, 90) for seed in range(25)]
POSES = np.random.default_rng(7).uniform(-2, 2, (25, 3))
BUILD = partial(RayStatistics.from_scans, grid=Grid((-6, -5), 0.2, (50, 45)))


@pytest.fixture(scope="module")
def whole() -> RayStatistics:
    return BUILD(SCANS, POSES)


def test_no_ray_is_lost(whole: RayStatistics) -> None:
    returns = sum(scan.is_return.sum() for scan in SCANS)
    below = sum((scan.status == RayStatus.BELOW_MINIMUM).sum() for scan in SCANS)
    assert whole.hits.sum() + whole.left_out["ended outside the grid"] == returns
    assert whole.left_out["ended outside the grid"] > 0
    assert whole.left_out["below minimum range"] == below > 0
    assert whole.scans == 25


def test_the_order_of_scans_and_rays_leaves_no_trace(whole: RayStatistics) -> None:
    order = np.random.default_rng(1).permutation(25)
    turned = [SCANS[k].select(np.arange(90)[::-1]) for k in order]
    assert same(BUILD(turned, POSES[order]), whole)


def test_parts_leave_no_trace(whole: RayStatistics, monkeypatch: pytest.MonkeyPatch) -> None:
    assert same(BUILD(SCANS[:9], POSES[:9]) + BUILD(SCANS[9:], POSES[9:]), whole)
    assert same(BUILD(SCANS[:9], POSES[:9]).add(pack(SCANS[9:]), POSES[9:]), whole)
    monkeypatch.setattr(module, "_BLOCK_RAYS", 400)
    done: list[int] = []
    assert same(BUILD(SCANS, POSES, progress=done.append), whole)
    assert done == [4, 8, 12, 16, 20, 24, 25]


def test_threads_leave_no_trace(whole: RayStatistics, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_PARALLEL_RAYS", 10)
    try:
        for threads in (1, 2):
            _jit.set_threads(threads)
            assert same(BUILD(SCANS, POSES), whole)
    finally:
        _jit.set_threads(None)
    # As many parts as anyone may have threads, down to parts without a ray.
    monkeypatch.setattr(_jit, "threads", lambda: 37)
    assert same(
        BUILD(SCANS[:3], POSES[:3]),
        RayStatistics.merge([BUILD([s], [p]) for s, p in zip(SCANS[:3], POSES[:3], strict=True)]),
    )


def test_maps_are_merged_on_the_common_raster() -> None:
    alone = [
        RayStatistics.from_scans([scan], [pose], resolution=0.2) for scan, pose in zip(SCANS[:4], POSES, strict=False)
    ]
    assert len({part.grid for part in alone}) > 1
    merged = RayStatistics.merge(alone)
    assert same(merged, RayStatistics.merge(alone[::-1]))
    assert same(merged, (alone[0] + alone[1]) + (alone[2] + alone[3]))
    assert merged.grid.shares_raster(alone[2].grid)
    at_once = RayStatistics.from_scans(SCANS[:4], POSES[:4], grid=merged.grid)
    for name in ("hits", "misses", "path_fixed"):
        # Alone, a part does not see the rays that leave its own grid and come by another.
        assert (getattr(merged, name) <= getattr(at_once, name)).all()
    assert np.array_equal(merged.hits, at_once.hits)
    with pytest.raises(MapError, match="do not share a raster"):
        alone[0] + RayStatistics.from_scans(SCANS[:1], POSES[:1], resolution=0.3)
    with pytest.raises(MapError, match="none given"):
        RayStatistics.merge([])


def test_counts_end_with_an_error_not_from_the_beginning() -> None:
    most = 2**32 - 1
    ray = Ray(np.array([0.5, 0.5]), np.array([1.0, 0.0]), 1.0, RayStatus.RETURN)
    grid = Grid((0, 0), 1.0, (3, 1))
    nearly = counted(grid, np.array([[most - 1], [0], [0]]), 1.0)
    full = nearly.add(packed([ray]), IDENTITY)
    assert full.visits[0, 0] == most
    with pytest.raises(MapError, match="more than 4294967295 rays, where its counts end; split the map"):
        full.add(packed([ray]), IDENTITY)
    with pytest.raises(MapError, match=r"visited 42949672\d\d times; counts end at 4294967295: split the map"):
        nearly + counted(grid, 2, 1.0)
    assert (nearly + counted(grid, 1, 1.0)).hits[0, 0] == most


def test_maps_larger_than_memory_are_refused_with_their_size() -> None:
    huge = Grid((0, 0), 0.01, (10**6, 10**6))
    for make in (RayStatistics.empty, lambda grid: BUILD(SCANS, POSES, grid=grid)):
        with pytest.raises(MapError, match=r"1000000 x 1000000 cells needs 14901\.2 GiB, .* are free"):
            make(huge)
    far = RayStatistics.empty(Grid((10**4, 10**4), 0.01, (1, 1)))
    with pytest.raises(MapError, match="1000001 x 1000001 cells needs"):
        far + RayStatistics.empty(Grid((0, 0), 0.01, (1, 1)))


def test_every_thread_needs_memory_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_PARALLEL_RAYS", 10)
    needed = {}
    for threads in (1, 3):
        asked: list[int] = []
        monkeypatch.setattr(module, "require_memory", lambda needed, what, asked=asked: asked.append(needed))
        monkeypatch.setattr(_jit, "threads", lambda threads=threads: threads)
        BUILD(SCANS[:1], POSES[:1])
        needed[threads] = asked[-1] / (50 * 45)
    # Statistics at rest take 16 bytes a cell, and what a thread owns 12: path and misses in 8, hits in 4.
    assert needed[1] >= 16 + 12
    assert needed[3] >= needed[1] + 2 * 12


@given(st.data())
def test_blocks_of_rays_leave_no_trace(data: st.DataObject) -> None:
    grid = data.draw(grids())
    rays = data.draw(rays_near(grid, 9))
    whole = walk(rays, grid)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(accumulation, "MOST_RAYS", data.draw(st.integers(1, 9)))
        assert same(walk(rays, grid), whole)


def test_what_does_not_fit_is_refused() -> None:
    spatial = Scan(np.eye(3), np.ones(3), np.zeros(3, np.uint8), (0.1, 5))
    with pytest.raises(GeometryError, match="spatial"):
        RayStatistics.from_scans([spatial], [[0, 0, 0]])
    with pytest.raises(MapError, match="spatial"):
        RayStatistics.empty(Grid((0, 0), 1, (3, 3))).add(pack([spatial]), IDENTITY)
    with pytest.raises(MapError, match="planar"):
        RayStatistics.empty(Grid((0, 0, 0), 1, (3, 3, 3))).add(pack(SCANS[:1]), IDENTITY)
    for poses in (POSES[:2], POSES[0]):
        with pytest.raises(MapError, match="expected one planar pose for each of the 1 scans"):
            RayStatistics.from_scans(SCANS[:1], poses)
        with pytest.raises(MapError, match="expected one planar pose for each of the 1 scans"):
            RayStatistics.empty(Grid((0, 0), 1, (3, 3))).add(pack(SCANS[:1]), poses)
    with pytest.raises(GeometryError, match="NaN"):
        RayStatistics.from_scans(SCANS[:1], [[0, 0, np.nan]])
    silent = dataclasses.replace(SCANS[0], status=np.full(90, RayStatus.NO_RETURN))
    with pytest.raises(MapError, match="not one ray has a return"):
        RayStatistics.from_scans([silent], [[0, 0, 0]])
    with pytest.raises(MapError, match=r"misses: shape \(2, 3\); the grid has \(3, 2\)"):
        RayStatistics(Grid((0, 0), 1, (3, 2)), *(np.zeros(shape, np.uint32) for shape in [(3, 2), (2, 3), (3, 2)]))
