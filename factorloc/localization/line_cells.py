"""Line cells: accumulators of the interval Hough transform around the facades of a map, seen from a rough start."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.errors import GeometryError
from factorloc.intervals import Box, Interval
from factorloc.intervals.hough import HoughAccumulator
from factorloc.localization.wall_lines import WallLines
from factorloc.mapping.facade_points import FacadePoints
from factorloc.result import Bounds

__all__ = ["LineCells", "accumulator_of", "bounding_box"]

Array = npt.NDArray[np.float64]


def bounding_box(bounds: Bounds) -> Box:
    """Smallest box (x, y) around all polygons of a feasible set, m.

    Raises
    ------
    GeometryError
        If it is empty.
    """
    corners = [polygon for polygon in bounds.polygons if len(polygon)]
    if not corners:
        raise GeometryError("bounds: no position is possible; start from a set with one")
    return Box(Interval.hull_of(np.concatenate(corners), 0))


@dataclass(frozen=True, eq=False)
class LineCells:
    """Accumulators of K facades around their parameters.

    Parameters
    ----------
    anchors : ndarray, shape (K, 2)
        Origins in the frame of the body, m.
    first_alpha, first_d : ndarray, shape (K,)
        Lowest direction (rad) and distance (m).
    bins_alpha, bins_d : ndarray of int, shape (K,)
        Numbers of cells.
    """

    anchors: Array
    first_alpha: Array
    bins_alpha: npt.NDArray[np.int64]
    first_d: Array
    bins_d: npt.NDArray[np.int64]

    @classmethod
    def of(
        cls,
        walls: WallLines,
        rows: npt.NDArray[np.int64],
        start: Bounds,
        steps: tuple[float, float],
    ) -> LineCells:
        """Cells that hold every line that the facades of some rows may be, from every pose of the start.

        Parameters
        ----------
        walls : WallLines
            The map.
        rows : ndarray of int, shape (K,)
            Facades.
        start : Bounds
            Where the body may be.
        steps : (float, float)
            Sizes of a cell, rad and m.
        """
        theta, middle = Interval(*start.orientation), bounding_box(start).mid
        corners = np.concatenate([polygon for polygon in start.polygons if len(polygon)]) - middle
        heading, half = float(theta.mid), 0.5 * float(theta.width)
        c, s = math.cos(heading), math.sin(heading)
        away, normals = walls.centres[rows] - middle, walls.normals[rows]
        anchors = np.stack([c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0]], -1)
        # With w = t + R q - centre, n . w = d_map - d: how far w may lie along the normal of the middle direction, its
        # swing over the directions, and the turn of q about the body.
        across = normals @ corners.T
        lever = np.hypot(away[:, 0], away[:, 1])
        turned = np.abs(normals[:, 1] * away[:, 0] - normals[:, 0] * away[:, 1]) * half + 0.5 * lever * half**2
        swing = walls.turn[rows] * (float(np.hypot(*corners.T).max()) + lever * half)
        known = walls.vertex_d[rows] + walls.shift_d[rows] + turned + swing + 1e-9
        first_d, last_d = -across.max(1, initial=-np.inf) - known, -across.min(1, initial=np.inf) + known
        alpha = walls.alpha
        first, last = alpha.lo[rows] - theta.hi - 1e-12, alpha.hi[rows] - theta.lo + 1e-12
        bins_alpha = np.maximum(np.ceil((last - first) / steps[0]), 1).astype(np.int64)
        bins_d = np.maximum(np.ceil((last_d - first_d) / steps[1]), 1).astype(np.int64)
        return cls(np.ascontiguousarray(anchors), first, bins_alpha, first_d, bins_d)


def accumulator_of(
    points: FacadePoints,
    mask: npt.NDArray[np.bool_],
    walls: WallLines,
    row: int,
    start: Bounds,
    steps: tuple[float, float] = (math.radians(0.25), 0.1),
) -> HoughAccumulator:
    """Accumulator of one facade, as ``find_correspondences`` makes it; for pictures.

    Parameters
    ----------
    points, walls, start
        As there.
    mask : ndarray of bool, shape (N,)
        Points associated with the facade.
    row : int
        Row of the facade.
    steps : (float, float)
        Sizes of a cell, rad and m.
    """
    cells = LineCells.of(walls, np.array([row]), start, steps)
    boxes = points.boxes.select(mask)
    local = Box(boxes.bounds - Interval(cells.anchors[0][:, None]))
    first = float(cells.first_alpha[0]), float(cells.first_d[0])
    spans = (cells.bins_alpha[0] - 0.5) * steps[0], (cells.bins_d[0] - 0.5) * steps[1]
    alpha, d = (Interval(low, low + span) for low, span in zip(first, spans, strict=True))
    return HoughAccumulator.from_boxes(local, alpha, d, alpha_step=steps[0], d_step=steps[1])
