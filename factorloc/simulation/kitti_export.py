"""Drives written in the layout of the KITTI odometry benchmark, which most spatial tools read."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from factorloc.errors import FactorlocError, SimulationError
from factorloc.geometry import se3
from factorloc.simulation.drive import SimulatedDrive

__all__ = ["write_kitti"]

Array = npt.NDArray[np.float64]

_T_CAMERA_LIDAR = np.array([[0.0, -1, 0, 0], [0, 0, -1, -0.08], [1, 0, 0, -0.27], [0, 0, 0, 1]])
"""A camera (x right, y down, z ahead) 8 cm below the lidar and 27 cm ahead of it, as on the car of the benchmark."""


def write_kitti(
    folder: Path | str,
    drive: SimulatedDrive,
    sequence: str = "00",
    *,
    T_camera_lidar: npt.ArrayLike | None = None,
    progress: Callable[[int], None] | None = None,
) -> None:
    """Write a drive as a sequence of the KITTI odometry benchmark, whole or not at all.

    ``sequences/NN`` gets ``velodyne/NNNNNN.bin`` (rows x, y, z, reflectance as little-endian float32, in the lidar
    frame; reflectance is not simulated and 0), ``calib.txt`` (with ``Tr``, lidar to camera 0; there are no cameras to
    project to) and ``times.txt``, from 0 on. ``poses/NN.txt`` gets the truth: poses of camera 0 in its own first frame.
    Rays without return, or below the minimum range, are left out: the format knows only points. Scans are asked for
    one by one, so that a drive that does not hold them is written in little memory.

    Parameters
    ----------
    folder : Path or str
        Gets ``sequences`` and ``poses``; created if needed. The sequence must not be there yet.
    drive : SimulatedDrive
        Spatial.
    sequence : str
        Its number.
    T_camera_lidar : array_like, shape (4, 4), optional
        Pose of the lidar in the frame of camera 0; by default about that of the benchmark.
    progress : callable, optional
        Called with the number of scans written.

    Raises
    ------
    SimulationError
        If the drive is empty or not spatial, its scans differ in mount, the name is no plain file name, or the
        sequence is there already.
    GeometryError
        If the pose is no rigid motion.
    FactorlocError
        If a file cannot be written; nothing is left behind then.
    """
    if len(drive) == 0 or drive.dimension != 3:
        raise SimulationError(f"drive: {len(drive)} scans in {drive.dimension}-D; KITTI holds spatial ones")
    if Path(sequence).name != sequence or sequence in ("", ".", ".."):
        raise SimulationError(f"sequence: {sequence!r}; expected a plain name such as 00")
    folder = Path(folder)
    target, poses = folder / "sequences" / sequence, folder / "poses" / f"{sequence}.txt"
    for path in (target, poses):
        if path.exists():
            raise SimulationError(f"{path}: is there already; remove it or choose another sequence")
    camera = _T_CAMERA_LIDAR if T_camera_lidar is None else se3.as_poses(T_camera_lidar, "T_camera_lidar")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        poses.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{sequence}.", dir=target.parent))
        try:
            mount = _write_sweeps(temporary / "velodyne", drive, progress)
            (temporary / "calib.txt").write_text(f"Tr: {_row(camera)}\n", encoding="utf-8")
            times = "".join(f"{stamp:.9e}\n" for stamp in drive.stamps - drive.stamps[0])
            (temporary / "times.txt").write_text(times, encoding="utf-8")
            T_world_camera = drive.truth.poses @ mount @ se3.inverse(camera)
            lines = "".join(f"{_row(pose)}\n" for pose in se3.between(T_world_camera[0], T_world_camera))
            written = temporary / "poses.txt"
            written.write_text(lines, encoding="utf-8")
            temporary.chmod(0o755)
            # Poses of a sequence that is not there harm nobody; a sequence without its poses would look whole.
            written.replace(poses)
            try:
                temporary.replace(target)
            except OSError:
                poses.unlink(missing_ok=True)
                raise
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
    except OSError as error:
        raise FactorlocError(f"{target}: cannot be written ({error.strerror or error})") from error


def _write_sweeps(folder: Path, drive: SimulatedDrive, progress: Callable[[int], None] | None) -> Array:
    """Write all sweeps; returns the pose of the lidar on the body, which they share."""
    folder.mkdir()
    mount = se3.identity()
    for k, scan in enumerate(drive.scans):
        mount = scan.T_body_sensor if k == 0 else mount
        if (scan.T_body_sensor != mount).any():
            raise SimulationError(f"scan {k}: T_body_sensor differs from that of scan 0; KITTI holds one")
        points = scan.points()
        np.column_stack([points, np.zeros(len(points))]).astype("<f4").tofile(folder / f"{k:06d}.bin")
        if progress:
            progress(k + 1)
    return mount


def _row(pose: Array) -> str:
    return " ".join(f"{value:.12e}" for value in pose[:3].ravel())
