"""Strips of positions that correspondences leave, for every slice of headings."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.intervals import Interval
from factorloc.localization.correspondence import Correspondence
from factorloc.localization.wall_lines import WallLines

__all__ = ["SLACK", "Frame", "Strips"]

Array = npt.NDArray[np.float64]

SLACK = 1e-9  # m; far above the rounding of a hundred operations on kilometres
_ACROSS = 0.3  # least sine of the angle between two walls that bound a position together


@dataclass(frozen=True)
class Frame:
    """Positions about a middle, with x along a wall: most strips are level or upright there, and so are the cells."""

    middle: Array
    axis: Array

    def into(self, points: Array) -> Array:
        """Points of the map, shape (..., 2), in the frame."""
        away = points - self.middle
        x, y = self.axis
        return np.stack([away[..., 0] * x + away[..., 1] * y, away[..., 1] * x - away[..., 0] * y], -1)

    def turn(self, vectors: Array) -> Array:
        """Vectors of the map, shape (..., 2), in the frame."""
        x, y = self.axis
        return np.stack([vectors[..., 0] * x + vectors[..., 1] * y, vectors[..., 1] * x - vectors[..., 0] * y], -1)

    def out(self, points: Array) -> Array:
        """Points of the frame, shape (..., 2), in the map."""
        x, y = self.axis
        back = np.stack([points[..., 0] * x - points[..., 1] * y, points[..., 0] * y + points[..., 1] * x], -1)
        return np.asarray(back + self.middle)


class Strips:
    """Strips of all slices and correspondences, shape (J, K, 4): a, b, low, high; crossed limits where none is left.

    Parameters
    ----------
    found : tuple of Correspondence
        At least one.
    walls : WallLines
        The map.
    frame : Frame
        Of the strips.
    edges : ndarray, shape (J + 1,)
        Between slices of headings, rad.
    radius : float
        Of the positions asked for about the middle of the frame, m.
    """

    def __init__(
        self, found: tuple[Correspondence, ...], walls: WallLines, frame: Frame, edges: Array, radius: float
    ) -> None:
        self.found, self.frame = found, frame
        self.facades = np.array([one.facade for one in found])
        rows = self.facades
        low, high = edges[:-1, None], edges[1:, None]
        local = _stacked([one.alpha for one in found])
        # alpha of the map, narrowed to what line and heading leave, in the turn of the map's direction.
        alpha = walls.alpha[rows]
        sum_lo, sum_hi = low + local.lo, high + local.hi
        turns = np.round((0.5 * (sum_lo + sum_hi) - alpha.mid) / (2 * math.pi)) * 2 * math.pi
        lo, hi = np.maximum(alpha.lo, sum_lo - turns - SLACK), np.minimum(alpha.hi, sum_hi - turns + SLACK)
        self.possible = lo <= hi
        direction, rho = 0.5 * (lo + hi), np.maximum(0.5 * (hi - lo), 0.0) + SLACK
        self.normal = np.stack([np.cos(direction), np.sin(direction)], -1)
        self.tangent = np.stack([-self.normal[..., 1], self.normal[..., 0]], -1)
        heading, self.half = 0.5 * (low + high), 0.5 * float((high - low).max()) + 1e-12
        anchors = np.stack([one.anchor for one in found])
        c, s = np.cos(heading), np.sin(heading)
        turned = np.stack([c * anchors[:, 0] - s * anchors[:, 1], s * anchors[:, 0] + c * anchors[:, 1]], -1)
        self.away = walls.centres[rows] - frame.middle - turned  # where t would be, had w vanished
        lever = np.hypot(*anchors.T)
        bend = 0.5 * lever * self.half**2
        side = np.abs((self.tangent * turned).sum(-1)) * self.half + bend
        ahead = np.abs((self.normal * turned).sum(-1)) * self.half + bend
        reach = radius + np.hypot(self.away[..., 0], self.away[..., 1]) + lever * self.half
        d = _stacked([one.d for one in found])
        middle = (self.normal * self.away).sum(-1)
        swing = rho * reach + SLACK
        vertex = walls.vertex_d[rows]
        self.low = middle - vertex - d.hi - side - swing
        self.high = middle + vertex - d.lo + side + swing
        self.shift = walls.shift_d[rows]
        self.slack_along = ahead + swing

    def widened(self, by: Array) -> Array:
        """Strips across the walls, widened to either side by the shifts of their buildings, (K,)."""
        low, high = np.where(self.possible, self.low - by, 1.0), np.where(self.possible, self.high + by, 0.0)
        return np.ascontiguousarray(np.concatenate([self.frame.turn(self.normal), low[..., None], high[..., None]], -1))

    def along_walls(self, walls: WallLines, by_chain: bool) -> Array:
        """Strips along the walls: the middle half of the supporters meets the row of walls in line with the facade."""
        low, high = np.full(self.low.shape, -np.inf), np.full(self.low.shape, np.inf)
        if by_chain:
            rows = self.facades
            # The tangent, a quarter turn left of the normal, points from the start of a facade to its end.
            begin, end = walls.chains[rows, 0], walls.chains[rows, 1]
            error = walls.facades.shifts[rows] + walls.facades.vertex_errors[rows]
            first, last = np.array([one.middle for one in self.found]).T
            middle = (self.tangent * self.away).sum(-1)
            slack = self.slack_along + error * np.abs(self.tangent).sum(-1)
            low, high = middle + begin - last - slack, middle + end - first + slack
        return np.ascontiguousarray(
            np.concatenate([self.frame.turn(self.tangent), low[..., None], high[..., None]], -1)
        )

    def of_buildings(self, walls: WallLines, count: int) -> tuple[npt.NDArray[np.int64], Array]:
        """Pairs of walls of a building that meet at an angle, and the box that each leaves, as two strips.

        Parameters
        ----------
        walls : WallLines
            The map.
        count : int
            Only the first so many correspondences are paired.
        """
        pairs = _pairs(walls, self.facades[:count])
        slices = len(self.low)
        boxes = np.empty((slices, len(pairs), 2, 4))
        for p, (i, j) in enumerate(pairs):
            n, m = self.normal[:, i], self.normal[:, j]
            cross = n[:, 0] * m[:, 1] - n[:, 1] * m[:, 0]
            corners = [
                np.stack([(e * m[:, 1] - f * n[:, 1]) / cross, (f * n[:, 0] - e * m[:, 0]) / cross], -1)
                for e in (self.low[:, i], self.high[:, i])
                for f in (self.low[:, j], self.high[:, j])
            ]
            shift = float(walls.facades.shifts[self.facades[i]])
            low, high = np.min(corners, 0) - shift - SLACK, np.max(corners, 0) + shift + SLACK
            for axis in range(2):
                unit = self.frame.turn(np.eye(2)[axis])
                boxes[:, p, axis, :2], boxes[:, p, axis, 2], boxes[:, p, axis, 3] = unit, low[:, axis], high[:, axis]
        return pairs, boxes


def _stacked(intervals: list[Interval]) -> Interval:
    return Interval(np.array([float(one.lo) for one in intervals]), np.array([float(one.hi) for one in intervals]))


def _pairs(walls: WallLines, facades: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    buildings = walls.facades.buildings[facades]
    normals = walls.normals[facades]
    free, pairs = set(range(len(facades))), []
    for i in range(len(facades)):
        if i not in free:
            continue
        for j in range(i + 1, len(facades)):
            cross = normals[i, 0] * normals[j, 1] - normals[i, 1] * normals[j, 0]
            if j in free and buildings[i] == buildings[j] and abs(cross) > _ACROSS:
                pairs.append((i, j))
                free -= {i, j}
                break
    return np.array(pairs, np.int64).reshape(-1, 2)
