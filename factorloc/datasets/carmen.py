"""Reader of CARMEN logs, raw ones and corrected ones.

The two differ in what their poses mean. In a *raw* log the robot pose of a laser message is odometry, and there is no
truth. In a *corrected* log a SLAM program has written its estimate into both poses of the message: they are the truth,
and odometry is only what the ODOM messages strictly between two laser messages say. Which one a log is, is told by the
caller, or else by its name, by its NEFF messages, and by poses that contradict the odometry around them.
"""

from __future__ import annotations

import logging
import math
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from factorloc.datasets.carmen_log import CarmenLog, read_log
from factorloc.datasets.drive import Drive
from factorloc.datasets.pairing import pair_raw_with_corrected
from factorloc.datasets.registry import COMPRESSIONS, known_max_range, log_name
from factorloc.datasets.report import ReadReport
from factorloc.errors import DataError, FactorlocWarning
from factorloc.files import MAX_DECOMPRESSED_BYTES
from factorloc.geometry import se2
from factorloc.scan import RayStatus, Scan
from factorloc.trajectory import Trajectory

__all__ = ["CarmenReader", "read_carmen"]

Array = npt.NDArray[np.float64]

_LOGGER = logging.getLogger(__name__)
_SICK_MAX_RANGE = 50.0  # m; what Radish's SICK lasers of one degree resolve reliably


@dataclass(frozen=True)
class CarmenReader:
    """Reader of CARMEN logs for :func:`factorloc.datasets.open_drive`."""

    name: str = "CARMEN log (.log, .clf; plain, .gz, .bz2 or .xz)"

    def matches(self, path: Path) -> bool:
        """Tell from its name whether a file is a CARMEN log."""
        endings = [ending.lower() for ending in path.suffixes]
        if endings and endings[-1] in COMPRESSIONS:
            endings.pop()
        return bool(endings) and endings[-1] in (".log", ".clf")

    def read(self, path: Path, **options: Any) -> Drive:
        """Read a log; options are those of :func:`read_carmen`."""
        return read_carmen(path, **options)


def read_carmen(
    path: Path | str,
    *,
    range_limits: tuple[float, float | None] | None = None,
    corrected: bool | None = None,
    truth: Path | str | None = None,
    max_damaged_fraction: float = 0.5,
    max_bytes: int = MAX_DECOMPRESSED_BYTES,
) -> Drive:
    """Read a CARMEN log.

    Scans keep the order of the file; times are kept as recorded. The laser sits ``PARAM robot_frontlaser_offset`` ahead
    of the robot's centre (a raw ROBOTLASER1 message says it itself), and the truth is moved from laser to body by it.

    Parameters
    ----------
    path : Path or str
        Raw or corrected log; plain, gzip, bzip2 or xz.
    range_limits : (float, float or None), optional
        Minimum and maximum range, m. By default the minimum is 0 and the maximum, in this order, that of the
        ROBOTLASER1 messages, ``PARAM robot_front_laser_max``, that known for a log of this name, or 50 m for 180 or 181
        beams. Ranges at or past the maximum, and the codes lasers write there, are rays without return.
    corrected : bool, optional
        Whether the poses of laser messages are the truth; found out by default.
    truth : Path or str, optional
        The corrected log that belongs to a raw one. The result then has the scans of the corrected log, its poses as
        truth and the odometry of the raw log.
    max_damaged_fraction : float
        Largest fraction of laser messages that may be damaged.
    max_bytes : int
        Largest decompressed size accepted.

    Returns
    -------
    Drive
        With the account of every line in ``reports``.

    Raises
    ------
    DataError
        If the file is missing, cut short, of another kind or too damaged; if no maximum range is known; if a log is
        declared raw that holds a SLAM program's poses; if raw and corrected log do not belong together.

    Warns
    -----
    FactorlocWarning
        If damaged lines were left out, or nothing but its poses tells that a log is corrected.
    """
    path = Path(path)
    log = read_log(path, max_bytes, max_damaged_fraction)
    if log.report.damaged:
        warnings.warn(f"{path}: {log.report.damage()}", FactorlocWarning, stacklevel=2)
    is_corrected = _is_corrected(log, corrected)
    if truth is None:
        return _corrected_drive(log, range_limits) if is_corrected else _raw_drive(log, range_limits)
    if is_corrected:
        raise DataError(f"{path}: is a corrected log and carries its own truth; name the raw log, or leave truth out")
    reference = read_carmen(
        truth,
        range_limits=range_limits,
        corrected=True,
        max_damaged_fraction=max_damaged_fraction,
        max_bytes=max_bytes,
    )
    return pair_raw_with_corrected(_raw_drive(log, range_limits), reference)


