"""Cell tables: numbers in bricks are those of a dense array, however they were computed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from ray_cases import SEEDS, counted
from scipy.ndimage import uniform_filter
from spatial_cases import spatial_grids

from factorloc.errors import MapError
from factorloc.mapping import BrickStatistics, Grid, RayStatistics
from factorloc.mapping import cell_table as module
from factorloc.mapping.bricks import BRICK, CELLS, BrickLayout
from factorloc.mapping.cell_table import CellTable

OUTSIDE = 0.375


def patchy(grid: Grid, rng: np.random.Generator, patches: int) -> np.ndarray:
    """Where there is something: in a few boxes, so that most bricks of a large grid are empty."""
    there = np.zeros(grid.shape, bool)
    for _ in range(patches):
        low = rng.integers(0, grid.shape)
        there[tuple(slice(a, a + int(b)) for a, b in zip(low, rng.integers(1, 6, 3), strict=True))] = True
    return there


def patchy_map(grid: Grid, seed: int, patches: int = 2) -> RayStatistics:
    rng = np.random.default_rng(seed)
    there = patchy(grid, rng, patches)
    hits = np.where(there, rng.integers(0, 5, grid.shape), 0)
    return counted(grid, hits, np.where(there, rng.integers(1, 9, grid.shape) / 4, 0.0))


def padded(values: np.ndarray, width: int = 20) -> np.ndarray:
    return np.pad(values, width, constant_values=OUTSIDE)


def everywhere(shape: tuple[int, ...], width: int = 20, steps: tuple[int, ...] = (1, 1, 1)) -> np.ndarray:
    """Cells of a grid and around it, (..., 3): all, or those at some steps along each axis."""
    axes = [np.arange(-width, n + width, step) for n, step in zip(shape, steps, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1)


def dense(table: CellTable) -> np.ndarray:
    return table.at(everywhere(table.layout.grid.shape, 0))


@given(spatial_grids(), SEEDS, st.integers(0, 2))
def test_lookups_are_those_of_the_dense_array(grid, seed, patches) -> None:
    rng = np.random.default_rng(seed)
    values = np.where(patchy(grid, rng, patches), rng.uniform(0, 9, grid.shape), OUTSIDE).astype(np.float32)
    table = CellTable.from_dense(grid, values, OUTSIDE)
    assert table.outside == OUTSIDE
    cells = everywhere(grid.shape, steps=(3, 2, 5))
    assert np.array_equal(table.at(cells), padded(values)[::3, ::2, ::5])
    assert np.array_equal(dense(table), values)
    assert (table.pool[1:] != OUTSIDE).any(1).all(), "no brick is kept for nothing"
    doubled = table.map(lambda pool: 2 * pool)
    assert np.array_equal(dense(doubled), 2 * values)
    assert doubled.outside == 2 * OUTSIDE


def test_a_table_without_bricks_is_outside_all_over() -> None:
    grid = Grid((0, 0, 0), 1.0, (20, 3, 40))
    for table in (
        CellTable.from_dense(grid, np.full(grid.shape, OUTSIDE), OUTSIDE),
        CellTable.from_cells(BrickStatistics.empty(grid), np.zeros(0), OUTSIDE),
        CellTable.from_neighbourhoods(BrickStatistics.empty(grid), lambda part: part.hits, 2, OUTSIDE),
    ):
        assert len(table.layout.bricks) == 0
        assert (dense(table) == OUTSIDE).all()
        assert table.at([5, 1, -3]) == OUTSIDE
        assert table.nbytes == CELLS * 4 + 4 * 5 * 3 * 4


def read_by_kernels(table: CellTable, cells: np.ndarray) -> np.ndarray:
    """Numbers of cells (N, 3) within a brick of the grid, counted from the corner of the directory's rim."""
    x, y, z = (cells + BRICK).T
    stride_x, stride_y, stride_z = table.layout.strides
    brick = table.layout.directory[(x >> 4) * stride_x + (y >> 4) * stride_y + (z >> 4) * stride_z]
    return table.pool[brick, ((x & 15) << 8) + ((y & 15) << 4) + (z & 15)]


