"""Storage of sparse maps: the datasets of bricks in a map file."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from factorloc.errors import MapError, MapFormatError
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.bricks import BRICK, BrickLayout
from factorloc.mapping.cell_tiles import CellTiles
from factorloc.mapping.grid import Grid, require_memory
from factorloc.mapping.hdf5 import CheckedFile, create_array, create_array_of

if TYPE_CHECKING:
    import h5py

__all__ = ["BRICK_ARRAYS", "COUNTS", "check_bricks", "read_bricks", "write_bricks"]

Index = npt.NDArray[np.int64]

_MOST_UNPACKED = 1_000_000  # cells at a time

BRICK_ARRAYS: dict[str, np.dtype[Any]] = {
    "bricks": np.dtype(np.int64),
    "offsets": np.dtype(np.int64),
    "local": np.dtype(np.uint16),
    "hits": np.dtype(np.uint32),
    "misses": np.dtype(np.uint32),
    "path_fixed": np.dtype(np.int64),
}
"""Datasets of a sparse map and their types."""

COUNTS = ("brick_count", "cell_count")
"""Attributes that say how long the datasets are."""


def check_bricks(file: CheckedFile, grid: Grid) -> None:
    """Make sure that a file holds all datasets of bricks; nothing is read yet.

    Raises
    ------
    MapFormatError
        If one is missing or of wrong type or length.
    """
    if grid.dimension != 3:
        raise file.refused("bricks of a planar grid")
    bricks, cells = (file.integer(name) for name in COUNTS)
    lengths = {"bricks": bricks, "offsets": bricks + 1}
    for name, dtype in BRICK_ARRAYS.items():
        file.array(name, dtype, (lengths.get(name, cells),))


def write_bricks(file: h5py.File, cells: CellTiles) -> None:
    """Write the datasets and attributes of visited cells, which are unpacked tile by tile."""
    for name, count in zip(COUNTS, (len(cells.bricks), len(cells)), strict=True):
        file.attrs[name] = np.int64(count)
    create_array(file, "bricks", cells.bricks)
    create_array(file, "offsets", cells.offsets)
    for name in ("local", "hits", "misses", "path_fixed"):
        pieces = (getattr(tile, name) for tile in cells.tiles.values())
        create_array_of(file, name, pieces, (len(cells),), BRICK_ARRAYS[name])


def read_bricks(file: CheckedFile, whole: Grid, grid: Grid, scans: int, left_out: dict[str, int]) -> BrickStatistics:
    """Read the bricks that touch a part of the map, and of them the cells within.

    Parameters
    ----------
    file : CheckedFile
        Open map file.
    whole, grid : Grid
        Grid of the map, and the part that is wanted.
    scans, left_out
        Account of the whole map.

    Raises
    ------
    MapFormatError
        If bricks, offsets and cells disagree.
    MapError
        If the cells do not fit into memory.
    """
    bricks, offsets = file.file["bricks"][()], file.file["offsets"][()]
    if offsets[0] != 0 or offsets[-1] != file.integer("cell_count") or (np.diff(offsets) < 0).any():
        raise file.refused("'offsets' do not increase to the number of cells")
    if not (np.diff(bricks) > 0).all():
        raise file.refused("'bricks' does not increase")
    if len(bricks) and not 0 <= bricks.min() <= bricks.max() < np.prod(BrickLayout(whole, bricks[:0]).shape):
        raise file.refused("'bricks' has a number that is none of the grid's")
    corners = BrickLayout(whole, bricks).corners()
    shift = np.round((np.array(grid.origin) - whole.origin) / whole.resolution).astype(np.int64)
    near = np.asarray(((corners + BRICK > shift) & (corners < shift + grid.shape)).all(1))
    require_memory(8 * int(np.diff(offsets)[near].sum()), f"{file.path}: a map of {int(near.sum())} bricks")
    try:
        cells = CellTiles({})
        for rows in _runs(offsets, near):
            cells += _read_run(file, bricks, offsets, rows)
        part = BrickStatistics(whole, cells, scans, left_out)
    except MapFormatError:
        raise
    except MapError as error:
        raise file.refused(str(error)) from error
    return part.crop(grid)


def _runs(offsets: Index, near: npt.NDArray[np.bool_]) -> Iterator[slice]:
    """Runs of wanted bricks that follow each other in the file, of few enough cells to unpack."""
    first = last = 0
    for k in np.flatnonzero(near).tolist():
        if k != last or offsets[k + 1] - offsets[first] > _MOST_UNPACKED:
            if last > first:
                yield slice(first, last)
            first = k
        last = k + 1
    if last > first:
        yield slice(first, last)


def _read_run(file: CheckedFile, bricks: Index, offsets: Index, rows: slice) -> CellTiles:
    """Read and pack the cells of bricks that follow each other."""
    begin, end = offsets[rows.start], offsets[rows.stop]
    arrays = {name: file.file[name][begin:end] for name in ("local", "hits", "misses", "path_fixed")}
    if (arrays["path_fixed"] < 0).any():
        raise file.refused("'path_fixed' is negative somewhere")
    return CellTiles.in_order(bricks[rows], offsets[rows.start : rows.stop + 1] - begin, **arrays)