def _is_corrected(log: CarmenLog, declared: bool | None) -> bool:
    path = log.report.path
    named = "-corrected" in path.name
    if declared or (declared is None and (named or log.resampled)):
        return True
    if log.resampled:
        evidence = "it holds NEFF messages"
    elif log.looks_corrected():
        evidence = "the poses of its scans contradict its ODOM messages"
    else:
        return False
    if declared is False:
        raise DataError(
            f"{path}: is not a raw log, as {evidence}; its poses are no odometry, open it with corrected=True"
        )
    # Only its poses tell: the safe side, to be confirmed.
    warnings.warn(f"{path}: taken for a corrected log, as {evidence}; confirm by corrected=True", FactorlocWarning, 3)
    return True


def _raw_drive(log: CarmenLog, range_limits: tuple[float, float | None] | None) -> Drive:
    if log.layout.max_range is None:
        mount = _mount_from_params(log)
    else:
        mount = se2.between(log.robot_poses[0], log.laser_poses[0])
    scans, report = _scans(log, range_limits, mount)
    return Drive(
        name=log_name(log.report.path),
        scans=scans,
        odometry=se2.between(log.robot_poses[:-1], log.robot_poses[1:]),
        stamps=log.stamps,
        keys=log.keys,
        reports=(report,),
    )


def _corrected_drive(log: CarmenLog, range_limits: tuple[float, float | None] | None) -> Drive:
    # Both poses of the laser messages are the truth here: only the laser's is looked at, and never for odometry.
    mount = _mount_from_params(log)
    scans, report = _scans(log, range_limits, mount)
    odometry, known = log.motions_between()
    return Drive(
        name=log_name(log.report.path),
        scans=scans,
        odometry=odometry,
        odometry_known=known,
        truth=Trajectory(log.stamps, se2.compose(log.laser_poses, se2.inverse(mount))),
        stamps=log.stamps,
        keys=log.keys,
        reports=(report,),
    )


def _scans(
    log: CarmenLog, range_limits: tuple[float, float | None] | None, mount: Array
) -> tuple[tuple[Scan, ...], ReadReport]:
    """Build the scans, and add to the report what had to be assumed."""
    low, high = range_limits or (0.0, None)
    notes: list[str] = []
    if high is None:
        high = _max_range(log, notes)
    zeros = int((log.ranges == 0).sum())
    if zeros and low == 0:
        notes.append(f"{zeros} ranges are 0 and count as returns; if 0 is an error code, set a positive minimum range")
    for note in notes:
        _LOGGER.info("%s: %s", log.report.path, note)
    model = Scan.from_polar(log.layout.angles(), log.ranges[0], (low, high), frame="laser", T_body_sensor=mount)
    status = np.full(log.ranges.shape, RayStatus.RETURN, np.uint8)
    status[log.ranges < low] = RayStatus.BELOW_MINIMUM
    status[log.ranges >= high] = RayStatus.NO_RETURN
    ranges = np.minimum(log.ranges, high)
    # Directions and origins are the same for all scans and stored once.
    scans = tuple(
        replace(model, ranges=ranges[k], status=status[k], stamp=float(stamp)) for k, stamp in enumerate(log.stamps)
    )
    return scans, replace(log.report, notes=tuple(notes))


def _max_range(log: CarmenLog, notes: list[str]) -> float:
    path = log.report.path
    own = log.layout.max_range or _parameter(log, "robot_front_laser_max") or known_max_range(log_name(path))
    if own is not None:
        return own
    if log.layout.beams in (180, 181):
        notes.append(f"maximum range not recorded, {_SICK_MAX_RANGE:g} m assumed")
        return _SICK_MAX_RANGE
    raise DataError(f"{path}: records no maximum range of its {log.layout.beams} beams; set range_limits")


def _mount_from_params(log: CarmenLog) -> Array:
    offset = _parameter(log, "robot_frontlaser_offset")
    return np.array([offset or 0.0, 0.0, 0.0])


def _parameter(log: CarmenLog, name: str) -> float | None:
    text = log.params.get(name)
    if text is None:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise DataError(f"{log.report.path}: PARAM {name} is {text!r}; expected a number in m")
    return value
