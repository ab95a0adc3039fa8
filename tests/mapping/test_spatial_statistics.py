"""Ray statistics in space: equal to a naive walk, and the same in bricks, slabs, parts and windows to the last bit."""

from itertools import pairwise

import naive
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from naive import Ray
from ray_cases import SEEDS, STATUSES
from spatial_cases import (
    HERE,
    exact_spatial_grids,
    exact_spatial_rays,
    packed_spatial,
    spatial_grids,
    spatial_rays,
)

from factorloc.errors import MapError
from factorloc.mapping import BrickStatistics, Grid, RayStatistics, ray_statistics
from factorloc.mapping import brick_statistics as module
from factorloc.mapping._spatial_traversal_kernels import accumulate_spatial
from factorloc.mapping.bricks import BRICK, BrickLayout
from factorloc.mapping.cell_tiles import TILE, CellTiles
from factorloc.mapping.packed_integers import PackedIntegers
from factorloc.scan import RayStatus, Scan

ARRAYS = ("hits", "misses", "path_fixed")


def dense(rays: list[Ray], grid: Grid) -> RayStatistics:
    return RayStatistics.empty(grid).add(packed_spatial(rays), HERE)


def bricks(rays: list[Ray], grid: Grid) -> BrickStatistics:
    return BrickStatistics.empty(grid).add(packed_spatial(rays), HERE)


def same(a: RayStatistics | BrickStatistics, b: RayStatistics | BrickStatistics) -> bool:
    """Equal to the last bit."""
    equal = all(np.array_equal(getattr(a, name), getattr(b, name)) for name in ARRAYS)
    if isinstance(a, BrickStatistics) and isinstance(b, BrickStatistics):
        equal &= np.array_equal(a.keys, b.keys)
    return equal and (a.grid, a.scans, a.left_out) == (b.grid, b.scans, b.left_out)


def assert_naive(rays: list[Ray], grid: Grid) -> None:
    found, expected = dense(rays, grid), naive.ray_statistics(rays, grid)
    assert np.array_equal(found.hits, expected.hits)
    assert np.array_equal(found.misses, expected.misses)
    assert np.abs(found.path_lengths - expected.path).max() <= len(rays) * 1e-6
    statuses = [ray.status for ray in rays]
    assert found.left_out == {
        "below minimum range": statuses.count(RayStatus.BELOW_MINIMUM),
        "ended outside the grid": statuses.count(RayStatus.RETURN) - expected.hits.sum(),
    }
    assert same(bricks(rays, grid).to_dense(), found)


@given(st.data())
def test_equal_to_the_naive_walk(data: st.DataObject) -> None:
    grid = data.draw(spatial_grids())
    rays = data.draw(spatial_rays(grid, 6))
    assume(not any(naive.is_ambiguous(ray, grid) for ray in rays))
    assert_naive(rays, grid)


@given(exact_spatial_grids(), st.lists(exact_spatial_rays(), min_size=1, max_size=5))
def test_along_an_axis_and_on_the_planes(grid: Grid, rays: list[Ray]) -> None:
    assert_naive(rays, grid)


@given(exact_spatial_grids(), SEEDS, STATUSES)
def test_along_diagonals_path_lengths_add_up(grid: Grid, seed: int, status: RayStatus) -> None:
    # In which of two cells such a ray leaves its path is a matter of rounding; how much it leaves is not.
    rng = np.random.default_rng(seed)
    direction = rng.choice([-1.0, 0.0, 1.0], 3)
    assume(direction.any())
    ray = Ray(rng.integers(-40, 40, 3) / 8, direction / np.linalg.norm(direction), rng.integers(1, 60) / 7, status)
    inside = naive.lengths_by_cell(ray, grid)
    inside.pop(None, None)
    total = 0.0 if status == RayStatus.BELOW_MINIMUM else sum(inside.values())
    if np.abs(ray.origin / grid.resolution - np.round(ray.origin / grid.resolution)).min() > 0.1:
        assert dense([ray], grid).path_lengths.sum() == pytest.approx(total, abs=4e-6)
    assert same(bricks([ray], grid).to_dense(), dense([ray], grid))


