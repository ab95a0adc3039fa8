"""Sweeps of a Velodyne lidar as KITTI stores them: a file each, rows of x, y, z, reflectance in little-endian float32.

The file is named by the number of its frame, by which calibration, times and poses are matched to it. A point at
(0, 0, 0) stands for no measurement.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from factorloc.errors import DataError

__all__ = ["HDL_64E_LIMITS", "Frames", "read_points", "select_frames", "sweep_files"]

Array = npt.NDArray[np.float64]
Frames = slice | Sequence[int] | npt.NDArray[np.integer] | npt.NDArray[np.bool_]
"""Which sweeps to read: a slice, indices that increase or a mask, among those there are."""

HDL_64E_LIMITS = (0.9, 120.0)
"""Minimum and maximum range of the Velodyne HDL-64E, m."""

_ROW = np.dtype("<f4").itemsize * 4


def sweep_files(folder: Path) -> dict[int, Path]:
    """Files of a folder by frame number, in increasing order.

    Parameters
    ----------
    folder : Path
        Holds ``NNNNNN.bin`` files; others are not looked at.

    Raises
    ------
    DataError
        If there is no such folder, it holds no sweep, or two of one number.
    """
    if not folder.is_dir():
        raise DataError(f"{folder}: no such folder; it should hold the sweeps, NNNNNN.bin")
    found = sorted((int(path.stem), path) for path in folder.glob("*.bin") if path.stem.isdecimal())
    if not found:
        raise DataError(f"{folder}: holds no sweep; files are named by their frame numbers, NNNNNN.bin")
    files = dict(found)
    if len(files) < len(found):
        raise DataError(f"{folder}: {len(found) - len(files)} frame numbers occur twice; remove one file of each")
    return files


def select_frames(folder: Path, numbers: Sequence[int], frames: Frames) -> list[int]:
    """Frame numbers of some of the sweeps.

    Parameters
    ----------
    folder : Path
        Where they lie, for messages.
    numbers : sequence of int
        Frame numbers there are, increasing.
    frames : Frames
        Which of them, as positions in that sequence.

    Raises
    ------
    DataError
        If nothing is selected, a position does not exist, or they do not increase.
    """
    try:
        rows = np.arange(len(numbers))[frames if isinstance(frames, slice) else np.asarray(frames)]
    except IndexError as error:
        raise DataError(f"{folder}: frames: cannot select from {len(numbers)} sweeps ({error})") from error
    if rows.ndim != 1 or rows.size == 0 or (np.diff(rows) <= 0).any():
        raise DataError(f"{folder}: frames: select at least one of {len(numbers)} sweeps, in increasing order")
    return [numbers[row] for row in rows]


def read_points(path: Path) -> tuple[Array, int, int]:
    """Read the points of one sweep.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    ndarray, shape (N, 3)
        Measured points in the sensor frame, m.
    int
        Points left out at (0, 0, 0).
    int
        Points left out with a coordinate that is NaN or infinite.

    Raises
    ------
    DataError
        If the file is missing, empty or cut short.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror})") from error
    if not data:
        raise DataError(f"{path}: is empty; fetch it again")
    if len(data) % _ROW:
        raise DataError(f"{path}: cut short, {len(data)} bytes are no multiple of {_ROW}; fetch it again")
    points = np.frombuffer(data, "<f4").reshape(-1, 4)[:, :3].astype(np.float64)
    finite = np.isfinite(points).all(axis=1)
    measured = (points != 0).any(axis=1)
    return points[finite & measured], int((~measured).sum()), int((~finite).sum())
