"""Storage: a map in one versioned HDF5 file, laid out as docs/formats.md says.

HDF5 rather than zarr, because a map is then *one* file that is renamed into place, read in parts, checked by checksums,
and opened by every tool of the field; a zarr store is a folder of files. Only plain arrays of three fixed types and
attributes are read: nothing in a file is executed, and no other file is followed.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from factorloc._version import __version__
from factorloc.errors import MapError, MapFormatError
from factorloc.files import atomic_path
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.brick_storage import check_bricks, read_bricks, write_bricks
from factorloc.mapping.grid import Grid, require_memory
from factorloc.mapping.hdf5 import CheckedFile, create_array, create_text, creating, opening
from factorloc.mapping.ray_statistics import RayStatistics

__all__ = ["FORMAT", "KIND", "SPARSE_KIND", "MapInfo", "read_map", "read_map_info", "write_map"]

KIND = "factorloc ray statistics"
"""What the file of a dense map says it holds."""

SPARSE_KIND = "factorloc brick statistics"
"""What the file of a sparse map says it holds."""

FORMAT = 1
"""Version of the file formats, apart from the package's own: it grows when older readers could misread a file."""

_ARRAYS: dict[str, np.dtype[Any]] = {
    "hits": np.dtype(np.uint32),
    "misses": np.dtype(np.uint32),
    "path_fixed": np.dtype(np.int64),
}
_MEND = "make it anew with 'factorloc map build'"


@dataclass(frozen=True)
class MapInfo:
    """What a map file says of itself.

    Parameters
    ----------
    path : Path
        The file.
    kind : str
        What it holds.
    format : int
        Version of its format.
    writer : str
        Version of factorloc that wrote it.
    created : datetime
        When, UTC.
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
    cell_bytes : int
        Memory of its cells once read.
    """

    path: Path
    kind: str
    format: int
    writer: str
    created: datetime
    grid: Grid
    scans: int
    provenance: dict[str, str]
    left_out: dict[str, int]
    bytes: int
    cell_bytes: int


def write_map(
    path: Path | str, statistics: RayStatistics | BrickStatistics, *, provenance: Mapping[str, str] | None = None
) -> None:
    """Write a map, whole or not at all.

    Parameters
    ----------
    path : Path or str
        Target; replaced when all is written.
    statistics : RayStatistics or BrickStatistics
        The map, dense or sparse.
    provenance : mapping of str to str, optional
        Where it comes from: recordings, selections, settings.

    Raises
    ------
    MapError
        If the provenance is no text, or an array is of a type that the file would cut.
    FactorlocError
        If the target cannot be written; what was there stays.
    """
    grid, source = statistics.grid, dict(provenance or {})
    if not all(isinstance(text, str) for pair in source.items() for text in pair):
        raise MapError(f"provenance: {source}; expected names and texts")
    texts = {
        "kind": SPARSE_KIND if isinstance(statistics, BrickStatistics) else KIND,
        "factorloc": __version__,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "frame": grid.frame,
        "provenance": json.dumps(source),
        "left_out": json.dumps(statistics.left_out),
    }
    with atomic_path(path) as temporary, creating(temporary) as file:
        for name, text in texts.items():
            create_text(file, name, text)
        file.attrs["format"] = np.int64(FORMAT)
        file.attrs["resolution"] = np.float64(grid.resolution)
        file.attrs["origin"] = np.array(grid.origin)
        file.attrs["shape"] = np.array(grid.shape, np.int64)
        file.attrs["scans"] = np.int64(statistics.scans)
        if isinstance(statistics, BrickStatistics):
            write_bricks(file, statistics.cells)
        else:
            for name, dtype in _ARRAYS.items():
                create_array(file, name, _as_type(name, getattr(statistics, name), dtype))


def _as_type(name: str, values: npt.NDArray[Any], dtype: np.dtype[Any]) -> npt.NDArray[Any]:
    if not np.can_cast(values.dtype, dtype):
        raise MapError(f"{name}: of type {values.dtype}; a map file holds {dtype}")
    return values.astype(dtype, copy=False)


