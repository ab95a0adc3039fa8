"""Map files that are damaged, foreign or hostile: one clear line, whatever they declare."""

import json
import shutil
import zlib
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from test_map_storage import random_map

from factorloc.errors import MapFormatError
from factorloc.mapping import read_map, read_map_info, write_map

NAMES = ("hits", "misses", "path_fixed")
SHAPE = (300, 280)


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("maps") / "hall.h5"
    write_map(path, random_map(SHAPE), provenance={"recording": "a.log"})
    return path


@pytest.fixture
def copy(original: Path, tmp_path: Path) -> Path:
    return Path(shutil.copy(original, tmp_path / "copy.h5"))


def refusal(path: Path, read: Callable[[Path], object] = read_map) -> str:
    """The one line a reader refuses a file with, without its name."""
    with pytest.raises(MapFormatError) as caught:
        read(path)
    line = str(caught.value)
    assert line.startswith(f"{path}: ")
    assert "\n" not in line
    assert len(line) < len(str(path)) + 400
    assert "factorloc map build" in line or "update" in line or "name a file" in line or "cannot be read" in line
    return line.removeprefix(f"{path}: ")


def rewritten(path: Path, change: Callable[[h5py.File], None]) -> Path:
    """The file after a change by h5py, which keeps its checksums in order."""
    with h5py.File(path, "r+", libver=("v110", "v110")) as file:
        change(file)
    return path


def replaced(path: Path, name: str, **options: object) -> Path:
    """The file with a dataset created anew, other than it should be."""

    def change(file: h5py.File) -> None:
        usual = {
            "shape": SHAPE,
            "dtype": file[name].dtype,
            "chunks": (256, 256),
            "compression": "gzip",
            "shuffle": True,
            "fletcher32": True,
        }
        del file[name]
        made = file.create_dataset(name, **{**usual, **options})
        made[...] = 0 if made.dtype.kind in "iuf" else made.dtype.type()

    return rewritten(path, change)


@pytest.mark.parametrize("part", [0, 4, 8, 9, 40, 200, 600, 0.1, 0.3, 0.5, 0.9, -100, -1])
def test_cut_short(copy: Path, part: float) -> None:
    size = copy.stat().st_size
    length = int(size * part) if 0 < part < 1 else int(part) % size
    copy.write_bytes(copy.read_bytes()[:length])
    for read in (read_map, read_map_info):
        line = refusal(copy, read)
        assert "no HDF5 file" in line if length < 9 else "damaged or cut short" in line


def test_every_flipped_bit_is_found_wherever_it_lies(original: Path, tmp_path: Path) -> None:
    content, expected = original.read_bytes(), read_map(original)
    rng = np.random.default_rng(1)
    with h5py.File(original) as file:
        chunks = [file[name].id.get_chunk_info(k) for name in NAMES for k in range(4)]
    inside = [rng.integers(c.byte_offset, c.byte_offset + c.size) for c in chunks for _ in range(2)]
    metadata = np.ones(len(content), bool)
    for chunk in chunks:
        metadata[chunk.byte_offset : chunk.byte_offset + chunk.size] = False
    places = np.flatnonzero(metadata)
    harmless = 0
    for place in [*inside, *range(60), *rng.choice(places, 150)]:
        damaged = bytearray(content)
        damaged[place] ^= 1 << rng.integers(8)
        path = tmp_path / "damaged.h5"
        path.write_bytes(damaged)
        try:
            found = read_map(path)
        except MapFormatError:
            continue
        # Only room that nothing uses may change: what is read is what was written.
        assert metadata[place]
        harmless += 1
        assert all(np.array_equal(getattr(found, name), getattr(expected, name)) for name in NAMES)
        assert (found.grid, found.scans, found.left_out) == (expected.grid, expected.scans, expected.left_out)
    assert harmless < 75


def test_files_of_other_kinds(tmp_path: Path) -> None:
    text = tmp_path / "map.h5"
    text.write_text("FLASER 180 1.0 ...\n" * 100)
    assert refusal(text).startswith("no HDF5 file, so no map")
    assert refusal(tmp_path) == "is a folder; name a file"
    assert refusal(tmp_path / "none.h5").startswith("no such file; make it anew")
    with h5py.File(tmp_path / "old.h5", "w") as file:
        file["x"] = 1
    assert refusal(tmp_path / "old.h5").startswith("HDF5 superblock 0, factorloc writes 3")
    with h5py.File(tmp_path / "other.h5", "w", libver=("v110", "v110")) as file:
        file["x"] = 1
    assert refusal(tmp_path / "other.h5").startswith("an HDF5 file, but no map of factorloc")
    offset = tmp_path / "offset.h5"
    with h5py.File(offset, "w", libver=("v110", "v110"), userblock_size=512) as file:
        file["x"] = 1
    assert refusal(offset).startswith("no HDF5 file")


