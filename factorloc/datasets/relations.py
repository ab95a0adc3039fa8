"""Relations: measured relative poses between moments of a log, as in Kümmerle et al. (2009)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from factorloc.errors import DataError
from factorloc.files import open_text

__all__ = ["Relations", "read_relations"]

Array = npt.NDArray[np.float64]

_COLUMNS = "t1 t2 x y z roll pitch yaw"
_TICKS = 1e6  # stamps are printed with six decimals; compare them as whole microseconds


@dataclass(frozen=True)
class Relations:
    """Relative poses between stamped moments.

    Parameters
    ----------
    name : str
        Where they come from.
    first, second : ndarray, shape (M,)
        Stamps of the two moments, s; for CARMEN logs the ipc time, which is the key of a drive's scan.
    motions : ndarray, shape (M, 6)
        Pose of the body at the second moment in its frame at the first: x, y, z (m), roll, pitch, yaw (rad).
    """

    name: str
    first: Array
    second: Array
    motions: Array

    def __len__(self) -> int:
        return len(self.motions)

    def planar(self) -> Array:
        """The motions in the plane, rows ``[x, y, theta]``, shape (M, 3)."""
        return self.motions[:, [0, 1, 5]]

    def rows(self, keys: npt.ArrayLike) -> npt.NDArray[np.int64]:
        """Find the two scans of each relation.

        Parameters
        ----------
        keys : array_like, shape (N,)
            Keys of the scans (:attr:`factorloc.datasets.Drive.keys`), s.

        Returns
        -------
        ndarray of int64, shape (M, 2)
            Indices of the scans.

        Raises
        ------
        DataError
            If a stamp belongs to no scan, or to several.
        """
        ticks = np.rint(np.asarray(keys, np.float64) * _TICKS).astype(np.int64)
        wanted = np.rint(np.stack([self.first, self.second], -1) * _TICKS).astype(np.int64)
        order = np.argsort(ticks, kind="stable")
        left, right = (np.searchsorted(ticks[order], wanted, side) for side in ("left", "right"))
        found = right - left
        if (found != 1).any():
            row, column = np.argwhere(found != 1)[0]
            many = "no scan" if found[row, column] == 0 else f"{found[row, column]} scans"
            raise DataError(
                f"{self.name}: {(found != 1).any(axis=1).sum()} of {len(self)} relations do not fit the log "
                f"(first: {wanted[row, column] / _TICKS:.6f} s belongs to {many}); use the raw log they were made for"
            )
        return np.asarray(order[left], np.int64)


def read_relations(path: Path | str) -> Relations:
    """Read a ``.relations`` file: rows ``t1 t2 x y z roll pitch yaw``.

    Parameters
    ----------
    path : Path or str
        The file; ``#`` begins a comment. May be compressed.

    Raises
    ------
    DataError
        If the file is missing, empty, or a row has not eight finite numbers.
    """
    rows: list[list[float]] = []
    for number, line in open_text(path):
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        try:
            row = [float(word) for word in words]
        except ValueError:
            row = []
        if len(row) != 8 or not np.isfinite(row).all():
            raise DataError(f"{path}: line {number} has not 8 finite numbers ({_COLUMNS})")
        rows.append(row)
    if not rows:
        raise DataError(f"{path}: holds no relations")
    table = np.array(rows)
    return Relations(Path(path).name, table[:, 0], table[:, 1], table[:, 2:])
