"""OXTS: the fused GPS and inertial poses of KITTI raw drives, a text file a frame.

A row begins with latitude, longitude (degrees), altitude (m), roll, pitch, yaw (rad): of the inertial unit, whose axes
point forward, left and up. Yaw 0 is east and grows counter-clockwise; roll is positive with the left side up, pitch
with the front down. So ``R_enu_imu = R_z(yaw) R_y(pitch) R_x(roll)``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from factorloc.datasets.report import ReadReport, Tally
from factorloc.errors import DataError
from factorloc.geometry import se3

__all__ = ["enu_poses", "read_oxts"]

Array = npt.NDArray[np.float64]

_COLUMNS = 30
_BOUNDS = np.array([90.0, 180.0, 1e5, 7.0, 7.0, 7.0])  # of the columns used


def read_oxts(folder: Path) -> tuple[dict[int, Array], ReadReport]:
    """Read the rows of a folder, by frame number.

    Parameters
    ----------
    folder : Path
        Holds ``NNNNNNNNNN.txt`` files of 30 numbers.

    Returns
    -------
    dict of int to ndarray, shape (6,)
        Latitude, longitude (degrees), altitude (m), roll, pitch, yaw (rad) of each frame.
    ReadReport
        Account of the files; damaged ones are left out.

    Raises
    ------
    DataError
        If no row is sound.
    """
    tally = Tally("frame")
    rows: dict[int, Array] = {}
    for number, path in sorted((int(path.stem), path) for path in folder.glob("*.txt") if path.stem.isdecimal()):
        tally.lines += 1
        try:
            row = np.array([float(word) for word in path.read_text(encoding="ascii", errors="replace").split()])
        except (ValueError, OSError):
            row = np.zeros(0)
        if row.size != _COLUMNS or not (np.abs(row[:6]) <= _BOUNDS).all():
            tally.damage(f"not {_COLUMNS} numbers with a place on earth", number)
            continue
        rows[number] = row[:6]
        tally.use("rows")
    report = tally.report(folder)
    if not rows:
        raise DataError(f"{folder}: holds no sound row ({report.damage()}); fetch it again")
    return rows, report


def enu_poses(rows: npt.ArrayLike, origin: npt.ArrayLike) -> Array:
    """Poses of the inertial unit in the plane tangent to the earth at a point, with axes east, north and up there.

    The frame is Cartesian, as lidar is: far from the origin the ground falls below its plane (0.08 m at 1 km), and each
    attitude, which refers to the local horizon, is turned with it.

    Parameters
    ----------
    rows : array_like, shape (N, 6)
        Latitude, longitude (degrees), altitude (m), roll, pitch, yaw (rad), on WGS 84.
    origin : array_like, shape (3,) or longer
        Latitude, longitude (degrees) and altitude (m) of the origin.

    Returns
    -------
    ndarray, shape (N, 4, 4)
        ``T_enu_imu``.
    """
    from pyproj import Transformer

    table = np.asarray(rows, np.float64)
    lat_0, lon_0, h_0 = np.asarray(origin, np.float64)[:3].tolist()
    local = Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lat_0={lat_0!r} +lon_0={lon_0!r} +h_0={h_0!r}"
    )
    poses = se3.identity((len(table),))
    poses[:, :3, 3] = np.stack(local.transform(table[:, 1], table[:, 0], table[:, 2]), -1)
    R_enu_local = _horizon(lat_0, lon_0).T @ _horizon(table[:, 0], table[:, 1])
    R_local_imu = Rotation.from_euler("ZYX", table[:, [5, 4, 3]]).as_matrix()
    poses[:, :3, :3] = R_enu_local @ R_local_imu
    return poses


def _horizon(lat: npt.ArrayLike, lon: npt.ArrayLike) -> Array:
    """Rotations whose columns are east, north and up in earth-centred axes, shape (..., 3, 3)."""
    phi, lam = np.radians(lat), np.radians(lon)
    east = np.stack([-np.sin(lam), np.cos(lam), np.zeros_like(lam)], -1)
    up = np.stack([np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam), np.sin(phi)], -1)
    return np.stack([east, np.cross(up, east), up], -1)
