"""Drives written as CARMEN logs, the text format that most planar mapping tools read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from factorloc.errors import SimulationError
from factorloc.files import write_text
from factorloc.geometry import se2
from factorloc.scan import RayStatus, Scan
from factorloc.simulation.drive import SimulatedDrive
from factorloc.simulation.odometry import integrate_odometry

__all__ = ["write_carmen"]

Array = npt.NDArray[np.float64]

_HOST = "simulation"
_RESOLUTION = 1e-3  # of printed ranges, m
_BEAM_STEPS = {180: np.pi / 180, 181: np.pi / 180, 360: np.pi / 360, 361: np.pi / 360}


def write_carmen(path: Path | str, drive: SimulatedDrive, *, corrected: bool = False) -> None:
    """Write a drive as a CARMEN log, whole or not at all.

    A raw log holds dead reckoning from the first true pose, in an ``ODOM`` line before each ``FLASER`` line. In a
    corrected log, ``FLASER`` lines hold the truth; the ``ODOM`` lines between two of them start at the truth of the
    first and end with the measured motion to the second. A ray below the minimum range is written as 0, one without
    return as the maximum range.

    Parameters
    ----------
    path : Path or str
        The log to write.
    drive : SimulatedDrive
        Planar, of 180 or 181 beams (every degree) or 360 or 361 (every half degree), from a lidar straight ahead.
    corrected : bool
        Whether to write true poses instead of dead reckoning.

    Raises
    ------
    SimulationError
        If the format cannot hold the scans.
    FactorlocError
        If the file cannot be written.
    """
    first = _checked(drive.scans)
    offset, (_, maximum) = first.T_body_sensor[0], first.range_limits
    truth, stamps = drive.truth.poses, drive.stamps
    reckoned = integrate_odometry(truth[0], drive.odometry)
    lines = [
        "# message_name [message contents] ipc_timestamp ipc_hostname logger_timestamp",
        "# PARAM param_name param_value",
        "# ODOM x y theta tv rv accel",
        "# FLASER num_readings [range_readings] x y theta odom_x odom_y odom_theta",
        f"PARAM robot_frontlaser_offset {offset:.6f} {stamps[0]:.6f} {_HOST} 0.000000",
        f"PARAM robot_front_laser_max {maximum:.6f} {stamps[0]:.6f} {_HOST} 0.000000",
    ]
    velocities = np.zeros((len(drive), 2))
    velocities[1:] = drive.odometry[:, [0, 2]] / np.diff(stamps)[:, None]
    for k, scan in enumerate(drive.scans):
        end = f"{stamps[k]:.6f} {_HOST} {stamps[k] - stamps[0]:.6f}"
        if corrected and k > 0:
            before = f"{stamps[k - 1]:.6f} {_HOST} {stamps[k - 1] - stamps[0]:.6f}"
            lines.append(_odom(truth[k - 1], velocities[k - 1], before))
            lines.append(_odom(se2.compose(truth[k - 1], drive.odometry[k - 1]), velocities[k], end))
        elif not corrected:
            lines.append(_odom(reckoned[k], velocities[k], end))
        body = truth[k] if corrected else reckoned[k]
        poses = np.concatenate([se2.compose(body, scan.T_body_sensor), body])
        numbers = " ".join([*(f"{r:.3f}" for r in _ranges(scan)), *(f"{value:.6f}" for value in poses)])
        lines.append(f"FLASER {len(scan)} {numbers} {end}")
    write_text(path, "\n".join(lines) + "\n")


def _odom(pose: Array, velocity: Array, end: str) -> str:
    return "ODOM " + " ".join(f"{value:.6f}" for value in (*pose, *velocity, 0.0)) + f" {end}"


def _ranges(scan: Scan) -> Array:
    """Ranges that keep their status when they are rounded to the printed digits."""
    low, high = scan.range_limits
    ranges = np.clip(scan.ranges, low + _RESOLUTION / 2, high - 0.501 * _RESOLUTION)
    ranges[scan.status == RayStatus.BELOW_MINIMUM] = 0
    ranges[scan.status == RayStatus.NO_RETURN] = high
    return ranges


def _checked(scans: Sequence[Scan]) -> Scan:
    """Return the first scan after making sure that all are alike and fit into FLASER messages."""
    if not scans:
        raise SimulationError("drive: holds no scans to write")
    first = scans[0]
    if first.dimension != 2 or len(first) not in _BEAM_STEPS:
        raise SimulationError(
            f"scans: {len(first)} beams in {first.dimension}-D; CARMEN holds {sorted(_BEAM_STEPS)} in 2-D"
        )
    angles = np.arange(len(first)) * _BEAM_STEPS[len(first)] - np.pi / 2
    expected = np.stack([np.cos(angles), np.sin(angles)], -1)
    for scan in scans:
        if scan.directions.shape != expected.shape or np.abs(scan.directions - expected).max() > 1e-6:
            raise SimulationError("scans: beams are not those of CARMEN, every 1 or 0.5 degree from -90 degrees on")
        if np.abs(scan.T_body_sensor[1:]).max() > 0 or scan.T_body_sensor[0] != first.T_body_sensor[0]:
            raise SimulationError(f"T_body_sensor: {scan.T_body_sensor}; CARMEN knows only an offset straight ahead")
    return first