@given(st.data(), st.lists(st.integers(0, 40), max_size=6))
def test_slabs_leave_no_trace(data: st.DataObject, cuts: list[int]) -> None:
    grid = data.draw(spatial_grids() | exact_spatial_grids())
    rays = data.draw(spatial_rays(grid, 5)) + data.draw(st.lists(exact_spatial_rays(), max_size=3))
    block = packed_spatial(rays)
    is_return = block.status == RayStatus.RETURN
    rim = np.prod([n + 2 for n in grid.shape])
    whole, parts = ((np.zeros(rim, np.int64), np.zeros(rim, np.uint32)) for _ in range(2))
    edges = sorted({0, *(min(cut, grid.shape[0]) for cut in cuts), grid.shape[0]})
    walk = (block.origins, block.directions, block.ranges, is_return)
    where = (np.array(grid.origin), grid.resolution, grid.shape, None)
    accumulate_spatial(*walk, 0, grid.shape[0], *where, *whole)
    for first, last in pairwise(edges):
        accumulate_spatial(*walk, first, last, *where, *parts)
    assert np.array_equal(whole[0], parts[0])
    assert np.array_equal(whole[1], parts[1])


@given(st.data())
def test_order_and_parts_leave_no_trace(data: st.DataObject) -> None:
    grid = data.draw(spatial_grids())
    rays = data.draw(spatial_rays(grid, 7))
    cut = data.draw(st.integers(0, 7))
    whole = bricks(rays, grid)
    parts = BrickStatistics.merge([bricks(rays[cut:], grid), bricks(rays[:cut], grid)])
    assert same(parts, BrickStatistics.from_dense(dense(rays[:cut], grid) + dense(rays[cut:], grid)))
    assert all(
        np.array_equal(getattr(whole.cells, name), getattr(parts.cells, name)) for name in (*ARRAYS, "bricks", "local")
    )


@given(st.data())
def test_a_pool_too_small_is_filled_in_parts(data: st.DataObject) -> None:
    grid = data.draw(spatial_grids())
    rays = data.draw(spatial_rays(grid, 6))
    whole = bricks(rays, grid)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_MOST_BRICKS", 2)
        assert same(bricks(rays, grid), whole)


@given(st.data())
def test_blocks_of_rays_leave_no_trace(data: st.DataObject) -> None:
    grid = data.draw(spatial_grids(20))
    rays = data.draw(spatial_rays(grid, 6))
    whole, sparse = dense(rays, grid), bricks(rays, grid)
    few = data.draw(st.integers(1, 6))
    with pytest.MonkeyPatch.context() as patch:
        for where in (module, ray_statistics):
            patch.setattr(where, "most_rays", lambda grid: few)
        assert same(dense(rays, grid), whole)
        assert same(bricks(rays, grid), sparse)


@given(st.data())
def test_windows_and_unions_move_cells_to_where_they_belong(data: st.DataObject) -> None:
    shape = data.draw(st.tuples(*[st.integers(1, 40)] * 3))
    grid = Grid((-1.0, 0.5, 2.0), 0.5, shape)
    part = bricks(data.draw(spatial_rays(grid, 5)), grid)
    shift = data.draw(st.tuples(*[st.integers(-20, 20)] * 3))
    other = Grid(np.array(grid.origin) + 0.5 * np.array(shift), 0.5, data.draw(st.tuples(*[st.integers(1, 40)] * 3)))
    window = part.window(other)
    full = part.to_dense()
    inside = Grid(np.maximum(grid.origin, other.origin), 0.5, (1, 1, 1))
    upper = np.minimum(grid.upper, other.upper)
    extent = np.round((upper - np.array(inside.origin)) / 0.5).astype(int)
    if (extent > 0).all():
        common = Grid(inside.origin, 0.5, tuple(extent))
        for name in ARRAYS:
            a, b = getattr(window, name)[other.window(common)], getattr(full, name)[grid.window(common)]
            assert np.array_equal(a, b)
            assert getattr(window, name).sum() == b.sum(), "nothing lies outside of what is common"
    assert same(BrickStatistics.from_dense(window), part.crop(other))
    union = part + BrickStatistics.empty(other)
    assert union.grid == grid.union(other)
    assert union.path_fixed.sum() == part.path_fixed.sum()
    assert same(union.window(grid), full) or union.scans != full.scans


@given(spatial_grids(), SEEDS)
def test_keys_name_cells(grid: Grid, seed: int) -> None:
    cells = np.random.default_rng(seed).integers(0, grid.shape, (20, 3))
    layout = BrickLayout(grid, np.zeros(0, np.int64))
    assert np.array_equal(layout.cells(layout.keys(cells)), cells)


@given(st.lists(st.sampled_from([0, 1, 254, 255, 256, 70_000]), max_size=30))
def test_packed_numbers_are_the_numbers(numbers: list[int]) -> None:
    packed = PackedIntegers.pack(np.array(numbers, np.int64), np.uint8)
    assert packed.unpack(np.int64).tolist() == numbers
    assert packed.narrow.itemsize == 1


