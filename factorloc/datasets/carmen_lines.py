"""The grammar of CARMEN messages: one line in, one record out.

Every line ends in ``ipc_timestamp ipc_hostname logger_timestamp``. Before that stand::

    FLASER       n range*n  laser_x laser_y laser_theta  odom_x odom_y odom_theta
    ROBOTLASER1  type start_angle field_of_view resolution maximum_range accuracy remission_mode
                 n range*n [m remission*m]  laser_x laser_y laser_theta  robot_x robot_y robot_theta
                 tv rv forward_safety_distance side_safety_distance [turn_axis]
    ODOM         x y theta tv rv acceleration
    PARAM        name value

in m, rad, m/s, rad/s. Older loggers leave out what stands in brackets.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from factorloc.errors import DataError

__all__ = ["BeamLayout", "LaserLine", "LineError", "OdometryLine", "parse_flaser", "parse_odom", "parse_robotlaser"]

Array = npt.NDArray[np.float64]
Pose = tuple[float, float, float]

FLASER_RESOLUTION_DEGREES = {180: 1.0, 181: 1.0, 360: 0.5, 361: 0.5}
"""Angle between beams by beam count, degrees; the first beam of all of them points at -90 degrees."""

_TAIL = 3  # ipc time, host, logger time
_ODOM_WORDS = 10


class LineError(DataError):
    """A line is damaged; the message is the reason, the same for all lines damaged alike."""


class BeamLayout(NamedTuple):
    """Where the beams of a laser point and how far they reach.

    Parameters
    ----------
    beams : int
        Their number.
    start, resolution : float
        Angle of the first beam and angle between beams, rad, counter-clockwise from straight ahead.
    max_range : float or None
        Maximum range, m, where the message carries it.
    """

    beams: int
    start: float
    resolution: float
    max_range: float | None = None

    def angles(self) -> Array:
        """Angle of every beam, rad, shape (beams,)."""
        return self.start + self.resolution * np.arange(self.beams, dtype=np.float64)


class LaserLine(NamedTuple):
    """A FLASER or ROBOTLASER1 message.

    Parameters
    ----------
    layout : BeamLayout
        Its beams.
    ranges : list of float
        Ranges, m, none of them negative or NaN; infinity is possible.
    laser_pose, robot_pose : (float, float, float)
        The two poses of the message. What they mean depends on who wrote the log.
    key, stamp : float
        Its ipc time and its logger time, s.
    """

    layout: BeamLayout
    ranges: list[float]
    laser_pose: Pose
    robot_pose: Pose
    key: float
    stamp: float


class OdometryLine(NamedTuple):
    """An ODOM message: pose of the robot (m, m, rad) and logger time (s)."""

    x: float
    y: float
    theta: float
    stamp: float


def parse_flaser(words: list[str]) -> LaserLine:
    """Read a FLASER message: beam k of 180 or 181 points at -90 + k degrees, of 360 or 361 at -90 + k/2 degrees.

    Parameters
    ----------
    words : list of str
        The line, split at blanks.

    Raises
    ------
    LineError
        If fields are missing or one of them cannot be.
    """
    count = _count(words, 1, "beam")
    if len(words) != 2 + count + 6 + _TAIL:
        raise LineError("FLASER: number of fields does not fit the beam count")
    resolution = FLASER_RESOLUTION_DEGREES.get(count)
    if resolution is None:
        raise LineError(f"FLASER: {count} beams, of unknown angles (known: {_known_counts()})")
    layout = BeamLayout(count, -math.pi / 2, math.radians(resolution))
    return _laser_line("FLASER", layout, words[2 : 2 + count], words[2 + count : 8 + count], words)


def parse_robotlaser(words: list[str]) -> LaserLine:
    """Read a ROBOTLASER1 message, which carries its own angles and maximum range.

    Parameters
    ----------
    words : list of str
        The line, split at blanks.

    Raises
    ------
    LineError
        If fields are missing or one of them cannot be.
    """
    count = _count(words, 8, "beam")
    after = 9 + count
    poses = after
    if len(words) != after + 10 + _TAIL:  # not the old form, which has neither remissions nor turn axis
        poses = after + 1 + _count(words, after, "remission")
        if len(words) != poses + 11 + _TAIL:
            raise LineError("ROBOTLASER1: number of fields does not fit the beam count")
    start, _, resolution, max_range = _numbers("ROBOTLASER1", words[2:6])
    if not (0 < resolution * count < 7 and abs(start) < 7 and 0 < max_range < math.inf):
        raise LineError("ROBOTLASER1: start angle, resolution or maximum range is out of bounds")
    layout = BeamLayout(count, start, resolution, max_range)
    return _laser_line("ROBOTLASER1", layout, words[9:after], words[poses : poses + 6], words)


def parse_odom(words: list[str]) -> OdometryLine:
    """Read an ODOM message.

    Parameters
    ----------
    words : list of str
        The line, split at blanks.

    Raises
    ------
    LineError
        If fields are missing or one of them cannot be.
    """
    if len(words) != _ODOM_WORDS:
        raise LineError("ODOM: fields are missing or too many")
    x, y, theta, stamp = _finite("ODOM", [*words[1:4], words[-1]])
    return OdometryLine(x, y, theta, stamp)


def _laser_line(kind: str, layout: BeamLayout, ranges: list[str], poses: list[str], words: list[str]) -> LaserLine:
    values = _numbers(kind, ranges)
    # A NaN compares false with everything, so that min() alone could miss it; it survives a sum.
    if math.isnan(sum(values)) and any(map(math.isnan, values)):
        raise LineError(f"{kind}: a range is NaN")
    if min(values) < 0:
        raise LineError(f"{kind}: a range is negative")
    x, y, theta, odom_x, odom_y, odom_theta, key, stamp = _finite(kind, [*poses, words[-3], words[-1]])
    return LaserLine(layout, values, (x, y, theta), (odom_x, odom_y, odom_theta), key, stamp)


def _count(words: list[str], index: int, what: str) -> int:
    try:
        count = int(words[index])
    except IndexError:
        raise LineError(f"{words[0]}: cut short before its {what} count") from None
    except ValueError:
        raise LineError(f"{words[0]}: {what} count is not a whole number") from None
    if count < (what == "beam"):
        raise LineError(f"{words[0]}: {what} count is not positive")
    return count


def _numbers(kind: str, words: list[str]) -> list[float]:
    try:
        return list(map(float, words))
    except ValueError:
        raise LineError(f"{kind}: a field is not a number") from None


def _finite(kind: str, words: list[str]) -> list[float]:
    values = _numbers(kind, words)
    if not all(map(math.isfinite, values)):
        raise LineError(f"{kind}: a pose or time is not finite")
    return values


def _known_counts() -> str:
    return ", ".join(map(str, FLASER_RESOLUTION_DEGREES))
