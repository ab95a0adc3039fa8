"""Maps in files: equal after the round trip, read in parts, written whole or not at all."""

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import h5py
import numpy as np
import pytest
from ray_cases import counted

import factorloc
from factorloc.errors import FactorlocError, MapError
from factorloc.mapping import Grid, RayStatistics, read_map, read_map_info, write_map
from factorloc.mapping import storage as module

PROVENANCE = {"recording": "Grüße/a b.log", "": "", "settings": json.dumps({"x": [1, 2]}), "long": "ä" * 70_000}


def random_map(shape: tuple[int, ...] = (700, 300), frame: str = "utm 32, Halle 5 — Süd") -> RayStatistics:
    rng = np.random.default_rng(0)
    grid = Grid(tuple(np.array([-123, 457, 9][: len(shape)]) * 0.1), 0.1, shape, frame)
    hits, misses = (rng.poisson(0.3, shape).astype(np.uint32) for _ in range(2))
    hits.flat[0], misses.flat[-1] = 2**32 - 1, 2**31 + 5
    return RayStatistics(grid, hits, misses, rng.integers(0, 2**60, shape), 17, {"below minimum range": 3, "x": 0})


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, RayStatistics]:
    path, statistics = tmp_path_factory.mktemp("maps") / "hall.h5", random_map()
    write_map(path, statistics, provenance=PROVENANCE)
    return path, statistics


def assert_same(found: RayStatistics, expected: RayStatistics) -> None:
    for name, dtype in [("hits", np.uint32), ("misses", np.uint32), ("path_fixed", np.int64)]:
        array = getattr(found, name)
        assert array.dtype == dtype
        assert array.flags["C_CONTIGUOUS"]
        assert array.flags["WRITEABLE"]
        assert np.array_equal(array, getattr(expected, name))
    assert found.grid == expected.grid
    assert (found.scans, found.left_out) == (expected.scans, expected.left_out)


def test_round_trip(written: tuple[Path, RayStatistics]) -> None:
    path, statistics = written
    assert_same(read_map(path), statistics)
    assert_same(read_map(str(path)), statistics)


@pytest.mark.parametrize("shape", [(1, 1), (1, 1000), (256, 257), (3, 5, 70)])
def test_round_trip_of_any_shape(tmp_path: Path, shape: tuple[int, ...]) -> None:
    statistics = random_map(shape, frame="")
    write_map(tmp_path / "map.h5", statistics)
    assert_same(read_map(tmp_path / "map.h5"), statistics)
    assert read_map_info(tmp_path / "map.h5").provenance == {}


def test_what_a_file_says_of_itself(written: tuple[Path, RayStatistics]) -> None:
    path, statistics = written
    info = read_map_info(str(path))
    assert info.path == path
    assert (info.kind, info.format) == ("factorloc ray statistics", 1)
    assert info.writer == factorloc.__version__
    assert info.created.tzinfo is UTC
    assert timedelta(0) <= datetime.now(UTC) - info.created < timedelta(minutes=5)
    assert info.grid == statistics.grid
    assert (info.scans, info.left_out) == (statistics.scans, statistics.left_out)
    assert info.provenance == PROVENANCE
    assert info.bytes == path.stat().st_size


@pytest.mark.parametrize(
    "region",
    [
        ((-3.0, 50.0), (5.0, 60.0)),
        ((-3.04, 50.01), (-3.02, 50.07)),
        ((-3.0, 50.0), (-3.0, 50.0)),
        ((-99, -99), (0, 52.05)),
        ((-np.inf, 47), (np.inf, 48)),
        ((-np.inf, -np.inf), (np.inf, np.inf)),
    ],
)
def test_a_region_is_a_part_of_the_whole(written: tuple[Path, RayStatistics], region: tuple) -> None:
    path, statistics = written
    part = read_map(path, region=region)
    assert part.grid == statistics.grid.crop(*region)
    window = statistics.grid.window(part.grid)
    for name in ("hits", "misses", "path_fixed"):
        assert np.array_equal(getattr(part, name), getattr(statistics, name)[window])
    assert (part.scans, part.left_out) == (statistics.scans, statistics.left_out)
    # It lies on the raster: the whole takes it in again.
    assert (statistics + RayStatistics.empty(part.grid)).grid == statistics.grid


