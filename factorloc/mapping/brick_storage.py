"""Storage of sparse maps: the datasets of bricks in a map file."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from factorloc.errors import MapError, MapFormatError
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.bricks import BRICK, BrickLayout
from factorloc.mapping.grid import Grid, require_memory
from factorloc.mapping.hdf5 import CheckedFile
from factorloc.mapping.visited_cells import VisitedCells

__all__ = ["BRICK_ARRAYS", "COUNTS", "check_bricks", "read_bricks"]

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
    cells = file.integer("cell_count")
    if offsets[0] != 0 or offsets[-1] != cells or (np.diff(offsets) < 0).any():
        raise file.refused("'offsets' do not increase to the number of cells")
    if len(bricks) and not 0 <= bricks.min() <= bricks.max() < np.prod(BrickLayout(whole, bricks[:0]).shape):
        raise file.refused("'bricks' has a number that is none of the grid's")
    corners = BrickLayout(whole, bricks).corners()
    shift = np.round((np.array(grid.origin) - whole.origin) / whole.resolution).astype(np.int64)
    near = np.asarray(((corners + BRICK > shift) & (corners < shift + grid.shape)).all(1))
    require_memory(18 * int(np.diff(offsets)[near].sum()), f"{file.path}: a map of {int(near.sum())} bricks")
    arrays = {name: _rows(file, name, offsets, near) for name in ("local", "hits", "misses", "path_fixed")}
    if (arrays["path_fixed"] < 0).any():
        raise file.refused("'path_fixed' is negative somewhere")
    kept = np.concatenate([[0], np.cumsum(np.diff(offsets)[near])])
    try:
        part = BrickStatistics(whole, VisitedCells.in_order(bricks[near], kept, **arrays), scans, left_out)
    except MapFormatError:
        raise
    except MapError as error:
        raise file.refused(str(error)) from error
    return part.crop(grid)


def _rows(
    file: CheckedFile, name: str, offsets: npt.NDArray[np.int64], near: npt.NDArray[np.bool_]
) -> npt.NDArray[Any]:
    """Cells of some bricks, read run by run."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]])))
    runs = [file.file[name][offsets[a] : offsets[b]] for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return np.concatenate([np.zeros(0, BRICK_ARRAYS[name]), *runs])
