"""A whole CARMEN log: its laser messages as arrays, and the odometry messages around them."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from factorloc.datasets.carmen_lines import (
    BeamLayout,
    LaserLine,
    LineError,
    OdometryLine,
    parse_flaser,
    parse_odom,
    parse_robotlaser,
)
from factorloc.datasets.report import ReadReport, Tally
from factorloc.errors import DataError
from factorloc.files import open_text
from factorloc.geometry import se2

__all__ = ["CarmenLog", "read_log"]

Array = npt.NDArray[np.float64]

_LASERS: dict[str, Callable[[list[str]], LaserLine]] = {"FLASER": parse_flaser, "ROBOTLASER1": parse_robotlaser}
_MESSAGE = re.compile(r"[A-Z][A-Z0-9_-]{1,31}")
# Messages at which no odometry is ever re-anchored. Any other may stand for a scan that was not understood.
_HARMLESS = re.compile(r"PARAM|SYNC|NEFF|TRUEPOS|MARKER|NMEA.*")
_DETOUR = 0.1  # m; raw logs interpolate odometry at the scan, so that it lies on the way between its neighbours


@dataclass(frozen=True)
class CarmenLog:
    """What a CARMEN log says, before it is decided what its poses mean.

    Parameters
    ----------
    layout : BeamLayout
        The beams of all N scans.
    ranges : ndarray, shape (N, B)
        Ranges in file order, m; infinity is possible.
    laser_poses, robot_poses : ndarray, shape (N, 3)
        The two poses of each laser message.
    keys, stamps : ndarray, shape (N,)
        ipc and logger time, s.
    odom : ndarray, shape (M, 4)
        ODOM messages in file order: x, y, theta, logger time.
    odom_before : ndarray of int64, shape (N,)
        How many ODOM messages stand before each scan.
    breaks_before : ndarray of int64, shape (N,)
        How many lines before each scan were damaged or of a kind that may hide a re-anchored odometry.
    params : mapping of str to str
        PARAM messages; the last one of a name counts.
    resampled : bool
        The log holds NEFF messages, which a particle filter leaves when it writes corrected logs.
    report : ReadReport
        Account of its lines.
    """

    layout: BeamLayout
    ranges: Array
    laser_poses: Array
    robot_poses: Array
    keys: Array
    stamps: Array
    odom: Array
    odom_before: npt.NDArray[np.int64]
    breaks_before: npt.NDArray[np.int64]
    params: dict[str, str]
    resampled: bool
    report: ReadReport

    def motions_between(self) -> tuple[Array, npt.NDArray[np.bool_]]:
        """Body motions from the ODOM messages strictly between two scans, never across one.

        The motion runs from the first ODOM after scan k to the last one before scan k + 1. Where there are fewer than
        two, or a damaged line among them may hide another scan, it is not known.

        Returns
        -------
        ndarray, shape (N - 1, 3)
            Motions, zero where not known.
        ndarray of bool, shape (N - 1,)
            Where they are known.
        """
        first, last = self.odom_before[:-1], self.odom_before[1:] - 1
        known = (last > first) & (np.diff(self.breaks_before) == 0)
        motions = np.zeros((len(first), 3))
        motions[known] = se2.between(self.odom[first[known], :3], self.odom[last[known], :3])
        return motions, known

    def looks_corrected(self) -> bool:
        """Tell whether the robot poses of the scans contradict the odometry around them, as in corrected logs.

        They do where most scans of a moving robot either lie off the way between the ODOM messages beside them, or jump
        away from the one before, taken at the same time, while the one after is anchored at the jump.
        """
        inside = (self.odom_before > 0) & (self.odom_before < len(self.odom))
        before = self.odom[self.odom_before[inside] - 1]
        after = self.odom[self.odom_before[inside]]
        pose = self.robot_poses[inside]
        legs = [np.linalg.norm(b - a, axis=1) for a, b in ((before[:, :2], pose[:, :2]), (pose[:, :2], after[:, :2]))]
        direct = np.linalg.norm(after[:, :2] - before[:, :2], axis=1)
        jumps = (pose != before[:, :3]).any(axis=1) & (before[:, 3] == self.stamps[inside])
        anchored = jumps & (pose == after[:, :3]).all(axis=1)
        astray = legs[0] + legs[1] - direct > _DETOUR
        moving = legs[0] + legs[1] > 0
        return bool(2 * (anchored | astray).sum() > moving.sum())


def read_log(path: Path, max_bytes: int, max_damaged_fraction: float) -> CarmenLog:
    """Read every line of a CARMEN log.

    Parameters
    ----------
    path : Path
        Plain, gzip, bzip2 or xz.
    max_bytes : int
        Largest decompressed size accepted.
    max_damaged_fraction : float
        Largest fraction of laser messages that may be damaged.

    Raises
    ------
    DataError
        If the file cannot be read or holds too few sound laser messages.
    """
    tally = Tally()
    scans: list[LaserLine] = []
    odom: list[OdometryLine] = []
    marks: list[tuple[int, int]] = []
    params: dict[str, str] = {}
    laser, lost, breaks, resampled = "", 0, 0, False
    for number, line in open_text(path, max_bytes):
        tally.lines = number
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        kind = words[0]
        try:
            if kind in _LASERS and laser in ("", kind):
                scan = _LASERS[kind](words)
                if scans and scan.layout != scans[0].layout:
                    raise LineError(f"{kind}: {_change(scans[0].layout, scan.layout)}")
                laser = kind
                scans.append(scan)
                marks.append((len(odom), breaks))
            elif kind == "ODOM":
                odom.append(parse_odom(words))
            elif kind == "PARAM":
                if len(words) < 3:
                    raise LineError("PARAM: without a value")
                params[words[1]] = words[2]
            elif _MESSAGE.fullmatch(kind):
                resampled |= kind == "NEFF"
                breaks += not _HARMLESS.fullmatch(kind)
                tally.ignore(kind)
                continue
            else:
                raise LineError("not a CARMEN message")
            tally.use(kind)
        except LineError as error:
            breaks += 1
            lost += kind in _LASERS
            tally.damage(str(error), number)
    report = tally.report(path)
    _demand_scans(report, len(scans), lost, max_damaged_fraction)
    mark = np.array(marks, np.int64).reshape(-1, 2)
    return CarmenLog(
        layout=scans[0].layout,
        ranges=np.array([scan.ranges for scan in scans]),
        laser_poses=np.array([scan.laser_pose for scan in scans]),
        robot_poses=np.array([scan.robot_pose for scan in scans]),
        keys=np.array([scan.key for scan in scans]),
        stamps=np.array([scan.stamp for scan in scans]),
        odom=np.array(odom, np.float64).reshape(-1, 4),
        odom_before=mark[:, 0],
        breaks_before=mark[:, 1],
        params=params,
        resampled=resampled,
        report=report,
    )


def _change(before: BeamLayout, now: BeamLayout) -> str:
    if before.beams != now.beams:
        return f"beam count changes from {before.beams} to {now.beams}"
    return "start angle, resolution or maximum range changes"


def _demand_scans(report: ReadReport, sound: int, lost: int, max_damaged_fraction: float) -> None:
    if report.lines == 0:
        raise DataError(f"{report.path}: is empty; fetch it again")
    if sound == lost == 0:
        damage = f" ({report.damage()})" if report.damaged else ""
        raise DataError(f"{report.path}: holds no FLASER or ROBOTLASER1 message{damage}; is it a CARMEN log?")
    if sound == 0 or lost > max_damaged_fraction * (sound + lost):
        raise DataError(
            f"{report.path}: {lost} of {sound + lost} scans are damaged ({report.damage()}); fetch it again"
        )
