"""Reader of drives in the layout of the KITTI raw data.

The *body* is the inertial and GPS unit: x forward, y left, z up. The *map* frame has its origin at the first fix of the
drive and points east, north and up there. Sweeps are as the lidar gave them, not compensated for the motion during a
sweep.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from factorloc.datasets.drive import Drive
from factorloc.datasets.kitti_drive import join_frames
from factorloc.datasets.kitti_files import read_calibration, read_times, rigid_motion, unix_time
from factorloc.datasets.oxts import enu_poses, read_oxts
from factorloc.datasets.report import ReadReport
from factorloc.datasets.velodyne import HDL_64E_LIMITS, Frames
from factorloc.errors import DataError
from factorloc.geometry import se3

__all__ = ["KittiRawReader", "read_kitti_raw"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class KittiRawReader:
    """Reader of KITTI raw drives for :func:`factorloc.datasets.open_drive`."""

    name: str = "KITTI raw drive (folder DATE_drive_NNNN_sync with velodyne_points/)"

    def matches(self, path: Path) -> bool:
        """Tell whether a folder holds ``velodyne_points/``."""
        return (path / "velodyne_points").is_dir()

    def read(self, path: Path, **options: Any) -> Drive:
        """Read a drive; options are those of :func:`read_kitti_raw`."""
        return read_kitti_raw(path, **options)


def read_kitti_raw(
    path: Path | str,
    *,
    frames: Frames = slice(None),
    range_limits: tuple[float, float] = HDL_64E_LIMITS,
    T_body_sensor: npt.ArrayLike | None = None,
) -> Drive:
    """Read a drive of the KITTI raw data.

    Sweeps and OXTS rows are matched by the frame numbers in their names, times by line number. Where the drive has OXTS
    rows, sweeps without one are left out and counted. Neither do OXTS rows ever become odometry: there is none; see
    :func:`factorloc.localization.lidar_odometry.with_lidar_odometry`.

    Parameters
    ----------
    path : Path or str
        Folder ``DATE/DATE_drive_NNNN_sync`` with ``velodyne_points/`` and, for the truth, ``oxts/``.
    frames : slice or sequence of int
        Which sweeps to read, as positions among those there are; all by default. A sweep takes some 7 MB of memory.
    range_limits : (float, float)
        Minimum and maximum range, m.
    T_body_sensor : array_like, shape (4, 4), optional
        Pose of the lidar on the inertial unit, instead of the inverse of that in ``DATE/calib_imu_to_velo.txt``.

    Returns
    -------
    Drive
        Spatial, without odometry; with the truth if there are OXTS rows. Stamps are s since 1970.

    Raises
    ------
    DataError
        If a file is missing or damaged.

    Warns
    -----
    FactorlocWarning
        If sweeps without time or OXTS row, OXTS rows that are damaged, or points with NaN were left out.
    """
    path = Path(path)
    folder = path / "velodyne_points"
    if T_body_sensor is None:
        T_body_sensor = se3.inverse(_lidar_from_imu(path.resolve().parent / "calib_imu_to_velo.txt"))
    truth: dict[int, Array] | None = None
    reports: tuple[ReadReport, ...] = ()
    note = "no oxts/data, no truth"
    if (path / "oxts" / "data").is_dir():
        rows, report = read_oxts(path / "oxts" / "data")
        # Of the whole drive, so that parts of it share their map frame.
        first = next(iter(rows.values()))
        truth = dict(zip(rows, enu_poses(np.array(list(rows.values())), first), strict=True))
        reports = (report,)
        note = f"map frame east, north, up about lat {first[0]:.9f} lon {first[1]:.9f} alt {first[2]:.3f} m"
    return join_frames(
        path.resolve().name,
        folder / "data",
        times=read_times(folder / "timestamps.txt", unix_time),
        truth=truth,
        T_body_sensor=T_body_sensor,
        range_limits=range_limits,
        frames=frames,
        reports=reports,
        notes=(note,),
    )


def _lidar_from_imu(path: Path) -> Array:
    """``T_velo_imu`` of a calibration file."""
    if not path.is_file():
        raise DataError(f"{path}: no such file; fetch the calibration, or give the lidar's pose by T_body_sensor=")
    values = read_calibration(path)
    return rigid_motion(path, "R, T", *(values.get(name, np.zeros(0)) for name in ("R", "T")))
