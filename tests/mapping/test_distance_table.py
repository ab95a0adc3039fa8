"""Distance tables: every cell's distance to the nearest reflecting one, by brute force."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from ray_cases import SEEDS, counted
from spatial_cases import spatial_grids

from factorloc.errors import MapError
from factorloc.mapping import BrickStatistics, Grid
from factorloc.mapping.distance_table import DistanceTable


def cells_of(grid: Grid) -> np.ndarray:
    return np.moveaxis(np.indices(grid.shape), 0, -1)


@given(spatial_grids(22), SEEDS, st.integers(1, 3), st.sampled_from([0.3, 2.0, 50.0]))
def test_distances_are_those_of_a_search_over_all_cells(grid, seed, factor, farthest) -> None:
    rng = np.random.default_rng(seed)
    hits = np.where(rng.uniform(size=grid.shape) < 0.005, 4, 0)
    hits[tuple(rng.integers(0, grid.shape))] = 4
    counts = counted(grid, hits, np.where(hits > 0, grid.resolution, 0.0))
    table = DistanceTable.from_statistics(counts, factor=factor, farthest=farthest, least_rate=0.5)
    of = table.distances.layout.grid
    assert of.resolution == pytest.approx(factor * grid.resolution)
    coarse = np.zeros(of.shape)
    np.add.at(coarse, tuple(np.indices(grid.shape) // factor), hits)
    path = np.maximum(coarse * grid.resolution / 4, of.resolution)
    places = np.argwhere(coarse > 0.5 * path)
    apart = np.linalg.norm(cells_of(of)[..., None, :] - places, axis=-1).min(-1) * of.resolution
    assert table.distances.at(cells_of(of)) == pytest.approx(np.minimum(apart, farthest), rel=1e-6)
    assert table.distances.outside == pytest.approx(farthest)
    assert table.distances.at([-1, 0, 0]) == pytest.approx(farthest)


def test_a_cell_reflects_from_a_rate_on() -> None:
    grid = Grid((0, 0, 0), 0.5, (8, 1, 1))
    hits, path = np.zeros(grid.shape), np.full(grid.shape, 10.0)
    # 0.4 and 0.6 of 1/m; and one hit along hardly any path, which counts as along one cell.
    hits[1], hits[6], hits[3], path[3] = 4, 6, 1, 1e-3
    counts = counted(grid, hits, path)

    def where(least_rate):
        table = DistanceTable.from_statistics(counts, factor=1, least_rate=least_rate).distances
        return np.flatnonzero(table.at(cells_of(grid))[:, 0, 0] == 0).tolist()

    assert where(0.3) == [1, 3, 6]
    assert where(0.5) == [3, 6]
    assert where(1.9) == [3]
    with pytest.raises(MapError, match=r"no cell has a decay rate above 2.5 1/m; lower least_rate"):
        where(2.5)


def test_bricks_and_dense_maps_have_one_field() -> None:
    grid = Grid((0, 0, 0), 0.2, (40, 30, 20))
    hits = np.zeros(grid.shape)
    hits[20, 10:20, 3:9] = 5
    counts = counted(grid, hits, 0.1)
    fields = [DistanceTable.from_statistics(m) for m in (counts, BrickStatistics.from_dense(counts))]
    assert np.array_equal(*(field.distances.pool for field in fields))
    assert fields[0].blur == fields[0].distances.outside == 4.0
    assert (fields[0].sigma, fields[0].huber) == (0.25, 2.0)


def test_planar_maps_are_refused() -> None:
    with pytest.raises(MapError, match="planar"):
        DistanceTable.from_statistics(counted(Grid((0, 0), 1.0, (3, 3)), 1, 1.0))
