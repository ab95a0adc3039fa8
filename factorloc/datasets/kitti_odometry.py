"""Reader of sequences in the layout of the KITTI odometry benchmark.

The published poses are those of the left camera (camera 0), whose axes point right, down and forward. The *body* here
sits at the centre of that camera, so that the truth is the published one and no calibration enters it, but has the
axes of a vehicle: x forward, y left, z up. The *map* frame is the body at frame 0. ``T_body_sensor`` is the published
calibration ``Tr`` in those axes. Sweeps of this benchmark are already compensated for the motion during a sweep.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from factorloc.datasets.drive import Drive
from factorloc.datasets.kitti_drive import join_frames
from factorloc.datasets.kitti_files import read_calibration, read_times, rigid_motion, seconds
from factorloc.datasets.velodyne import HDL_64E_LIMITS, Frames
from factorloc.errors import DataError
from factorloc.geometry import se3
from factorloc.trajectory import Trajectory

__all__ = ["T_CAMERA_BODY", "KittiOdometryReader", "read_kitti_odometry"]

Array = npt.NDArray[np.float64]

T_CAMERA_BODY: Array = np.array([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
"""Pose of the body in the frame of camera 0: another name for the axes. ``T_CAMERA_BODY @ T @ inverse(T_CAMERA_BODY)``
turns a pose of the body into one that the benchmark takes."""


@dataclass(frozen=True)
class KittiOdometryReader:
    """Reader of KITTI odometry sequences for :func:`factorloc.datasets.open_drive`."""

    name: str = "KITTI odometry sequence (folder sequences/NN with velodyne/)"

    def matches(self, path: Path) -> bool:
        """Tell whether a folder holds ``velodyne/``."""
        return (path / "velodyne").is_dir()

    def read(self, path: Path, **options: Any) -> Drive:
        """Read a sequence; options are those of :func:`read_kitti_odometry`."""
        return read_kitti_odometry(path, **options)


def read_kitti_odometry(
    path: Path | str,
    *,
    frames: Frames = slice(None),
    range_limits: tuple[float, float] = HDL_64E_LIMITS,
    T_body_sensor: npt.ArrayLike | None = None,
    poses: Path | str | None = None,
) -> Drive:
    """Read a sequence of the KITTI odometry benchmark.

    Sweep ``velodyne/NNNNNN.bin`` belongs to row NNNNNN of times and poses. There is no odometry; see
    :func:`factorloc.localization.lidar_odometry.with_lidar_odometry`.

    Parameters
    ----------
    path : Path or str
        Folder ``sequences/NN`` with ``velodyne/``, ``calib.txt`` and ``times.txt``.
    frames : slice or sequence of int
        Which sweeps to read, as positions among those there are; all by default. A sweep takes some 7 MB of memory.
    range_limits : (float, float)
        Minimum and maximum range, m.
    T_body_sensor : array_like, shape (4, 4), optional
        Pose of the lidar on the body, instead of that in ``calib.txt``.
    poses : Path or str, optional
        Poses of camera 0; by default ``poses/NN.txt`` in or beside the folder that holds ``sequences``. Poses that
        lie in the sequence itself are not looked at, as other data sets keep estimates there.

    Returns
    -------
    Drive
        Spatial, without odometry; with the truth if there are poses.

    Raises
    ------
    DataError
        If a file is missing or damaged.

    Warns
    -----
    FactorlocWarning
        If sweeps without time or pose, or points with NaN, were left out.
    """
    path = Path(path)
    number = path.resolve().name
    root = path.resolve().parent.parent
    file = next(
        (f for f in (root / "poses" / f"{number}.txt", root.parent / "poses" / f"{number}.txt") if f.is_file()), None
    )
    file = file if poses is None else Path(poses)
    T_body_camera = se3.inverse(T_CAMERA_BODY)
    truth = None
    if file is not None:
        truth = dict(enumerate(T_body_camera @ Trajectory.read_kitti(file).poses @ T_CAMERA_BODY))
    if T_body_sensor is None:
        T_body_sensor = T_body_camera @ _camera_from_lidar(path / "calib.txt")
    return join_frames(
        f"kitti-{number}",
        path / "velodyne",
        times=read_times(path / "times.txt", seconds),
        truth=truth,
        T_body_sensor=T_body_sensor,
        range_limits=range_limits,
        frames=frames,
        notes=(f"no poses/{number}.txt, no truth" if file is None else f"truth from {file}",),
    )


def _camera_from_lidar(path: Path) -> Array:
    """``T_cam0_velo`` of a calibration file."""
    if not path.is_file():
        raise DataError(f"{path}: no such file; fetch the calibration, or give the lidar's pose by T_body_sensor=")
    numbers = read_calibration(path).get("Tr")
    if numbers is None:
        raise DataError(f"{path}: holds no line Tr (lidar to camera 0); fetch it, or give the pose by T_body_sensor=")
    rows = numbers.reshape(3, 4) if numbers.size == 12 else np.zeros((0, 4))
    return rigid_motion(path, "Tr", rows[:, :3], rows[:, 3])
