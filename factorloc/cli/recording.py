"""Recordings as commands read them: options, scans, and where they begin."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from factorloc.cli.console import console, progress_bar
from factorloc.cli.selection import select_scans

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from factorloc.datasets import Drive

__all__ = ["Mount", "read_recording", "reader_options", "starting_pose"]

Mount = Annotated[
    tuple[float, float, float, float, float, float] | None,
    typer.Option(
        metavar="X Y Z ROLL PITCH YAW",
        help="Where the lidar sits on the body, m and degrees, for recordings in space without calibration.",
    ),
]
"""Option for the pose of a lidar on the body."""


def reader_options(mount: tuple[float, ...] | None) -> dict[str, Any]:
    """Return the options of a reader that were given on the command line."""
    if mount is None:
        return {}
    import numpy as np
    from scipy.spatial.transform import Rotation

    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xyz", mount[3:], degrees=True).as_matrix()
    pose[:3, 3] = mount[:3]
    return {"T_body_sensor": pose}


def read_recording(
    log: Path, *, mount: tuple[float, ...] | None, truth: Path | None, poses: Path | None, scans: str
) -> Drive:
    """Read a recording to be localized; where it holds no odometry, its scans in space give some.

    Parameters
    ----------
    log : Path
        The recording.
    mount : tuple of float, optional
        Of the lidar: x, y, z (m), roll, pitch, yaw (deg); not with a truth.
    truth : Path, optional
        Corrected log that belongs to a raw one.
    poses : Path, optional
        TUM trajectory that takes the place of the truth.
    scans : str
        Which scans to take; see :func:`~factorloc.cli.selection.select_scans`.

    Raises
    ------
    DataError
        If a file cannot be read.
    ConfigError
        If the selection is unknown or empty.
    """
    from dataclasses import replace

    from factorloc.datasets import open_drive
    from factorloc.localization import with_lidar_odometry
    from factorloc.trajectory import Trajectory

    drive: Drive = open_drive(log, **(reader_options(mount) if truth is None else {"truth": truth}))
    planar = drive.dimension == 2
    if poses is not None:
        drive = replace(drive, truth=Trajectory.read_tum(poses, planar=planar).at(drive.stamps))
    drive = drive.select(select_scans(len(drive), scans))
    if not planar and not drive.odometry_known.any():
        with progress_bar("lidar odometry", len(drive)) as progress:
            drive = with_lidar_odometry(drive, progress=progress)
    return drive


def starting_pose(drive: Drive, start: tuple[float, float, float] | None, height: float) -> npt.NDArray[np.float64]:
    """Where a drive begins: as given, or else by its truth.

    Parameters
    ----------
    drive : Drive
        The recording.
    start : (float, float, float), optional
        x and y, m, and heading, deg.
    height : float
        Of a start in space, m.

    Returns
    -------
    ndarray, shape (3,) or (4, 4)
        ``T_map_body``.

    Raises
    ------
    DataError
        If neither is known.
    """
    import numpy as np

    from factorloc.errors import DataError
    from factorloc.geometry import se3

    if start is not None:
        pose = np.array([start[0], start[1], np.radians(start[2])])
        if drive.dimension == 2:
            return pose
        pose = se3.from_se2(pose)
        pose[2, 3] = height
        return pose
    if drive.truth is None:
        raise DataError(
            f"{drive.name}: holds no true poses to start from; say where it begins with --start X Y HEADING"
        )
    console.print("start: the first pose of the truth (choose another with --start X Y HEADING)")
    return np.asarray(drive.truth.poses[0])
