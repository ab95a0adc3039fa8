"""Text files both KITTI layouts share: calibrations of ``name: numbers``, and times, one line a frame."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import numpy.typing as npt

from factorloc.errors import DataError
from factorloc.files import open_text

__all__ = ["read_calibration", "read_times", "rigid_motion", "seconds", "unix_time"]

Array = npt.NDArray[np.float64]

_RIGID_TOLERANCE = 1e-3  # calibrations are printed with 7 digits


def read_calibration(path: Path) -> dict[str, Array]:
    """Numbers of a calibration file by name; lines whose value is no list of numbers are passed over.

    Parameters
    ----------
    path : Path
        Lines ``name: number number ...``.

    Raises
    ------
    DataError
        If the file cannot be read.
    """
    values: dict[str, Array] = {}
    for _, line in open_text(path):
        name, colon, text = line.partition(":")
        try:
            numbers = np.array([float(word) for word in text.split()])
        except ValueError:  # calib_time is a date
            continue
        if colon and numbers.size:
            values[name.strip()] = numbers
    return values


def rigid_motion(path: Path, name: str, rotation: Array, translation: Array) -> Array:
    """Pose of a printed rotation and translation, its rotation made orthonormal.

    Parameters
    ----------
    path, name : Path, str
        What was read, for messages.
    rotation, translation : ndarray
        9 and 3 numbers, in rows; m.

    Returns
    -------
    ndarray, shape (4, 4)

    Raises
    ------
    DataError
        If numbers are missing, or are no rigid motion to 0.001.
    """
    if rotation.size != 9 or translation.size != 3 or not np.isfinite([*rotation.flat, *translation.flat]).all():
        raise DataError(f"{path}: {name} has not 9 finite numbers of rotation and 3 of translation; fetch it again")
    printed = rotation.reshape(3, 3)
    u, _, vt = np.linalg.svd(printed)
    nearest = u @ vt
    if np.abs(nearest - printed).max() > _RIGID_TOLERANCE or np.linalg.det(nearest) < 0:
        raise DataError(f"{path}: {name} is not a rigid motion; fetch it again")
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = nearest, translation
    return pose


def seconds(text: str) -> float:
    """Time of a line that holds a number, s."""
    return float(text)


def unix_time(text: str) -> float:
    """Time of a line ``2011-09-26 13:02:25.964389445``, s since 1970, the recorder's clock taken for UTC."""
    date, clock = text.split()
    hours, minutes, rest = clock.split(":")
    midnight = datetime.strptime(date, "%Y-%m-%d").replace(tzinfo=UTC).timestamp()
    return midnight + 3600 * int(hours) + 60 * int(minutes) + float(rest)


def read_times(path: Path, parse: Callable[[str], float]) -> dict[int, float]:
    """Times by frame number: line k, counted from 0, is that of frame k.

    Parameters
    ----------
    path : Path
        The file. A blank line is a frame without a time.
    parse : callable
        :func:`seconds` or :func:`unix_time`.

    Raises
    ------
    DataError
        If the file cannot be read, holds no time, or a line is none.
    """
    times: dict[int, float] = {}
    for number, line in open_text(path):
        if not line.strip():
            continue
        try:
            times[number - 1] = parse(line)
        except ValueError as error:
            raise DataError(f"{path}: line {number} is no time: {line.strip()[:40]!r}; fetch it again") from error
        if not np.isfinite(times[number - 1]):
            raise DataError(f"{path}: line {number} is no finite time; fetch it again")
    if not times:
        raise DataError(f"{path}: holds no times; fetch it again")
    return times
