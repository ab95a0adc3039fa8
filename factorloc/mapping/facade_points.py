"""Facade points: a spatial scan reduced to points of upright surfaces in the plane, with boxes around the truth."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc.config import Block
from factorloc.errors import GeometryError
from factorloc.geometry import se2, se3
from factorloc.intervals import Box, Interval, cos_sin
from factorloc.mapping._facade_point_kernels import choose_points, enclose_points, find_columns
from factorloc.scan import Scan

__all__ = ["FacadePoints", "ReductionSettings", "ScanErrors", "facade_points"]

Array = npt.NDArray[np.float64]


class ScanErrors(Block):
    """Bounds of everything between a measured point and its true place in the plane of the map.

    Parameters
    ----------
    range : float
        Greatest error of a range, m.
    angle : float
        Greatest error of the bearing and of the elevation of a ray, rad.
    roll, pitch : float
        Greatest magnitudes of what the body is tilted by, rad; a known attitude belongs into the scan's
        ``T_body_sensor``.
    speed, sideways_speed : float
        Greatest speeds of what the scan was not corrected for, along x and along y of the body, m/s.
    turn_rate : float
        Greatest turn rate of what it was not corrected for, rad/s.
    duration : float
        Time of a sweep, s, around the scan's stamp, for scans without stamps of their rays; 0 for corrected ones.
    """

    range: float = Field(0.1, ge=0)
    angle: float = Field(math.radians(0.1), ge=0)
    roll: float = Field(math.radians(1.0), ge=0)
    pitch: float = Field(math.radians(1.0), ge=0)
    speed: float = Field(0.0, ge=0)
    sideways_speed: float = Field(0.0, ge=0)
    turn_rate: float = Field(0.0, ge=0)
    duration: float = Field(0.0, ge=0)


class ReductionSettings(Block):
    """What of a scan is taken for a facade.

    Parameters
    ----------
    cell : float
        Edge of a column, m.
    span : float
        Least difference of heights in a column, m.
    top : float
        Height above the ground that columns must reach, m: above cars.
    bottom : float
        Points lower above the ground are not taken, m.
    ground : float
        Height of the ground in the frame of the body, m.
    spacing : float
        One point a square of this edge, m.
    reach : float
        Points farther along x or y are not taken, m.
    """

    cell: float = Field(0.25, gt=0)
    span: float = Field(1.0, gt=0)
    top: float = Field(2.0, ge=0)
    bottom: float = Field(0.3, ge=0)
    ground: float = -1.73
    spacing: float = Field(0.2, gt=0)
    reach: float = Field(60.0, gt=0, le=1000)


@dataclass(frozen=True, eq=False)
class FacadePoints:
    """Points in the plane, in the level frame of the body at the time of the scan.

    Parameters
    ----------
    points : ndarray, shape (N, 2)
        As measured, m.
    boxes : Box, sides (x, y), batch (N,)
        Around where they truly are, m.
    rows : ndarray of int, shape (N,)
        Rays of the scan they are from.
    left_out : dict of str to int
        Rays that gave no point.
    """

    points: Array
    boxes: Box
    rows: npt.NDArray[np.int64]
    left_out: dict[str, int]

    def __len__(self) -> int:
        return len(self.points)


def facade_points(
    scan: Scan, errors: ScanErrors | None = None, settings: ReductionSettings | None = None
) -> FacadePoints:
    """Reduce a scan to points of upright surfaces in the plane.

    Of a spatial scan, points in columns of a grid whose heights span more than a storey's door and reach above cars are
    taken, one a small square: a band of heights alone would keep few points of a lidar whose rings are far apart. That
    choice is a heuristic. The boxes are bounds: if every error is within :class:`ScanErrors`, the true place of each
    chosen point is in its box. Of a planar scan all returns are taken, one a small square.

    Parameters
    ----------
    scan : Scan
        Planar or spatial.
    errors : ScanErrors, optional
        Bounds of the errors.
    settings : ReductionSettings, optional
        What is taken.

    Raises
    ------
    GeometryError
        If rays of the scan do not all begin at one origin.
    """
    errors, settings = errors or ScanErrors(), settings or ReductionSettings()
    if len(scan) and np.ptp(scan.origins, axis=0).max() > 1e-9:
        raise GeometryError("scan: its rays begin at several origins; correct the sweep first, or give its errors")
    returned = np.flatnonzero(scan.is_return)
    offset = scan.origins[0] if len(scan) else np.zeros(scan.dimension)
    mount = np.eye(4)
    spatial = scan.dimension == 3
    if spatial:
        mount = scan.T_body_sensor.copy()
        mount[:3, 3] = se3.transform(scan.T_body_sensor, offset)
    else:
        mount[:2, :2] = se2.rotation(scan.T_body_sensor[2])
        mount[:2, 3] = se2.transform(scan.T_body_sensor, offset)
    sensed = scan.directions[returned] * scan.ranges[returned, None]
    sensed = sensed if spatial else np.pad(sensed, ((0, 0), (0, 1)))
    body = np.ascontiguousarray(sensed @ mount[:3, :3].T + mount[:3, 3])
    chosen = _choose(body, settings, spatial)
    rows = returned[chosen]
    boxes = _enclose(scan, rows, sensed[chosen], mount, errors, spatial)
    left_out = {
        "rays without return": len(scan) - len(returned),
        "returns not of facades, or too near another": len(returned) - len(chosen),
    }
    return FacadePoints(body[chosen, :2].copy(), boxes, rows, left_out)


def _choose(body: Array, settings: ReductionSettings, spatial: bool) -> npt.NDArray[np.int64]:
    cells = math.ceil(2 * settings.reach / settings.cell)
    fine = math.ceil(2 * settings.reach / settings.spacing)
    lowest, highest = np.empty((cells, cells)), np.empty((cells, cells))
    grid = (-settings.reach, -settings.reach, 1.0 / settings.cell, lowest, highest)
    find_columns(body, *grid)
    limits = (settings.span, settings.ground + settings.top, settings.ground + settings.bottom)
    if not spatial:
        limits = (-math.inf, -math.inf, -math.inf)
    chosen = np.empty(len(body), np.int64)
    taken = np.zeros((fine, fine), np.bool_)
    count = choose_points(body, *grid, *limits, 1.0 / settings.spacing, taken, chosen)
    return chosen[:count].copy()


def _enclose(
    scan: Scan, rows: npt.NDArray[np.int64], sensed: Array, mount: Array, errors: ScanErrors, spatial: bool
) -> Box:
    bearing = np.arctan2(sensed[:, 1], sensed[:, 0])
    elevation = np.arctan2(sensed[:, 2], np.hypot(sensed[:, 0], sensed[:, 1]))
    # An angle of arctan2 is wrong by a unit of its last place or two.
    angle = errors.angle + 1e-15
    tilt = (errors.roll, errors.pitch, angle) if spatial else (0.0, 0.0, 0.0)
    ranges = Interval.around(scan.ranges[rows], errors.range)
    if scan.stamps is None:
        time = Interval.around(np.zeros(len(rows)), 0.5 * errors.duration)
    else:
        time = Interval(scan.stamps[rows] - scan.stamp)
    turn, ahead, aside = (
        Interval.around(0.0, rate) * time for rate in (errors.turn_rate, errors.speed, errors.sideways_speed)
    )
    # On a bend, each speed has a part of at most the sine of the turn along the other axis.
    along_x, along_y = ahead + aside * turn, aside + ahead * turn
    lo, hi = np.empty((2, len(rows))), np.empty((2, len(rows)))
    enclose_points(
        np.stack([np.maximum(ranges.lo, 0.0), ranges.hi]),
        _turn(Interval.around(bearing, angle)),
        _turn(Interval.around(elevation, tilt[2])),
        np.ascontiguousarray(mount[:3]),
        np.concatenate([_turn(Interval.around(0.0, tilt[0])), _turn(Interval.around(0.0, tilt[1]))]),
        _turn(turn),
        np.stack([along_x.lo, along_x.hi, along_y.lo, along_y.hi]),
        lo,
        hi,
    )
    return Box(Interval.from_bounds(lo, hi))


def _turn(angle: Interval) -> Array:
    c, s = cos_sin(angle)
    return np.stack([c.lo, c.hi, s.lo, s.hi])
