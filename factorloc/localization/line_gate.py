"""Line gate: which lines of a scan are where a belief of the pose and of the map has them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from factorloc.localization.correspondence import Correspondence
from factorloc.localization.least_squares_settings import LeastSquaresSettings
from factorloc.localization.wall_belief import WallBelief
from factorloc.localization.wall_lines import WallLines

__all__ = ["line_points", "line_residuals", "lines_expected"]

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]


def line_points(found: Sequence[Correspondence]) -> tuple[Array, Rows]:
    """Five points of the middle line of each correspondence, in the frame of the body, and their facades."""
    points, rows = [], []
    for one in found:
        alpha, d = float(one.alpha.mid), float(one.d.mid)
        normal = np.array([math.cos(alpha), math.sin(alpha)])
        along = np.linspace(*one.extent, 5)[:, None] * np.array([-normal[1], normal[0]])
        points.append(one.anchor + d * normal + along)
        rows.append(np.full(5, one.facade))
    return np.concatenate(points), np.concatenate(rows)


def lines_expected(
    found: Sequence[Correspondence], walls: WallLines, known: WallBelief, settings: LeastSquaresSettings
) -> npt.NDArray[np.bool_]:
    """Lines whose middles are where a belief has them, within the gate, shape (K,); see :func:`line_residuals`."""
    away, variance = line_residuals(found, walls, known, settings)
    return np.asarray(away**2 <= settings.gate**2 * variance)


def line_residuals(
    found: Sequence[Correspondence], walls: WallLines, known: WallBelief, settings: LeastSquaresSettings
) -> tuple[Array, Array]:
    """How far the middles of lines are from where a belief has them (K,), m, and the variances of that.

    Parameters
    ----------
    found : sequence of Correspondence
        K lines.
    walls : WallLines
        The map.
    known : WallBelief
        The belief.
    settings : LeastSquaresSettings
        Standard deviations.
    """
    lines, rows = line_points(found)
    middles, facades = lines[2::5], rows[2::5]
    c, s = math.cos(known.pose[2]), math.sin(known.pose[2])
    x, y = c * middles[:, 0] - s * middles[:, 1], s * middles[:, 0] + c * middles[:, 1]
    n = walls.normals[facades]
    count, buildings = len(facades), walls.facades.buildings[facades]
    J = np.zeros((count, len(known.covariance)))
    J[:, :2], J[:, 2] = n, n[:, 1] * x - n[:, 0] * y
    own = np.full(count, settings.point_sigma**2) + (settings.vertex_sigma * walls.facades.vertex_errors[facades]) ** 2
    away = (n * (np.stack([x, y], -1) + known.pose[:2] - walls.centres[facades])).sum(1)
    at = np.searchsorted(known.buildings, buildings)
    for k in range(count):
        if at[k] < len(known.buildings) and known.buildings[at[k]] == buildings[k]:
            J[k, 3 + 2 * at[k] : 5 + 2 * at[k]] = -n[k]
            away[k] -= n[k] @ known.errors[2 * at[k] : 2 * at[k] + 2]
        else:
            own[k] += (settings.shift_sigma * walls.facades.shifts[facades[k]]) ** 2
    return away, np.asarray(np.einsum("ki,ij,kj->k", J, known.covariance, J) + own)
