"""Storage: a map in one versioned HDF5 file.

HDF5 rather than zarr, because a map is then *one* file that is renamed into place, read in parts, checked by checksums,
and opened by every tool of the field; a zarr store is a folder of files. Only plain arrays of three fixed types and
attributes are read: nothing in a file is executed, and links to other files are refused.

Layout (format 1): attributes ``kind``, ``format``, ``factorloc``, ``created``, ``frame``, ``resolution``, ``origin``,
``shape``, ``scans``, ``provenance`` and ``left_out`` (JSON objects) of the root; datasets ``hits`` and ``misses`` (uint32)
and ``path_fixed`` (int64, 2^-20 m) of the grid's shape, chunked, compressed, with checksums.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from factorloc._version import __version__
from factorloc.errors import MapError, MapFormatError
from factorloc.files import atomic_path
from factorloc.mapping.grid import Grid, require_memory
from factorloc.mapping.ray_statistics import RayStatistics

if TYPE_CHECKING:
    import h5py

__all__ = ["FORMAT", "MapInfo", "read_map", "read_map_info", "write_map"]

KIND = "factorloc ray statistics"
FORMAT = 1
"""Version of the file format, apart from the package's own: it grows when older readers could misread a file."""

_DATASETS = {"hits": np.dtype(np.uint32), "misses": np.dtype(np.uint32), "path_fixed": np.dtype(np.int64)}
_CHUNK = {2: 128, 3: 32}
_MOST_CHUNK_BYTES = 64 * 2**20
_MOST_TEXT = 2**20


@dataclass(frozen=True)
class MapInfo:
    """What a map file says of itself.

    Parameters
    ----------
    path : Path
        The file.
    format : int
        Version of its format.
    writer : str
        Version of factorloc that wrote it.
    created : str
        When, UTC, ISO 8601.
    grid : Grid
        Where the cells lie.
    scans : int
        Scans it was built from.
    provenance : dict of str to str
        Where it comes from.
    left_out : dict of str to int
        Rays that were not used, by reason.
    bytes : int
        Size of the file.
    """

    path: Path
    format: int
    writer: str
    created: str
    grid: Grid
    scans: int
    provenance: dict[str, str]
    left_out: dict[str, int]
    bytes: int


def write_map(path: Path | str, statistics: RayStatistics, *, provenance: Mapping[str, str] | None = None) -> None:
    """Write a map, whole or not at all.

    Parameters
    ----------
    path : Path or str
        Target; replaced when all is written.
    statistics : RayStatistics
        The map.
    provenance : mapping of str to str, optional
        Where it comes from.

    Raises
    ------
    FactorlocError
        If the target cannot be written.
    """
    import h5py

    grid = statistics.grid
    chunks = tuple(min(_CHUNK[grid.dimension], n) for n in grid.shape)
    with atomic_path(path) as temporary, h5py.File(temporary, "w") as file:
        file.attrs.update(
            {
                "kind": KIND,
                "format": FORMAT,
                "factorloc": __version__,
                "created": datetime.now(UTC).isoformat(timespec="seconds"),
                "frame": grid.frame,
                "resolution": grid.resolution,
                "origin": np.array(grid.origin),
                "shape": np.array(grid.shape, np.int64),
                "scans": statistics.scans,
                "provenance": json.dumps(dict(provenance or {})),
                "left_out": json.dumps(statistics.left_out),
            }
        )
        for name, dtype in _DATASETS.items():
            values = getattr(statistics, name)
            options = {"chunks": chunks, "compression": "gzip", "shuffle": True, "fletcher32": True}
            file.create_dataset(name, data=values.astype(dtype, copy=False), **options)


def read_map_info(path: Path | str) -> MapInfo:
    """Read what a map file says of itself, without its cells.

    Raises
    ------
    MapFormatError
        If the file is missing, damaged, of another kind or newer.
    """
    with _opened(path) as file:
        return _info(Path(path), file)


def read_map(
    path: Path | str, *, region: tuple[tuple[float, ...], tuple[float, ...]] | None = None
) -> RayStatistics:
    """Read a map, or the part of it that covers a region.

    Parameters
    ----------
    path : Path or str
        Map file.
    region : (low, high), optional
        Corners in the frame of the map, m; only the chunks they touch are read, and the grid shrinks to the region.

    Raises
    ------
    MapFormatError
        If the file is missing, damaged, of another kind or newer.
    MapError
        If the region misses the map, or the cells would not fit into memory.
    """
    path = Path(path)
    with _opened(path) as file:
        info = _info(path, file)
        grid = info.grid if region is None else _cropped(path, info.grid, region)
        require_memory(grid.cells * 16, f"{path}: a map of {' x '.join(map(str, grid.shape))} cells")
        window = info.grid.window(grid)
        arrays = {name: _dataset(path, file, name, info.grid)[window] for name in _DATASETS}
    if arrays["path_fixed"].min(initial=0) < 0:
        raise MapFormatError(f"{path}: path_fixed is negative somewhere; the file is damaged, build the map again")
    return RayStatistics(grid, arrays["hits"], arrays["misses"], arrays["path_fixed"], info.scans, info.left_out)


