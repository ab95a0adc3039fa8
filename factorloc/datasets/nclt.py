"""Reader of the NCLT data set (Carlevaris-Bianco, Ushani and Eustice, IJRR 2016).

Everything in the files has axes that point forward, right and down; times are microseconds of the Unix clock. Here the
body has axes forward, left and up, and the map is turned likewise: x stays, y and z change their signs, and so do pitch
and heading. Files of a session:

- ``velodyne_sync/<utime>.bin``: records of 8 bytes, little-endian uint16 x, y, z and uint8 intensity, beam; coordinates
  are ``0.005 * value - 100`` m, in the frame of the body, corrected for its motion;
- ``groundtruth_<date>.csv``: utime, x, y, z (m), roll, pitch, heading (rad);
- ``wheels.csv``: utime, left and right speed (m/s); ``kvh.csv``: utime, heading (rad) of the fibre-optic gyro;
  ``ms25.csv``: utime, magnetic field, acceleration and turn rates (rad/s) about x, y and z.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from factorloc.datasets.drive import Drive
from factorloc.datasets.nclt_odometry import NcltNoise, NcltSensors, fuse_odometry
from factorloc.datasets.report import Tally
from factorloc.datasets.velodyne import Frames, select_frames, sweep_files
from factorloc.errors import DataError
from factorloc.geometry import se3
from factorloc.scan import Scan
from factorloc.trajectory import Trajectory

__all__ = ["HDL_32E_LIMITS", "NCLT_RECORD", "NcltReader", "read_nclt"]

Array = npt.NDArray[np.float64]

HDL_32E_LIMITS = (1.0, 100.0)
"""Minimum and maximum range of the Velodyne HDL-32E, m."""

NCLT_RECORD = np.dtype([("x", "<u2"), ("y", "<u2"), ("z", "<u2"), ("intensity", "u1"), ("beam", "u1")])
"""One hit of ``velodyne_sync``."""

_MICRO = 1e-6
_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
_LIDAR_HEIGHT = 0.957  # m above the origin of the body, where rays begin
_COLUMNS = {"groundtruth": 7, "wheels": 3, "kvh": 2, "ms25": 10}
_TILT, _HEAVE = 0.02, 0.05  # rad, m; what planar odometry does not tell of a motion


@dataclass(frozen=True)
class NcltReader:
    """Reader of NCLT sessions for :func:`factorloc.datasets.open_drive`."""

    name: str = "NCLT session (folder with velodyne_sync/)"

    def matches(self, path: Path) -> bool:
        """Tell whether a folder holds ``velodyne_sync/``."""
        return (path / "velodyne_sync").is_dir()

    def read(self, path: Path, **options: Any) -> Drive:
        """Read a session; options are those of :func:`read_nclt`."""
        return read_nclt(path, **options)


def read_nclt(
    path: Path | str,
    *,
    frames: Frames = slice(None),
    range_limits: tuple[float, float] = HDL_32E_LIMITS,
    noise: NcltNoise | None = None,
    groundtruth: Path | str | None = None,
) -> Drive:
    """Read a session.

    Odometry is fused of wheels, gyro and IMU (:mod:`~factorloc.datasets.nclt_odometry`). The truth is interpolated at
    the scans; those before or after it are left out.

    Parameters
    ----------
    path : Path or str
        Folder of the session, named by its date. The tables lie in it, in ``sensor_data`` within it or beside it, and
        the truth in it or in ``ground_truth`` beside it.
    frames : slice or sequence of int
        Which sweeps to read, as positions among those there are.
    range_limits : (float, float)
        Minimum and maximum range, m.
    noise : NcltNoise, optional
        Of the sensors.
    groundtruth : Path or str, optional
        The truth, if it lies elsewhere.

    Raises
    ------
    DataError
        If a file is missing or damaged.
    """
    path = Path(path)
    date, tally = path.resolve().name, Tally("frame")
    folder = path / "velodyne_sync"
    files = sweep_files(folder)
    numbers = select_frames(folder, list(files), frames)
    truth_file = _find(path, f"groundtruth_{date}.csv", groundtruth)
    truth = None if truth_file is None else _truth(truth_file)
    tally.lines = len(numbers)
    scans, kept = [], []
    for number in numbers:
        if truth is not None and not truth.stamps[0] <= number * _MICRO <= truth.stamps[-1]:
            tally.damage("outside of the truth's times", number)
            continue
        points = _points(files[number])
        if len(points) == 0:
            tally.damage("without a hit", number)
            continue
        kept.append(number * _MICRO)
        scans.append(_scan(points, number * _MICRO, range_limits))
        tally.use("sweeps")
    if not scans:
        raise DataError(f"{folder}: no sweep with hits within the times of the truth; do both belong to one session?")
    stamps = np.array(kept)
    motions, covariances, known, notes = _odometry(path, stamps, noise)
    report = tally.report(folder, notes)
    at_scans = None if truth is None else truth.at(stamps)
    return Drive(f"nclt-{date}", tuple(scans), motions, known, at_scans, stamps, stamps, (report,), covariances)


def _points(path: Path) -> Array:
    """Hits of a sweep in the frame of the body, x forward, y left, z up, m, (N, 3)."""
    data = path.read_bytes()
    if len(data) % NCLT_RECORD.itemsize:
        raise DataError(f"{path}: {len(data)} bytes are no whole number of 8-byte hits; fetch it again")
    hits = np.frombuffer(data, NCLT_RECORD)
    if (hits["beam"] > 31).any():
        raise DataError(f"{path}: names beams beyond 31; is it a sweep of velodyne_sync?")
    return np.column_stack([(0.005 * hits[axis] - 100.0) * sign for axis, sign in (("x", 1), ("y", -1), ("z", -1))])


def _scan(points: Array, stamp: float, range_limits: tuple[float, float]) -> Scan:
    mount = np.eye(4)
    mount[2, 3] = _LIDAR_HEIGHT
    return Scan.from_points(points - mount[:3, 3], range_limits, stamp=stamp, frame="velodyne", T_body_sensor=mount)


def _truth(path: Path) -> Trajectory:
    rows = _table(path, "groundtruth")
    rows = rows[np.isfinite(rows).all(1)]
    rows = rows[np.unique(rows[:, 0], return_index=True)[1]]
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, :3] = Rotation.from_euler("ZYX", rows[:, [6, 5, 4]]).as_matrix()
    poses[:, :3, 3] = rows[:, 1:4]
    return Trajectory(rows[:, 0] * _MICRO, _FLIP @ poses @ _FLIP)


def _odometry(
    path: Path, stamps: Array, noise: NcltNoise | None
) -> tuple[Array, Array | None, npt.NDArray[np.bool_], tuple[str, ...]]:
    wheels = _find(path, "wheels.csv")
    unknown = np.tile(np.eye(4), (len(stamps) - 1, 1, 1)), None, np.zeros(len(stamps) - 1, np.bool_)
    if wheels is None:
        return (*unknown, ("no wheels.csv, no odometry",))
    gyro, imu = _find(path, "kvh.csv"), _find(path, "ms25.csv")
    none = np.zeros((0, 2))
    sensors = NcltSensors(
        _timed(_table(wheels, "wheels")),
        none if gyro is None else _timed(_table(gyro, "kvh")) * [1, -1],
        none if imu is None else _timed(_table(imu, "ms25"))[:, [0, 9]] * [1, -1],
    )
    planar, planar_covariances, known = fuse_odometry(sensors, stamps, noise)
    covariances = np.zeros((len(planar), 6, 6))
    axes = np.array([3, 4, 2])
    covariances[:, axes[:, None], axes] = planar_covariances
    covariances[:, [0, 1], [0, 1]], covariances[:, 5, 5] = _TILT**2, _HEAVE**2
    missing = tuple(f"no {name}" for name, file in (("kvh.csv", gyro), ("ms25.csv", imu)) if file is None)
    return se3.from_se2(planar), covariances, known, ("odometry fused of wheels, gyro and IMU", *missing)


def _timed(rows: Array) -> Array:
    """Finite rows in order of time, in seconds."""
    rows = rows[np.isfinite(rows).all(1)]
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    rows[:, 0] *= _MICRO
    return rows


def _table(path: Path, kind: str) -> Array:
    try:
        rows = np.loadtxt(path, delimiter=",", ndmin=2)
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: no table of numbers ({error}); fetch it again") from error
    if rows.size == 0 or rows.shape[1] != _COLUMNS[kind]:
        raise DataError(f"{path}: rows of {rows.shape[1] if rows.size else 0} numbers; {kind} has {_COLUMNS[kind]}")
    return rows


def _find(path: Path, name: str, given: Path | str | None = None) -> Path | None:
    if given is not None:
        if not Path(given).is_file():
            raise DataError(f"{given}: no such file")
        return Path(given)
    date, root = path.resolve().name, path.resolve().parent
    places = (path, path / "sensor_data", root / "sensor_data" / date, root / "ground_truth")
    return next((place / name for place in places if (place / name).is_file()), None)