def read_map_info(path: Path | str) -> MapInfo:
    """Read what a map file says of itself; its arrays are looked for, but not read.

    Parameters
    ----------
    path : Path or str
        Map file.

    Raises
    ------
    MapFormatError
        If the file is missing, damaged, of another kind or newer.
    """
    with opening(Path(path), _MEND) as file:
        return _info(file)


def read_map(
    path: Path | str, *, region: tuple[npt.ArrayLike, npt.ArrayLike] | None = None
) -> RayStatistics | BrickStatistics:
    """Read a map, or the part of it that covers a region.

    Parameters
    ----------
    path : Path or str
        Map file.
    region : (low, high), optional
        Two corners in the frame of the map, m. Only the chunks or bricks of cells they touch are read and checked, and
        the grid is the part of the map's that covers them; ``scans`` and ``left_out`` remain those of the whole map.

    Returns
    -------
    RayStatistics or BrickStatistics
        What was written, equal to the last bit.

    Raises
    ------
    MapFormatError
        If the file is missing, damaged, of another kind or newer.
    MapError
        If the region misses the map, or the cells would not fit into memory.
    """
    with opening(Path(path), _MEND) as file:
        info = _info(file)
        grid = info.grid
        if region is not None:
            if len(region) != 2:
                raise MapError(f"region: {region}; expected two corners, the lower and the upper")
            try:
                grid = grid.crop(*region)
            except MapError as error:
                raise MapError(f"{path}: {error}") from error
        if info.kind == SPARSE_KIND:
            return read_bricks(file, info.grid, grid, info.scans, info.left_out)
        require_memory(grid.cells * 16, f"{path}: a map of {' x '.join(map(str, grid.shape))} cells")
        window = info.grid.window(grid)
        hits, misses, path_fixed = (file.file[name][window] for name in _ARRAYS)
        if path_fixed.min() < 0:
            raise file.refused("'path_fixed' is negative somewhere")
    return RayStatistics(grid, hits, misses, path_fixed, info.scans, info.left_out)


def _info(file: CheckedFile) -> MapInfo:
    if "kind" not in file.file.attrs:
        raise file.refused("an HDF5 file, but no map of factorloc")
    if (kind := file.text("kind")) not in (KIND, SPARSE_KIND):
        raise file.refused(f"holds '{kind[:80]}', not '{KIND}'")
    if (version := file.integer("format")) > FORMAT:
        raise MapFormatError(
            f"{file.path}: map format {version}, this factorloc reads up to {FORMAT}; update factorloc"
        )
    if version < 1:
        raise file.refused(f"map format {version}")
    try:
        shape, origin = file.vector("shape", "i"), file.vector("origin", "f")
        grid = Grid(origin, file.number("resolution"), shape, file.text("frame"))
    except MapFormatError:
        raise
    except MapError as error:
        raise file.refused(str(error)) from error
    if kind == SPARSE_KIND:
        check_bricks(file, grid)
    else:
        for name, dtype in _ARRAYS.items():
            file.array(name, dtype, grid.shape)
    provenance, left_out = json.loads(file.text("provenance")), json.loads(file.text("left_out"))
    if not (isinstance(provenance, dict) and all(type(text) is str for text in provenance.values())):
        raise file.refused("attribute 'provenance' is no JSON object of texts")
    if not (isinstance(left_out, dict) and all(type(count) is int and count >= 0 for count in left_out.values())):
        raise file.refused("attribute 'left_out' is no JSON object of counts")
    created = datetime.fromisoformat(file.text("created"))
    if created.utcoffset() != timedelta(0):
        raise file.refused(f"attribute 'created' is {created}, not in UTC")
    size = file.path.stat().st_size
    writer, scans = file.text("factorloc"), file.integer("scans")
    memory = 16 * grid.cells
    if kind == SPARSE_KIND:
        memory = 7 * file.integer("cell_count") + 520 * file.integer("brick_count")
    return MapInfo(file.path, kind, version, writer, created, grid, scans, provenance, left_out, size, memory)