@contextmanager
def _opened(path: Path | str) -> Iterator[h5py.File]:
    import h5py

    path = Path(path)
    if not path.is_file():
        raise MapFormatError(f"{path}: no such file; build a map first")
    if not h5py.is_hdf5(path):
        raise MapFormatError(f"{path}: not a map (no HDF5 file); give a file of 'factorloc map build'")
    try:
        with h5py.File(path, "r") as file:
            yield file
    except MapError:
        raise
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, UnicodeError) as error:
        reason = " ".join(str(error).split())
        raise MapFormatError(f"{path}: damaged or cut short ({reason[:120]}); build the map again") from error


def _info(path: Path, file: h5py.File) -> MapInfo:
    def attribute(name: str) -> Any:
        if name not in file.attrs:
            raise MapFormatError(f"{path}: attribute '{name}' is missing; the file is damaged, build the map again")
        return file.attrs[name]

    if "kind" not in file.attrs or str(file.attrs["kind"]) != KIND:
        raise MapFormatError(f"{path}: not a map of factorloc; give a file of 'factorloc map build'")
    version = int(attribute("format"))
    if version != FORMAT:
        raise MapFormatError(f"{path}: map format {version}, this factorloc reads {FORMAT}; update factorloc")
    origin, shape = np.asarray(attribute("origin"), np.float64), np.asarray(attribute("shape"))
    if shape.dtype.kind not in "iu" or shape.ndim != 1 or origin.shape != shape.shape:
        raise MapFormatError(f"{path}: origin and shape do not fit; the file is damaged, build the map again")
    try:
        grid = Grid(tuple(origin), float(attribute("resolution")), tuple(map(int, shape)), str(attribute("frame")))
    except MapError as error:
        raise MapFormatError(f"{path}: {error}; the file is damaged, build the map again") from error
    for name in _DATASETS:
        _dataset(path, file, name, grid)
    texts = {name: str(attribute(name)) for name in ("provenance", "left_out")}
    if max(map(len, texts.values())) > _MOST_TEXT:
        raise MapFormatError(f"{path}: its texts are too long; the file is damaged, build the map again")
    provenance, left_out = (json.loads(text) for text in texts.values())
    return MapInfo(
        path,
        version,
        str(attribute("factorloc")),
        str(attribute("created")),
        grid,
        int(attribute("scans")),
        {str(key): str(value) for key, value in provenance.items()},
        {str(key): int(value) for key, value in left_out.items()},
        path.stat().st_size,
    )


def _dataset(path: Path, file: h5py.File, name: str, grid: Grid) -> h5py.Dataset:
    """A dataset of the file itself, of the declared shape and type, whose chunks unfold to a bounded size."""
    import h5py

    link = file.get(name, getlink=True)
    if not isinstance(link, h5py.HardLink):
        raise MapFormatError(f"{path}: '{name}' is missing or a link; the file is damaged, build the map again")
    found = file[name]
    plain = isinstance(found, h5py.Dataset) and not found.is_virtual and found.external is None
    if not plain or found.shape != grid.shape or found.dtype != _DATASETS[name]:
        raise MapFormatError(
            f"{path}: '{name}' is not a plain {_DATASETS[name]} array of {grid.shape}; build the map again"
        )
    if found.chunks is not None and np.prod(found.chunks, dtype=object) * found.dtype.itemsize > _MOST_CHUNK_BYTES:
        raise MapFormatError(f"{path}: '{name}' has chunks of {found.chunks}; the file is damaged, build the map again")
    return found


def _cropped(path: Path, grid: Grid, region: tuple[tuple[float, ...], tuple[float, ...]]) -> Grid:
    low, high = np.asarray(region, np.float64)
    if low.shape != (grid.dimension,) or not (low < high).all():
        raise MapError(f"region: {region}; expected two corners of {grid.dimension} coordinates, low before high")
    first = np.clip(grid.index(low), 0, grid.shape)
    last = np.clip(np.ceil((high - grid.origin) / grid.resolution - 1e-9).astype(np.int64), 0, grid.shape)
    if not (first < last).all():
        raise MapError(f"{path}: region {region} lies outside the map ({grid.origin} to {grid.upper} m)")
    origin = tuple(float(o + i * grid.resolution) for o, i in zip(grid.origin, first, strict=True))
    return Grid(origin, grid.resolution, tuple(int(n) for n in last - first), grid.frame)