@given(spatial_grids(), SEEDS)
def test_the_directory_finds_every_cell_in_the_pool(grid, seed) -> None:
    rng = np.random.default_rng(seed)
    values = np.where(patchy(grid, rng, 2), rng.uniform(0, 9, grid.shape), OUTSIDE).astype(np.float32)
    table = CellTable.from_dense(grid, values, OUTSIDE)
    cells = everywhere(grid.shape, BRICK)[::3, ::3, ::3].reshape(-1, 3)
    assert np.array_equal(read_by_kernels(table, cells), table.at(cells))
    keys = table.layout.keys(np.argwhere(values != OUTSIDE))
    assert np.array_equal(table.pool.ravel()[table.layout.places(keys)], values[values != OUTSIDE])


def test_corners_are_the_lowest_cells_of_bricks() -> None:
    layout = BrickLayout(Grid((0, 0, 0), 1.0, (40, 17, 50)), np.array([0, 1, 4, 23]))
    assert layout.shape == (3, 2, 4)
    assert layout.corners().tolist() == [[0, 0, 0], [0, 0, 16], [0, 16, 0], [32, 16, 48]]


@given(spatial_grids(), SEEDS)
def test_visited_cells_have_their_own_numbers(grid, seed) -> None:
    counts = patchy_map(grid, seed)
    sparse = BrickStatistics.from_dense(counts)
    table = CellTable.from_cells(sparse, sparse.path_lengths, OUTSIDE)
    seen = counts.path_fixed > 0
    assert np.array_equal(dense(table), np.where(seen, counts.path_lengths, OUTSIDE))


def blurred(halo: int):
    """Sum of hits and path over a cube around each cell, exact in single precision; nothing where nothing is near."""

    def function(part: RayStatistics) -> np.ndarray:
        size = 2 * halo + 1
        sums = [
            np.round(uniform_filter(a, size, mode="constant") * size**3)
            for a in (part.hits * 1.0, part.path_lengths * 4)
        ]
        return sums[0] + 64 * sums[1] + OUTSIDE

    return function


@pytest.mark.parametrize("chunk", [1, 2, 6])
@pytest.mark.parametrize("halo", [0, 1, 5, 16, 19])
def test_neighbourhoods_do_not_end_where_chunks_do(monkeypatch, chunk, halo) -> None:
    monkeypatch.setattr(module, "_CHUNK", chunk)
    grid = Grid((-3.7, 2.1, 0.3), 0.1, (55, 34, 40))
    for seed in range(2):
        counts = patchy_map(grid, seed)
        function = blurred(halo)
        seen = []

        def watched(part, function=function, seen=seen):
            seen.append(part.grid.shape)
            return function(part)

        table = CellTable.from_neighbourhoods(BrickStatistics.from_dense(counts), watched, halo, OUTSIDE)
        assert np.array_equal(dense(table), function(counts))
        # Nothing spreads over the border into what is left of its bricks.
        rim = everywhere(grid.shape, 1).reshape(-1, 3)
        assert np.array_equal(read_by_kernels(table, rim), table.at(rim))
        assert np.max(seen) <= chunk * BRICK + 2 * halo
        assert (np.diff(table.layout.bricks) > 0).all()


def test_only_chunks_near_something_are_laid_out(monkeypatch) -> None:
    monkeypatch.setattr(module, "_CHUNK", 1)
    grid = Grid((0, 0, 0), 0.5, (160, 160, 160))
    hits = np.zeros(grid.shape)
    hits[82, 82, 82] = 1
    seen = []

    def function(part):
        seen.append(part.grid)
        return part.hits

    CellTable.from_neighbourhoods(BrickStatistics.from_dense(counted(grid, hits, 0.0)), function, 3, 0.0)
    assert len(seen) == 27


def test_planar_grids_have_no_bricks() -> None:
    with pytest.raises(MapError, match="planar"):
        CellTable.from_dense(Grid((0, 0), 1.0, (3, 3)), np.zeros((3, 3)), 0.0)
