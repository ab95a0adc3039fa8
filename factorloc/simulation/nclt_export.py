"""Drives written in the layout of an NCLT session."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from factorloc.errors import FactorlocError, SimulationError
from factorloc.geometry import se2, se3
from factorloc.simulation.drive import SimulatedDrive

__all__ = ["write_nclt"]

Array = npt.NDArray[np.float64]

_UNIT, _OFFSET = 0.005, 100.0  # m
_RECORD = np.dtype([("x", "<u2"), ("y", "<u2"), ("z", "<u2"), ("intensity", "u1"), ("beam", "u1")])
_START = 1_326_030_000.0  # s; time of the first scan, on a day in January 2012
_TRACK = 0.56  # m between the wheels
_PERIOD = 0.02  # s between two measurements of wheels, gyro and IMU
_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


def write_nclt(
    folder: Path | str, drive: SimulatedDrive, session: str = "2012-01-08", *, start: float = _START,
    progress: Callable[[int], None] | None = None,
) -> None:  # fmt: skip
    """Write a spatial drive as a session of the NCLT data set, whole or not at all.

    Sweeps are rounded to 5 mm, as there; hits farther than 100 m along an axis do not fit and are left out. Wheels,
    gyro and IMU measure, 50 times a second, the motions that the drive's odometry has between two scans, at constant
    speed and turn rate.

    Parameters
    ----------
    folder : Path or str
        Gets the session; created if needed. The session must not be there yet.
    drive : SimulatedDrive
        Spatial, at least two scans.
    session : str
        Its date.
    start : float
        Time of the first scan, s of the Unix clock.
    progress : callable, optional
        Called with the number of scans written.

    Raises
    ------
    SimulationError
        If the drive is too short or not spatial, the name is no plain file name, or the session is there already.
    FactorlocError
        If a file cannot be written; nothing is left behind then.
    """
    if len(drive) < 2 or drive.dimension != 3:
        raise SimulationError(
            f"drive: {len(drive)} scans in {drive.dimension}-D; NCLT holds spatial ones, at least two"
        )
    if Path(session).name != session or session in ("", ".", ".."):
        raise SimulationError(f"session: {session!r}; expected a plain name such as 2012-01-08")
    target = Path(folder) / session
    if target.exists():
        raise SimulationError(f"{target}: is there already; remove it or choose another session")
    utimes = np.round((start + drive.stamps - drive.stamps[0]) * 1e6).astype(np.int64)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{session}.", dir=target.parent))
        try:
            _write_sweeps(temporary / "velodyne_sync", drive, utimes, progress)
            _write_table(temporary / f"groundtruth_{session}.csv", utimes, _angles(_FLIP @ drive.truth.poses @ _FLIP))
            _write_sensors(temporary, drive, utimes)
            temporary.chmod(0o755)
            temporary.replace(target)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
    except OSError as error:
        raise FactorlocError(f"{target}: cannot be written ({error.strerror or error})") from error


def _write_sweeps(
    folder: Path, drive: SimulatedDrive, utimes: npt.NDArray[np.int64], progress: Callable[[int], None] | None
) -> None:
    folder.mkdir()
    for k, scan in enumerate(drive.scans):
        points = se3.transform(scan.T_body_sensor, scan.points()) * [1, -1, -1]
        values = np.round((points + _OFFSET) / _UNIT)
        values = values[((values >= 0) & (values < 2**16)).all(1)]
        hits = np.zeros(len(values), _RECORD)
        hits["x"], hits["y"], hits["z"] = values.T
        hits.tofile(folder / f"{utimes[k]}.bin")
        if progress:
            progress(k + 1)


def _angles(poses: Array) -> Array:
    """Positions, and roll, pitch, heading of poses (N, 4, 4); shape (N, 6)."""
    heading, pitch, roll = Rotation.from_matrix(poses[:, :3, :3]).as_euler("ZYX").T
    return np.column_stack([poses[:, :3, 3], roll, pitch, heading])


def _write_sensors(folder: Path, drive: SimulatedDrive, utimes: npt.NDArray[np.int64]) -> None:
    seconds = (utimes - utimes[0]) * 1e-6
    twists = se2.log(se3.to_se2(drive.odometry)) / np.diff(seconds)[:, None]
    times = np.arange(0.0, seconds[-1] + 1e-9, _PERIOD)
    now = np.clip(np.searchsorted(seconds, times, side="right") - 1, 0, len(twists) - 1)
    speed, rate = twists[now, 0], twists[now, 2]
    headings = np.concatenate([[0.0], np.cumsum(twists[:, 2] * np.diff(seconds))])
    heading = headings[now] + rate * (times - seconds[now])
    ticks = utimes[0] + np.round(times * 1e6).astype(np.int64)
    half = _TRACK / 2
    _write_table(folder / "wheels.csv", ticks, np.column_stack([speed - rate * half, speed + rate * half]))
    _write_table(folder / "kvh.csv", ticks, (-heading % (2 * np.pi))[:, None])
    imu = np.zeros((len(ticks), 9))
    imu[:, 5], imu[:, 8] = -9.81, -rate
    _write_table(folder / "ms25.csv", ticks, imu)


def _write_table(path: Path, utimes: npt.NDArray[np.int64], rows: Array) -> None:
    lines = (f"{t},{','.join(f'{v:.9f}' for v in row)}\n" for t, row in zip(utimes, rows, strict=True))
    path.write_text("".join(lines), encoding="ascii")
