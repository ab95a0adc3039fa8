"""Sparse maps on disk: equal to the last bit, read in parts, and refused when damaged."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from spatial_cases import HERE, packed_spatial, spatial_grids, spatial_rays

from factorloc.errors import MapError, MapFormatError
from factorloc.mapping import BrickStatistics, Grid, RayStatistics, read_map, read_map_info, write_map

ARRAYS = ("bricks", "offsets", "local", "hits", "misses", "path_fixed")
in_a_folder = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=30)


def same(a: BrickStatistics, b: BrickStatistics) -> bool:
    equal = all(np.array_equal(getattr(a.cells, name), getattr(b.cells, name)) for name in ARRAYS)
    return equal and (a.grid, a.scans, a.left_out) == (b.grid, b.scans, b.left_out)


@pytest.fixture(scope="module")
def street() -> BrickStatistics:
    rng = np.random.default_rng(1)
    grid = Grid((-10.0, -10.0, -2.0), 0.5, (90, 80, 20))
    hits, misses = (rng.integers(0, 3, grid.shape).astype(np.uint32) for _ in range(2))
    path = rng.integers(0, 2, grid.shape) * 2**19
    path[20:60] = hits[20:60] = misses[20:60] = 0
    return BrickStatistics.from_dense(RayStatistics(grid, hits, misses, path.astype(np.int64), 7, {"lost": 3}))


@in_a_folder
@given(st.data())
def test_what_is_written_is_read(tmp_path: Path, data: st.DataObject) -> None:
    grid = data.draw(spatial_grids())
    statistics = BrickStatistics.empty(grid).add(packed_spatial(data.draw(spatial_rays(grid, 4))), HERE)
    write_map(tmp_path / "map.h5", statistics, provenance={"from": "rays"})
    found = read_map(tmp_path / "map.h5")
    assert isinstance(found, BrickStatistics)
    assert same(found, statistics)
    info = read_map_info(tmp_path / "map.h5")
    assert (info.grid, info.cell_bytes) == (grid, 7 * len(statistics.cells) + 520 * len(statistics.cells.bricks))


@pytest.fixture(scope="module")
def street_file(street, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("street") / "map.h5"
    write_map(path, street)
    return path


@settings(max_examples=30)
@given(st.tuples(*[st.floats(-15, 40)] * 3), st.tuples(*[st.floats(0.1, 30)] * 3))
def test_a_region_is_the_window_of_the_whole(street_file: Path, street, low, size) -> None:
    region = (low, tuple(np.add(low, size)))
    try:
        grid = street.grid.crop(*region)
    except MapError:
        with pytest.raises(MapError, match="misses the map"):
            read_map(street_file, region=region)
        return
    part = read_map(street_file, region=region)
    assert isinstance(part, BrickStatistics)
    assert part.grid == grid
    assert same(part, street.crop(grid))


def test_the_layout_is_the_documented_one(tmp_path: Path, street) -> None:
    write_map(tmp_path / "map.h5", street)
    page = (Path(__file__).parents[2] / "docs" / "formats.md").read_text(encoding="utf-8")
    sparse = page.partition("### Sparse maps")[2].partition("### ")[0]
    rows = [line.split("|")[1:3] for line in sparse.splitlines() if line.startswith("| `")]
    documented = {name: kind.strip() for names, kind in rows for name in names.split("`")[1::2]}
    with h5py.File(tmp_path / "map.h5") as file:
        assert documented == {name: str(file[name].dtype) for name in file}
        assert all(file[name].fletcher32 for name in file)


def damage(path: Path, name: str, change) -> None:
    with h5py.File(path, "r+") as file:
        values = file[name][()]
        change(values)
        file[name][...] = values


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("bricks", lambda v: v.__setitem__(0, v[1])),
        ("bricks", lambda v: v.__setitem__(-1, 10**9)),
        ("offsets", lambda v: v.__setitem__(1, v[2] + 1)),
        ("offsets", lambda v: v.__setitem__(0, 1)),
        ("local", lambda v: v.__setitem__(0, 5000)),
        ("path_fixed", lambda v: v.__setitem__(3, -1)),
    ],
)
def test_arrays_that_disagree_are_refused(tmp_path: Path, street, name, change) -> None:
    path = tmp_path / "map.h5"
    write_map(path, street)
    damage(path, name, change)
    with pytest.raises(MapFormatError, match=r"map\.h5: .*; make it anew"):
        read_map(path)


def test_a_count_that_does_not_fit_is_refused(tmp_path: Path, street) -> None:
    path = tmp_path / "map.h5"
    write_map(path, street)
    with h5py.File(path, "r+") as file:
        file.attrs["cell_count"] = np.int64(3)
    with pytest.raises(MapFormatError, match="is of type"):
        read_map_info(path)


def test_a_planar_grid_has_no_bricks(tmp_path: Path, street) -> None:
    path = tmp_path / "map.h5"
    write_map(path, street)
    with h5py.File(path, "r+") as file:
        file.attrs["shape"], file.attrs["origin"] = np.array([3, 4]), np.zeros(2)
    with pytest.raises(MapFormatError, match="planar"):
        read_map(path)