def test_a_region_reads_its_chunks_only(written: tuple[Path, RayStatistics], tmp_path: Path) -> None:
    path, statistics = written
    damaged = tmp_path / "damaged.h5"
    content = bytearray(path.read_bytes())
    with h5py.File(path) as file:
        chunk = file["misses"].id.get_chunk_info_by_coord((512, 256))
    content[chunk.byte_offset + chunk.size // 2] ^= 1
    damaged.write_bytes(content)
    near, far = ((-9.0, 46.0), (10.0, 50.0)), ((40.0, 72.0), (45.0, 75.0))
    assert np.array_equal(read_map(damaged, region=near).misses, read_map(path, region=near).misses)
    with pytest.raises(MapError, match="damaged or cut short"):
        read_map(damaged, region=far)
    with pytest.raises(MapError, match="damaged or cut short"):
        read_map(damaged)
    assert read_map_info(damaged).grid == statistics.grid


@pytest.mark.parametrize(
    ("region", "message"),
    [
        (((900, 900), (901, 901)), "misses the map"),
        (((5, 5), (4, 4)), "expected two corners of 2 numbers, lower first"),
        (((5, 5, 5), (6, 6, 6)), "expected two corners of 2 numbers"),
        (((np.nan, 5), (6, 6)), "expected two corners of 2 numbers"),
        (((5, 5),), "expected two corners"),
    ],
)
def test_an_impossible_region_is_refused(written: tuple[Path, RayStatistics], region: tuple, message: str) -> None:
    with pytest.raises(MapError, match=message) as caught:
        read_map(written[0], region=region)
    assert "damaged" not in str(caught.value)


def test_a_map_larger_than_memory_is_refused_but_not_its_parts(
    written: tuple[Path, RayStatistics], monkeypatch: pytest.MonkeyPatch
) -> None:
    path, statistics = written
    monkeypatch.setattr("factorloc.mapping.grid._available_memory", lambda: statistics.grid.cells * 16 - 1)
    with pytest.raises(MapError, match=r"hall\.h5: a map of 700 x 300 cells needs"):
        read_map(path)
    assert read_map(path, region=((0, 50), (5, 55))).grid.shape == (50, 50)
    assert read_map_info(path).grid == statistics.grid


def test_a_map_is_small_and_its_layout_the_documented_one(tmp_path: Path) -> None:
    statistics = counted(Grid((0, 0), 0.1, (1000, 1000)), 0, 1.0)
    write_map(tmp_path / "map.h5", statistics)
    assert (tmp_path / "map.h5").stat().st_size < 16e6 / 100
    with h5py.File(tmp_path / "map.h5") as file:
        page = (Path(__file__).parents[2] / "docs" / "formats.md").read_text(encoding="utf-8")
        dense = page.partition("### Sparse maps")[0]
        names = {line.split("`")[1] for line in dense.splitlines() if line.startswith("| `")}
        assert names == set(file.attrs) | set(file)
        assert file.attrs["format"] == module.FORMAT
        for name in file:
            assert (file[name].chunks, file[name].compression, file[name].shuffle) == ((256, 256), "gzip", True)
            assert file[name].fletcher32


@pytest.mark.parametrize("where", ["write_bytes", "chmod"])
def test_a_full_disk_leaves_the_old_file_and_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    path = tmp_path / "map.h5"
    write_map(path, random_map((20, 20)))
    content = path.read_bytes()

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, where, fail)
    with pytest.raises(FactorlocError, match="cannot be written") as caught:
        write_map(path, random_map((30, 30)))
    assert str(caught.value) == f"{path}: cannot be written (No space left on device)"
    assert path.read_bytes() == content
    assert list(tmp_path.iterdir()) == [path]


def test_the_target_is_a_file_in_a_new_folder(tmp_path: Path) -> None:
    write_map(tmp_path / "new" / "map.h5", random_map((3, 3)))
    assert read_map(tmp_path / "new" / "map.h5").grid.shape == (3, 3)
    with pytest.raises(FactorlocError, match="is a folder; name a file"):
        write_map(tmp_path / "new", random_map((3, 3)))


def test_nothing_is_cut_to_fit(tmp_path: Path) -> None:
    path, statistics = tmp_path / "map.h5", random_map((3, 3))
    wide = RayStatistics(statistics.grid, statistics.hits.astype(np.int64), statistics.misses, statistics.path_fixed)
    with pytest.raises(MapError, match="hits: of type int64; a map file holds uint32"):
        write_map(path, wide)
    with pytest.raises(MapError, match="expected names and texts"):
        write_map(path, statistics, provenance={"scans": 5})  # type: ignore[dict-item]
    with pytest.raises(MapError, match=r"frame: .* without NUL"):
        write_map(path, random_map((3, 3), frame="a\0b"))
    with pytest.raises(MapError, match=r"provenance: .* takes texts up to"):
        write_map(path, statistics, provenance={"all": "x" * 2**24})
    assert not path.exists()
    ones = [np.ones((3, 3), dtype) for dtype in (np.uint8, np.uint16, np.int32)]
    write_map(path, RayStatistics(statistics.grid, *ones))
    found = read_map(path)
    assert (found.hits.dtype, found.misses.dtype, found.path_fixed.dtype) == (np.uint32, np.uint32, np.int64)
    assert (found.hits == 1).all()
    assert (found.path_fixed == 1).all()