def test_an_addition_makes_only_the_tiles_anew_that_it_touches() -> None:
    grid = Grid((0.0, 0.0, 0.0), 1.0, (3 * BRICK, 8 * BRICK, 16 * BRICK))  # a tile is a layer of bricks across x
    along_y = np.array([0.0, 1.0, 0.0])
    one, other = (
        bricks([Ray(np.array([x, 0.5, 3.5]), along_y, 100.0, RayStatus.RETURN)], grid) for x in (3.5, 2 * BRICK + 3.5)
    )
    assert (list(one.cells.tiles), list(other.cells.tiles)) == ([0], [2])
    both = one + other
    assert both.cells.tiles[0] is one.cells.tiles[0]
    assert both.cells.tiles[2] is other.cells.tiles[2]
    twice = both + one
    assert twice.cells.tiles[2] is other.cells.tiles[2]
    assert twice.cells.tiles[0].hits.sum() == 2
    assert one.cells.tiles[0].hits.sum() == 1, "what was added to has not changed"


@given(st.data())
def test_tiles_hold_the_bricks_of_their_number(data: st.DataObject) -> None:
    grid = data.draw(spatial_grids())
    found = bricks(data.draw(spatial_rays(grid, 6)), grid)
    assert list(found.cells.tiles) == sorted(found.cells.tiles)
    for number, tile in found.cells.tiles.items():
        assert len(tile) > 0
        assert (tile.bricks // TILE == number).all()
    assert found.nbytes == sum(tile.nbytes for tile in found.cells.tiles.values())
    assert len(found.cells) == len(found.keys)


@given(st.lists(st.integers(0, 23), max_size=12), st.integers(1, 5))
def test_slabs_hold_every_brick_once(numbers: list[int], most: int) -> None:
    grid = Grid((0.0, 0.0, 0.0), 1.0, (5 * BRICK + 3, 2 * BRICK, BRICK + 1))  # layers of 4 bricks, the last one thin
    layout = BrickLayout(grid, np.unique(np.array(numbers, np.int64)))
    slabs = layout.slabs(most)
    assert np.array_equal(np.concatenate([layout.bricks[:0], *(part.bricks for _, _, part in slabs)]), layout.bricks)
    last = 0
    for first, end, part in slabs:
        assert last <= first < end <= grid.shape[0]
        assert first % BRICK == 0
        assert len(part.bricks) <= most or end - first <= BRICK
        corners = part.corners()[:, 0]
        assert ((corners >= first) & (corners < end)).all()
        last = end


def test_scans_at_poses_of_a_moving_body() -> None:
    rng = np.random.default_rng(3)
    directions = rng.standard_normal((500, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    scan = Scan(directions, rng.uniform(1, 20, 500), rng.choice(list(RayStatus), 500), (0.5, 21.0))
    poses = np.repeat(HERE, 3, axis=0)
    poses[:, 0, 3] = [0.0, 1.0, 2.5]
    seen: list[int] = []
    sparse = BrickStatistics.from_scans([scan] * 3, poses, resolution=0.5, progress=seen.append)
    full = RayStatistics.from_scans([scan] * 3, poses, resolution=0.5)
    assert same(sparse.to_dense(), full)
    assert (sparse.scans, seen) == (3, [3])
    assert sparse.nbytes < full.hits.nbytes + full.misses.nbytes + full.path_fixed.nbytes
    returned, silent = (
        3 * scan.ranges[scan.status == which].sum() for which in (RayStatus.RETURN, RayStatus.NO_RETURN)
    )
    # The grid holds every return, and of rays without return what lies in it.
    assert returned < full.path_lengths.sum() + 1e-3 < returned + silent
    assert full.hits.sum() == 3 * (scan.status == RayStatus.RETURN).sum()


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(MapError, match="planar"):
        BrickStatistics.empty(Grid((0, 0), 1, (3, 3)))
    empty = BrickStatistics.empty(Grid((0, 0, 0), 1.0, (3, 3, 3)))
    with pytest.raises(MapError, match="raster"):
        empty.window(Grid((0.5, 0, 0), 1.0, (2, 2, 2)))
    with pytest.raises(MapError, match="none given"):
        BrickStatistics.merge([])
    with pytest.raises(MapError, match="damaged"):
        CellTiles.in_order(np.array([5]), np.array([0, 1]), *(np.zeros(0, t) for t in ("u2", "u4", "u4", "i8")))
    cell = CellTiles.of_keys(np.array([5 * 4096]), *(np.ones(1, t) for t in ("u4", "u4", "i8")))
    with pytest.raises(MapError, match="none of the grid's"):
        BrickStatistics(empty.grid, cell)
