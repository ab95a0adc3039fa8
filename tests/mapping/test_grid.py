"""Grids: where cells lie, on one raster for all maps of a frame."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from ray_cases import grids
from strategies import floats

from factorloc.errors import MapError
from factorloc.mapping import Grid
from factorloc.mapping import grid as module
from factorloc.mapping.grid import require_memory

RESOLUTIONS = st.sampled_from([0.05, 0.1, 0.25, 1 / 3, 1.0])
POINTS = st.lists(st.tuples(floats(-300, 300), floats(-300, 300)), min_size=1, max_size=6).map(np.array)


@given(POINTS, RESOLUTIONS, floats(0, 3))
def test_around_holds_its_points_and_no_line_too_many(points: np.ndarray, resolution: float, margin: float) -> None:
    grid = Grid.around(points, resolution, margin)
    rounding = 1e-9
    assert (points.min(0) - margin >= np.array(grid.origin) - rounding).all()
    assert (points.max(0) + margin <= np.array(grid.upper) + rounding).all()
    assert (points.min(0) - margin < np.array(grid.origin) + resolution + rounding).all()
    assert (points.max(0) + margin >= np.array(grid.upper) - resolution - rounding).all()
    inside = points[((points - grid.origin) > rounding).all(1)]
    assert grid.contains(inside).all()


def test_a_point_on_the_upper_face_is_held_even_without_margin() -> None:
    grid = Grid.around([[0.0, 0.0], [1.0, 0.5]], 0.5, margin=0)
    assert grid == Grid((0, 0), 0.5, (3, 2))
    assert grid.contains([[1.0, 0.5], [0.0, 0.0]]).all()


@given(POINTS, POINTS, POINTS, RESOLUTIONS)
def test_union_is_the_smallest_grid_over_both(a: np.ndarray, b: np.ndarray, c: np.ndarray, resolution: float) -> None:
    first, second, third = (Grid.around(points, resolution) for points in (a, b, c))
    union = first.union(second)
    assert union == second.union(first)
    assert union == Grid.around(np.concatenate([a, b]), resolution)
    assert union.union(third) == first.union(second.union(third))
    assert first.union(first) == first
    for part in (first, second):
        assert union.shares_raster(part)
        rows, columns = union.window(part)
        assert (rows.stop - rows.start, columns.stop - columns.start) == part.shape
        corner = [part.centres(0)[0], part.centres(1)[-1]]
        assert union.index(corner).tolist() == [rows.start, columns.stop - 1]


@given(grids(), st.data())
def test_index_contains_and_centres_agree(grid: Grid, data: st.DataObject) -> None:
    i, j = (data.draw(st.integers(-2, n + 1)) for n in grid.shape)
    inside = 0 <= i < grid.shape[0] and 0 <= j < grid.shape[1]
    part = data.draw(st.tuples(floats(0.001, 0.999), floats(0.001, 0.999)))
    point = np.array(grid.origin) + (np.array([i, j]) + part) * grid.resolution
    assert grid.index(point).tolist() == [i, j]
    assert bool(grid.contains(point)) is inside
    if inside:
        centre = [grid.centres(0)[i], grid.centres(1)[j]]
        assert grid.index(centre).tolist() == [i, j]


def test_a_point_on_a_face_belongs_to_the_cell_above() -> None:
    grid = Grid((-1, 2), 0.5, (4, 6))
    assert grid.index([[-1, 2], [-0.5, 2.5], [0.999, 4.999]]).tolist() == [[0, 0], [1, 1], [3, 5]]
    assert grid.contains([[-1, 2], [1, 3], [0, 5]]).tolist() == [True, False, False]
    assert grid.upper == (1, 5)
    assert grid.extent == (-1, 1, 2, 5)
    assert (grid.cells, grid.dimension) == (24, 2)
    assert grid.centres(1).tolist() == [2.25, 2.75, 3.25, 3.75, 4.25, 4.75]


@given(POINTS, RESOLUTIONS, st.tuples(floats(-300, 300), floats(-300, 300)), st.tuples(floats(0, 99), floats(0, 99)))
def test_crop_is_the_part_over_a_box(points, resolution, low, size) -> None:
    grid = Grid.around(points, resolution)
    low, high = np.array(low), np.add(low, size)
    held_low, held_high = np.maximum(low, grid.origin), np.minimum(high, grid.upper)
    if (held_high - held_low < 1e-3).any():
        return
    part = grid.crop(low, high)
    assert grid.shares_raster(part)
    assert grid.union(part) == grid
    assert (np.array(part.origin) <= held_low + 1e-5).all()
    assert (np.array(part.upper) >= held_high - 1e-5).all()
    assert (np.array(part.origin) > held_low - resolution - 1e-9).all()
    assert (np.array(part.upper) < held_high + resolution + 1e-9).all()
    # Its corner is on the raster to the last bit, as if it had been laid there.
    assert (np.round(np.array(part.origin) / resolution) * resolution == part.origin).all()


def test_crop_by_lines_points_and_infinity() -> None:
    grid = Grid.around([[0.0, 0.0], [3.0, 2.0]], 0.1, margin=0)
    assert grid.crop([0.3, 0.6], [0.7, 0.7]).shape == (4, 1)
    assert grid.crop([0.3, 0.6], [0.3, 0.6]).shape == (1, 1)
    assert grid.crop([-np.inf, -9], [np.inf, 9]) == grid
    assert grid.crop([2.95, -np.inf], [9.0, 0.05]).shape == (2, 1)
    off = Grid((0.03, 0.0), 0.1, (5, 5))
    assert off.crop([0.24, 0], [9, 9]).origin == pytest.approx((0.23, 0))
    for low, high in [([5, 5], [6, 6]), ([-2, 0], [-1, 1])]:
        with pytest.raises(MapError, match=r"misses the map, from \(.*\) to \(.*\) m"):
            grid.crop(low, high)
    for low, high in [([1, 0], [0, 1]), ([0, 0, 0], [1, 1, 1]), ([np.nan, 0], [1, 1]), (0, 1)]:
        with pytest.raises(MapError, match="expected two corners of 2 numbers"):
            grid.crop(low, high)


@pytest.mark.parametrize(
    "other",
    [
        Grid((0.05, 0), 0.1, (3, 3)),
        Grid((0, 0), 0.2, (3, 3)),
        Grid((0, 0), 0.1, (3, 3), "utm"),
        Grid((0, 0, 0), 0.1, (3, 3, 3)),
    ],
    ids=["shifted", "coarser", "other frame", "spatial"],
)
def test_grids_of_different_rasters_are_not_mixed(other: Grid) -> None:
    grid = Grid((0, 0), 0.1, (3, 3))
    assert not grid.shares_raster(other)
    with pytest.raises(MapError, match="build both in one frame at one resolution"):
        grid.union(other)
    with pytest.raises(MapError, match="no part of"):
        grid.window(other)


@pytest.mark.parametrize("origin", [(-0.1, 0), (0.1, 0), (0, -5)])
def test_a_window_lies_within(origin: tuple[float, float]) -> None:
    grid = Grid((0, 0), 0.1, (3, 3))
    with pytest.raises(MapError, match="no part of"):
        grid.window(Grid(origin, 0.1, (3, 3)))


def test_spatial_grids() -> None:
    grid = Grid((0, 0, -1), 0.5, (2, 3, 4), "utm")
    assert grid.upper == (1, 1.5, 1)
    assert grid.index([0.6, 0.1, -0.4]).tolist() == [1, 0, 1]
    assert grid.crop([0.1, 0.6, -0.9], [0.2, 1.4, 9]) == Grid((0, 0.5, -1), 0.5, (1, 2, 4), "utm")


@pytest.mark.parametrize(
    ("origin", "resolution", "shape"),
    [
        ((0, 0), 0, (1, 1)),
        ((0, 0), -0.1, (1, 1)),
        ((0, 0), np.nan, (1, 1)),
        ((0, 0), np.inf, (1, 1)),
        ((0, np.nan), 0.1, (1, 1)),
        ((0, 0), 0.1, (1, 0)),
        ((0, 0), 0.1, (1, -1)),
        ((0, 0), 0.1, (1, 1, 1)),
        ((0,), 0.1, (1,)),
        ((0,) * 4, 0.1, (1,) * 4),
    ],
)
def test_an_impossible_grid_is_refused(origin: tuple, resolution: float, shape: tuple) -> None:
    with pytest.raises(MapError, match=r"^grid: .*expected"):
        Grid(origin, resolution, shape)


@pytest.mark.parametrize(
    ("points", "resolution", "margin", "message"),
    [
        ([], 0.1, 1, "no finite points"),
        ([[np.nan, 0]], 0.1, 1, "no finite points"),
        ([0.0, 1.0], 0.1, 1, "no finite points"),
        ([[0.0, 1.0]], 0, 1, "expected a positive length"),
        ([[0.0, 1.0]], np.nan, 1, "expected a positive length"),
        ([[0.0, 1.0]], 0.1, -1, "expected a length"),
        ([[0.0, 1.0]], 0.1, np.nan, "expected a length"),
        ([[0.0, 1e300]], 0.1, 1, "too far for cells of 0.1 m"),
        ([[0.0, 1e300]], 1e-300, 1, "too far for cells of 1e-300 m"),
    ],
)
def test_around_needs_points_and_lengths(points: list, resolution: float, margin: float, message: str) -> None:
    with pytest.raises(MapError, match=message):
        Grid.around(points, resolution, margin)


def test_memory_is_counted_before_it_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    require_memory(2**20, "a little")
    with pytest.raises(MapError, match=r"^all the world needs 931\.3 GiB, .* GiB are free; use a coarser resolution"):
        require_memory(10**12, "all the world")
    # 64 bits are not enough for this one.
    assert Grid((0, 0, 0), 1e-3, (10**7,) * 3).cells == 10**21
    monkeypatch.setattr(module, "_available_memory", lambda: 1000)
    require_memory(1000, "what there is")
    with pytest.raises(MapError, match=r"what there is not needs 0\.0 GiB"):
        require_memory(1001, "what there is not")


def test_where_the_system_tells_nothing_nothing_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def silent() -> int:
        raise OSError

    monkeypatch.setattr(module, "_available_memory", silent)
    require_memory(10**30, "anything")