def test_a_file_one_may_not_read(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    assert refusal(copy) == "cannot be read (Permission denied)"


def text(value: str) -> np.bytes_:
    return np.bytes_(value.encode())


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("kind", text("factorloc poles"), "holds 'factorloc poles', not 'factorloc ray statistics'"),
        ("format", np.int64(2), "map format 2, this factorloc reads up to 1; update factorloc"),
        ("format", np.int64(0), "map format 0; make it anew"),
        ("format", np.int64(-1), "'format' is -1"),
        ("format", np.float64(1), "'format' is of type float64"),
        ("format", text("1"), "'format' is of type |S1"),
        ("resolution", np.float64(0), "expected a positive length"),
        ("resolution", np.float64(np.nan), "'resolution' is nan"),
        ("resolution", np.float64(np.inf), "'resolution' is inf"),
        ("resolution", np.int64(1), "'resolution' is of type int64"),
        ("resolution", np.array([0.1, 0.1]), "'resolution' is of type float64 and shape (2,)"),
        ("origin", np.array([0.0, np.nan]), "expected finite"),
        ("origin", np.array([0.0, 1.0, 2.0]), "expected two or three axes each"),
        ("origin", np.zeros((2, 2)), "'origin' is of type float64 and shape (2, 2)"),
        ("origin", np.zeros(5000), "'origin' is of type float64 and shape (5000,)"),
        ("shape", np.array([300, 0]), "at least one cell"),
        ("shape", np.array([300.0, 280.0]), "'shape' is of type float64"),
        ("shape", np.array([280, 300]), "'hits' is of type uint32 and shape (300, 280), not uint32 and (280, 300)"),
        ("shape", np.array([10**9, 10**9]), "'hits' is of type uint32 and shape (300, 280)"),
        ("shape", np.array([2**62, 2**62]), "'hits' is of type uint32 and shape (300, 280)"),
        ("scans", np.int64(-1), "'scans' is -1"),
        ("frame", np.int64(1), "'frame' is of type int64"),
        ("frame", np.bytes_(b"\xff\xfe"), "damaged or cut short ('utf-8' codec can't decode"),
        ("frame", "of any length", "'frame' is of type object"),
        ("created", text("yesterday"), "damaged or cut short (Invalid isoformat"),
        ("created", text("2026-01-01T00:00:00"), "not in UTC"),
        ("created", text("2026-01-01T00:00:00+01:00"), "not in UTC"),
        ("provenance", text("[1, 2]"), "'provenance' is no JSON object of texts"),
        ("provenance", text('{"a": 1}'), "'provenance' is no JSON object of texts"),
        ("provenance", text("{"), "damaged or cut short (Expecting property name"),
        ("provenance", text("[" * 100_000), "damaged or cut short (maximum recursion depth"),
        ("left_out", text('{"a": "1"}'), "'left_out' is no JSON object of counts"),
        ("left_out", text('{"a": -1}'), "'left_out' is no JSON object of counts"),
        ("left_out", text('{"a": true}'), "'left_out' is no JSON object of counts"),
        ("left_out", text('{"a": 1' + "0" * 10_000 + "}"), "damaged or cut short (Exceeds the limit"),
    ],
)
def test_attributes_are_checked(copy: Path, name: str, value: object, message: str) -> None:
    rewritten(copy, lambda file: file.attrs.__setitem__(name, value))
    for read in (read_map, read_map_info):
        assert message in refusal(copy, read)


@pytest.mark.parametrize(
    "name", ["kind", "format", "factorloc", "created", "frame", "resolution", "origin", "shape", "scans"]
)
def test_no_attribute_may_be_missing(copy: Path, name: str) -> None:
    rewritten(copy, lambda file: file.attrs.__delitem__(name))
    assert ("no map of factorloc" if name == "kind" else f"attribute '{name}' is missing") in refusal(copy)


def test_an_attribute_more_does_no_harm(original: Path, copy: Path) -> None:
    rewritten(copy, lambda file: file.attrs.__setitem__("crs", text("EPSG:25832")))
    assert read_map_info(copy).grid == read_map_info(original).grid


