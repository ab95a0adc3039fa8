"""Shaft fit: axis and width of poles from the returns themselves, finer than the cells they were found in.

A beam that meets a cylinder of radius r at the distance l to the side of its axis c ends at

    p = c - sqrt(r^2 - l^2) u + l v

where u is the horizontal direction of the beam and v that to its left. Beams are spread evenly over the width that is
seen, so that on average l^2 is r^2 / 3, and the end lies pi / 4 r before the axis:

    c = mean(p) + pi / 4 r mean(u),       r^2 = 3 mean((v (p - c))^2).

Both are iterated. Noise of ranges moves ends along the beams and leaves l alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from factorloc.geometry import se3
from factorloc.mapping._window_kernels import gather_shaft_returns
from factorloc.mapping.grid import Grid
from factorloc.mapping.poles import Poles
from factorloc.scan import Scan

__all__ = ["fit_shafts"]

Array = npt.NDArray[np.float64]

_FEWEST = 8  # returns that tell a width
_THINNEST = 0.02  # m
_ITERATIONS = 10


def fit_shafts(poles: Poles, scans: Sequence[Scan], poses: Array, grid: Grid, hull: int) -> Poles:
    """Fit axes and widths of poles to the returns in and next to their cells.

    Parameters
    ----------
    poles : Poles
        Found in the cells of a grid.
    scans : sequence of Scan
        What the grid was made from.
    poses : ndarray, shape (S, 4, 4)
        Pose of the body in the frame of the grid at each.
    grid : Grid
        Three axes.
    hull : int
        Free cells around each pole; returns in them belong to it.

    Returns
    -------
    Poles
        In the same order. Poles with fewer than 8 returns, or whose fit leaves the cells, stay as they were.
    """
    if len(poles) == 0:
        return poles
    edge, low = grid.resolution, np.array(grid.origin)
    centres = poles.positions - low[:2]
    half = poles.widths / 2 + hull * edge
    owners = np.full(grid.shape[:2], -1, np.int64)
    for k in range(len(poles) - 1, -1, -1):  # the surest of two is written last
        first = np.maximum(np.floor((centres[k] - half[k]) / edge + 0.5).astype(np.int64), 0)
        last = np.floor((centres[k] + half[k]) / edge + 0.5).astype(np.int64)
        owners[first[0] : last[0], first[1] : last[1]] = k
    bottoms, tops = np.round((poles.spans - low[2]) / edge).astype(np.int64).T.copy()
    moments = np.zeros((len(poles), 11))
    for scan, pose in zip(scans, poses, strict=True):
        sensor = se3.compose(pose, scan.T_body_sensor)
        sensor[:3, 3] -= low
        gather_shaft_returns(
            scan.origins, scan.directions, scan.ranges, scan.status, sensor, edge, grid.shape, owners, centres, bottoms,
            tops, moments,
        )  # fmt: skip
    count = np.maximum(moments[:, 0], 1.0)
    p, u = moments[:, 1:3] / count[:, None], moments[:, 3:5] / count[:, None]
    squares, linear, v_xx, v_xy, v_yy = moments[:, 5], moments[:, 6:8], *moments[:, 8:].T
    radius = poles.widths / 2
    for _ in range(_ITERATIONS):
        c = p + math.pi / 4 * radius[:, None] * u
        quadratic = v_xx * c[:, 0] ** 2 + 2 * v_xy * c[:, 0] * c[:, 1] + v_yy * c[:, 1] ** 2
        spread = (squares - 2 * (linear * c).sum(1) + quadratic) / count
        radius = np.sqrt(np.maximum(3 * spread, (_THINNEST / 2) ** 2))
    c = p + math.pi / 4 * radius[:, None] * u
    good = (moments[:, 0] >= _FEWEST) & (np.abs(c).max(1) <= half) & (radius <= half)
    return replace(
        poles,
        positions=np.where(good[:, None], poles.positions + c, poles.positions),
        widths=np.where(good, 2 * radius, poles.widths),
    )
