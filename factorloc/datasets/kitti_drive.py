"""How both KITTI layouts become a drive: sweeps, times and poses joined by frame number."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from factorloc.datasets.drive import Drive
from factorloc.datasets.report import ReadReport, Tally
from factorloc.datasets.velodyne import Frames, read_points, select_frames, sweep_files
from factorloc.errors import DataError, FactorlocWarning
from factorloc.geometry import se3
from factorloc.scan import Scan
from factorloc.trajectory import Trajectory

__all__ = ["join_frames"]

Array = npt.NDArray[np.float64]


def join_frames(
    name: str,
    folder: Path,
    *,
    times: Mapping[int, float],
    truth: Mapping[int, Array] | None,
    T_body_sensor: npt.ArrayLike,
    range_limits: tuple[float, float],
    frames: Frames,
    reports: tuple[ReadReport, ...] = (),
    notes: tuple[str, ...] = (),
) -> Drive:
    """Read the sweeps of a folder and join them with what is known of their frames.

    A sweep without a time, or without a pose where others have one, is left out and counted. There is no odometry: no
    motion is known, and none is taken from the truth.

    Parameters
    ----------
    name : str
        What to call the drive.
    folder : Path
        Where the sweeps lie.
    times : mapping of int to float
        Times by frame number, s.
    truth : mapping of int to ndarray (4, 4), or None
        Poses ``T_map_body`` by frame number; None if there is no truth.
    T_body_sensor : array_like, shape (4, 4)
        Pose of the lidar on the body.
    range_limits : (float, float)
        Minimum and maximum range, m.
    frames : slice or sequence of int
        Which sweeps to read, as positions among those there are.
    reports, notes : tuple
        Accounts of other files, and notes to add to that of the sweeps.

    Raises
    ------
    DataError
        If a file cannot be read, or no sweep is left.

    Warns
    -----
    FactorlocWarning
        If frames, or points with NaN, were left out.
    """
    files = sweep_files(folder)
    chosen = select_frames(folder, list(files), frames)
    mount = se3.as_poses(T_body_sensor, "T_body_sensor")
    tally = Tally("frame")
    tally.lines = len(files)
    for _ in range(len(files) - len(chosen)):
        tally.ignore("not selected")
    scans: dict[int, Scan] = {}
    origins = undefined = 0
    for number in chosen:
        if number not in times:
            tally.damage("sweep without a time", number)
        elif truth is not None and number not in truth:
            tally.damage("sweep without a pose of the truth", number)
        else:
            points, at_origin, not_finite = read_points(files[number])
            origins, undefined = origins + at_origin, undefined + not_finite
            scans[number] = Scan.from_points(
                points, range_limits, stamp=times[number], frame="velodyne", T_body_sensor=mount
            )
            tally.use("sweeps")
    counted = {"at (0, 0, 0), no measurement": origins, "not finite": undefined}
    notes = (*notes, *(f"{count} points {kind}, left out" for kind, count in counted.items() if count))
    report = tally.report(folder, notes)
    if not scans:
        raise DataError(f"{folder}: no sweep can be used ({report.damage()})")
    lost = [report.damage()] if report.damaged else []
    lost += [f"{undefined} points that are not finite left out"] if undefined else []
    lost += [f"{other.path}: {other.damage()}" for other in reports if other.damaged]
    if lost:
        warnings.warn(f"{folder}: {'; '.join(lost)}", FactorlocWarning, stacklevel=3)
    stamps = np.array([scan.stamp for scan in scans.values()])
    return Drive(
        name=name,
        scans=tuple(scans.values()),
        odometry=se3.identity((len(scans) - 1,)),
        odometry_known=np.zeros(len(scans) - 1, np.bool_),
        truth=None if truth is None else Trajectory(stamps, np.array([truth[number] for number in scans])),
        keys=np.array(list(scans), np.float64),
        reports=(report, *reports),
    )
