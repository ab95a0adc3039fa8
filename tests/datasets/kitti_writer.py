"""Writes small recordings in both KITTI layouts."""

from pathlib import Path

import numpy as np

TR = np.array([[0, -1, 0, -0.01], [0, 0, -1, -0.07], [1, 0, 0, -0.3]], float)
"""T_cam0_velo with plain numbers: the lidar 0.3 m behind the camera, 0.07 m above, 0.01 m to its left."""

IMU_TO_VELO = np.array([[1, 0, 0, -0.8], [0, 1, 0, 0.3], [0, 0, 1, -0.8]], float)
"""T_velo_imu with plain numbers."""

FIX = (49.0, 8.4, 112.0)


def write_points(path: Path, points: np.ndarray) -> None:
    """One sweep; the reflectance says nothing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    np.column_stack([points, np.full(len(points), 0.5)]).astype("<f4").tofile(path)


def sweep(number: int) -> np.ndarray:
    """Five points that tell the sweep's number."""
    return np.array([[number + 2, 0, 0], [0, 3, 0], [0, 0, -2], [0.25, 0.25, 0], [500, 0, 0]], float)


def text(row: np.ndarray) -> str:
    return " ".join(f"{value:.12g}" for value in np.ravel(row))


def write_sequence(root: Path, frames: int = 4, name: str = "07") -> Path:
    """A sequence that drives 1 m a frame straight ahead, in the layout of the odometry benchmark."""
    sequence = root / "sequences" / name
    for k in range(frames):
        write_points(sequence / "velodyne" / f"{k:06d}.bin", sweep(k))
    (sequence / "times.txt").write_text("".join(f"{0.1 * k:.6e}\n" for k in range(frames)))
    (sequence / "calib.txt").write_text(f"P0: {text(np.eye(3, 4))}\nTr: {text(TR)}\n")
    poses = np.tile(np.eye(3, 4), (frames, 1, 1))
    poses[:, 2, 3] = np.arange(frames)  # the camera looks along z
    (root / "poses").mkdir()
    (root / "poses" / f"{name}.txt").write_text("".join(text(pose) + "\n" for pose in poses))
    return sequence


def write_oxts(drive: Path, number: int, row: tuple[float, ...]) -> None:
    folder = drive / "oxts" / "data"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{number:010d}.txt").write_text(text(np.append(row, np.zeros(30 - len(row)))) + "\n")


def write_drive(root: Path, frames: int = 4) -> Path:
    """A drive to the north, some 1.11 m a frame, in the layout of the raw data."""
    drive = root / "2011_09_26" / "2011_09_26_drive_0099_sync"
    for k in range(frames):
        write_points(drive / "velodyne_points" / "data" / f"{k:010d}.bin", sweep(k))
        write_oxts(drive, k, (FIX[0] + 1e-5 * k, FIX[1], FIX[2] + 0.5 * k, 0.01, -0.02, np.pi / 2))
    stamps = "".join(f"2011-09-26 13:02:{25.5 + 0.1 * k:012.9f}\n" for k in range(frames))
    (drive / "velodyne_points" / "timestamps.txt").write_text(stamps)
    calibration = f"calib_time: 25-May-2012 16:47:16\nR: {text(IMU_TO_VELO[:, :3])}\nT: {text(IMU_TO_VELO[:, 3])}\n"
    (drive.parent / "calib_imu_to_velo.txt").write_text(calibration)
    return drive