def link(kind: str, target: Path) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        if kind == "soft":
            file.move("hits", "elsewhere")
            file["hits"] = h5py.SoftLink("/elsewhere")
            return
        del file["hits"]
        if kind == "external":
            file["hits"] = h5py.ExternalLink(target, "/hits")
        elif kind == "virtual":
            layout = h5py.VirtualLayout(SHAPE, np.uint32)
            layout[...] = h5py.VirtualSource(target, "hits", SHAPE)
            file.create_virtual_dataset("hits", layout)
        elif kind == "storage":
            file.create_dataset("hits", SHAPE, np.uint32, external=[(str(target), 0, 300 * 280 * 4)])
        elif kind == "group":
            file.create_group("hits")
        elif kind == "type":
            file["hits"] = np.dtype(np.uint32)

    return change


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("nothing", "'hits' is missing or a link"),
        ("soft", "'hits' is missing or a link"),
        ("external", "'hits' is missing or a link"),
        ("virtual", "'hits' does not hold its own values"),
        ("storage", "'hits' does not hold its own values"),
        ("group", "'hits' does not hold its own values"),
        ("type", "'hits' does not hold its own values"),
    ],
)
def test_values_from_elsewhere_are_refused(original: Path, copy: Path, kind: str, message: str) -> None:
    rewritten(copy, link(kind, original))
    for read in (read_map, read_map_info):
        assert message in refusal(copy, read)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"dtype": np.int32}, "'misses' is of type int32 and shape (300, 280), not uint32 and (300, 280)"),
        ({"dtype": np.uint64}, "'misses' is of type uint64"),
        ({"dtype": ">u4"}, "'misses' is of type >u4"),
        ({"dtype": np.float32}, "'misses' is of type float32"),
        ({"dtype": "S4"}, "'misses' is of type |S4"),
        ({"shape": (280, 300)}, "shape (280, 300)"),
        ({"shape": (300 * 280,), "chunks": (256,)}, "shape (84000,)"),
        ({"chunks": (300, 280)}, "not in chunks of (256, 256)"),
        ({"chunks": (32, 32)}, "not in chunks of (256, 256)"),
        ({"fletcher32": False}, "not in chunks of (256, 256), compressed and with checksums"),
        ({"shuffle": False}, "not in chunks of (256, 256), compressed and with checksums"),
        ({"compression": None}, "not in chunks of (256, 256), compressed and with checksums"),
        ({"compression": "lzf"}, "not in chunks of (256, 256), compressed and with checksums"),
        ({"chunks": None, "compression": None, "shuffle": None, "fletcher32": None}, "not in chunks"),
    ],
    ids=str,
)
def test_arrays_are_checked(copy: Path, options: dict, message: str) -> None:
    replaced(copy, "misses", **options)
    for read in (read_map, read_map_info):
        assert message in refusal(copy, read)


def test_a_huge_map_of_holes_is_refused_before_it_is_read(copy: Path) -> None:
    shape = (10**7, 10**7)
    options = {"chunks": (256, 256), "compression": "gzip", "shuffle": True, "fletcher32": True}

    def change(file: h5py.File) -> None:
        file.attrs["shape"] = np.array(shape)
        for name in NAMES:
            dtype = file[name].dtype
            del file[name]
            file.create_dataset(name, shape, dtype, **options)

    rewritten(copy, change)
    for read in (read_map, read_map_info):
        assert "'hits' lacks some of its chunks" in refusal(copy, read)


def direct_chunk(copy: Path, content: bytes, mask: int = 0) -> Path:
    """The file with a chunk of other bytes, as a hostile writer makes it."""
    return rewritten(copy, lambda file: file["hits"].id.write_direct_chunk((0, 0), content, mask) and None)


def test_a_chunk_cannot_dispense_with_its_checksum(copy: Path) -> None:
    direct_chunk(copy, bytes(256 * 256 * 4), mask=0b111)
    assert "'hits' has a chunk of wrong size or without checksum" in refusal(copy)


def test_a_bomb_in_a_chunk_is_refused_by_its_size(copy: Path) -> None:
    bomb = zlib.compress(bytes(2**27), 1)
    assert len(bomb) > 256 * 256 * 4
    direct_chunk(copy, bomb + bytes(4))
    assert "'hits' has a chunk of wrong size or without checksum" in refusal(copy)


def test_negative_paths_are_refused(copy: Path) -> None:
    rewritten(copy, lambda file: file["path_fixed"].__setitem__((299, 3), -1))
    assert "'path_fixed' is negative somewhere" in refusal(copy)
    assert read_map(copy, region=((-12.3, 60), (0, 61))).path_fixed.min() >= 0


def test_left_out_counts_are_exact(copy: Path) -> None:
    rewritten(copy, lambda file: file.attrs.__setitem__("left_out", text(json.dumps({"a": 2**70}))))
    assert read_map(copy).left_out == {"a": 2**70}
