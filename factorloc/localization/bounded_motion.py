"""Motions with bounded errors, and feasible sets carried along by them."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc.config import Block
from factorloc.intervals import Box, ConvexPolygon, Interval, rotate
from factorloc.localization.feasible_layers import hull_of_points, without_twins
from factorloc.result import Bounds

__all__ = ["OdometryBounds", "propagate", "widen"]

Array = npt.NDArray[np.float64]

_MANY = 64  # corners


class OdometryBounds(Block):
    """Greatest errors of a measured motion of the body between two scans.

    Parameters
    ----------
    along_per_metre, across_per_metre : float
        Along and across the body, part of the way.
    turn_per_metre, turn_per_turn : float
        Of the turn: rad/m and rad/rad.
    least_length, least_turn : float
        What is added to each, m and rad.
    """

    along_per_metre: float = Field(0.02, ge=0)
    across_per_metre: float = Field(0.01, ge=0)
    turn_per_metre: float = Field(0.001, ge=0)
    turn_per_turn: float = Field(0.02, ge=0)
    least_length: float = Field(0.005, ge=0)
    least_turn: float = Field(0.0005, ge=0)

    def errors(self, motion: npt.ArrayLike) -> Array:
        """Greatest errors ``[along, across, turn]`` of a motion ``[x, y, theta]``."""
        x, y, turn = np.asarray(motion, np.float64)
        way = math.hypot(x, y)
        return np.array([
            self.along_per_metre * way + self.least_length,
            self.across_per_metre * way + self.least_length,
            self.turn_per_metre * way + self.turn_per_turn * abs(turn) + self.least_turn,
        ])  # fmt: skip


def propagate(
    bounds: Bounds, motion: npt.ArrayLike, errors: npt.ArrayLike, *, spare: tuple[float, float] = (0.0, 0.0)
) -> Bounds:
    """Carry a feasible set along by a motion with bounded errors.

    Parameters
    ----------
    bounds : Bounds
        Before.
    motion : array_like, shape (3,)
        ``T_before_after`` as measured.
    errors : array_like, shape (3,)
        Greatest errors of ``[x, y, theta]``.
    spare : (float, float)
        The result is widened by a square of that half side (m) and by a heading (rad), as by :func:`widen`.

    Returns
    -------
    Bounds
        Every pose of the set, moved by any of these motions, is in it.
    """
    (x, y, turn), (dx, dy, dturn) = np.asarray(motion, np.float64), np.asarray(errors, np.float64)
    theta = Interval(*bounds.orientation)
    way_x, way_y = rotate(theta, Interval.around(x, dx), Interval.around(y, dy))
    low, high = np.array([way_x.lo, way_y.lo]) - spare[0], np.array([way_x.hi, way_y.hi]) + spare[0]
    after = theta + Interval.around(turn, dturn + spare[1])
    return Bounds((float(after.lo), float(after.hi)), tuple(_swept(polygon, low, high) for polygon in bounds.polygons))


def widen(bounds: Bounds, position: float, heading: float) -> Bounds:
    """Widen a feasible set by a square of half side ``position`` (m) and by ``heading`` (rad)."""
    low, high = bounds.orientation
    square = np.full(2, position)
    return Bounds((low - heading, high + heading), tuple(_swept(one, -square, square) for one in bounds.polygons))


def _swept(polygon: Array, low: Array, high: Array) -> Array:
    """Minkowski sum of a convex polygon and a box, rounded outwards."""
    slack = 1e-12 * (1.0 + float(np.abs(polygon).max()))
    corners = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
    corners += slack * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    return _with_few_corners(without_twins(hull_of_points((polygon[:, None] + corners).reshape(-1, 2))))


def _with_few_corners(polygon: Array) -> Array:
    """A polygon of many corners within one of 32 sides: where sets are only carried along, corners would pile up."""
    if len(polygon) <= _MANY:
        return polygon
    turns = np.arange(32) * (np.pi / 16.0)
    a, b = np.cos(turns), np.sin(turns)
    box = ConvexPolygon.from_box(Box(Interval.hull_of(polygon, 0)))
    return box.clip_half_planes(a, b, (np.outer(a, polygon[:, 0]) + np.outer(b, polygon[:, 1])).max(1)).corners
