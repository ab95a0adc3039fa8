"""Correspondences: lines of a scan that may be facades of the map, found by the interval Hough transform."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc.config import Block
from factorloc.errors import GeometryError
from factorloc.intervals import Box, Interval, move
from factorloc.localization._facade_kernels import meet_facades
from factorloc.localization._line_kernels import PEAK, extract_lines
from factorloc.localization.correspondence import Correspondence, Correspondences
from factorloc.localization.line_cells import LineCells, bounding_box
from factorloc.localization.line_doubt import DoubtSettings, doubts, marks
from factorloc.localization.wall_lines import WallLines
from factorloc.mapping.facade_points import FacadePoints
from factorloc.result import Bounds

__all__ = ["WIDEST_START", "CorrespondenceSettings", "find_correspondences"]

Array = npt.NDArray[np.float64]

WIDEST_START = math.radians(60.0)
"""Greatest span of headings for which facades are asked for, rad."""

_REASONS = ("short", "out of sight", "few points", "few votes", "wide", "rivalled", "uncovered", "doubtful")


class CorrespondenceSettings(Block):
    """Which facades are asked for, and which lines are believed to be theirs.

    A peak is *significant* if it has enough votes, its supporters cover enough of the facade, no other peak rivals it
    too much and its hull is not too large. The limits are wide, as every line carries its doubt along: one that is more
    often false than not is left out, and the others weigh as much as they are to be trusted.

    Parameters
    ----------
    reach : float
        Facades farther from the box of possible positions are not asked for, m.
    least_length : float
        Nor are shorter ones, m.
    threshold : float
        Cells above this part of the most votes belong to the cluster; the published value is 0.95.
    least_votes : int
        Votes of a peak.
    least_coverage : float
        Occupied 1 m bins along the facade over its length, up to 1.
    most_rivalry : float
        Second peak, more than ``apart`` away, relative to the first.
    apart : float
        m.
    most_turn, most_offset : float
        Largest hull of a cluster, rad and m.
    spare_turn : float
        The hull of directions is widened by it to either side, rad: points of a neighbour's wall with another setback
        tilt a line.
    core_threshold, core_turn : float, float
        The same two of the core of a hull: a line is more often there than in the rest.
    core_doubt : float
        Probability that a line is in its hull but not in the core. On simulated streets 9 to 11 % are; more is assumed,
        as lines of one scan do not err independently.
    doubt : DoubtSettings
        How doubtful a line is.
    most_doubt : float
        More doubtful ones are left out.
    alpha_step, d_step : float
        Cells of the accumulators, rad and m.
    """

    reach: float = Field(40.0, gt=0)
    least_length: float = Field(4.0, ge=0)
    threshold: float = Field(0.85, gt=0, lt=1)
    least_votes: int = Field(20, gt=0)
    least_coverage: float = Field(0.3, ge=0, le=1)
    most_rivalry: float = Field(0.8, ge=0, le=1)
    apart: float = Field(0.8, ge=0)
    most_turn: float = Field(math.radians(12.0), gt=0)
    most_offset: float = Field(5.0, gt=0)
    spare_turn: float = Field(math.radians(0.7), ge=0)
    core_threshold: float = Field(0.97, gt=0, lt=1)
    core_turn: float = Field(math.radians(0.2), ge=0)
    core_doubt: float = Field(0.15, gt=0, lt=0.5)
    doubt: DoubtSettings = DoubtSettings()
    most_doubt: float = Field(0.45, gt=0, lt=0.5)
    alpha_step: float = Field(math.radians(0.25), gt=0)
    d_step: float = Field(0.1, gt=0)


def find_correspondences(
    points: FacadePoints, walls: WallLines, start: Bounds, settings: CorrespondenceSettings | None = None
) -> Correspondences:
    """Associate points with facades and extract the line of each.

    Association is a bound: a point that is truly on a facade in reach is associated with it, if start, map and scan are
    within their declared bounds. That the line of the facade is in the hull of a significant peak is not guaranteed.

    Parameters
    ----------
    points : FacadePoints
        Of one scan.
    walls : WallLines
        The map.
    start : Bounds
        Where the body may be.
    settings : CorrespondenceSettings, optional
        See there.

    Raises
    ------
    GeometryError
        If no position is possible, or headings span more than 60 degrees.
    """
    settings = settings or CorrespondenceSettings()
    theta = Interval(*start.orientation)
    if theta.width > WIDEST_START:
        raise GeometryError(f"bounds: headings span {np.degrees(theta.width):.0f} degrees; facades need 60 or less")
    place = bounding_box(start)
    middle = place.mid
    rejected = dict.fromkeys(_REASONS, 0)
    near = walls.within(place, settings.reach)
    rows = near[walls.facades.lengths[near] >= settings.least_length]
    rejected["short"] = len(near) - len(rows)
    seen = walls.shares_seen_from(place, rows, settings.reach)
    near, rows, seen = rows, rows[seen > 0.0], seen[seen > 0.0]
    rejected["out of sight"] = len(near) - len(rows)
    moved = move(theta, place[0] - middle[0], place[1] - middle[1], points.boxes)
    associated = _associate(moved, walls, rows, middle)
    cells = LineCells.of(walls, rows, start, (settings.alpha_step, settings.d_step))
    peaks = np.empty((len(rows), PEAK))
    extract_lines(
        points.points, points.boxes.lo, points.boxes.hi, associated, cells.anchors, walls.facades.lengths[rows],
        cells.first_alpha, cells.bins_alpha, settings.alpha_step, cells.first_d, cells.bins_d, settings.d_step,
        settings.threshold, settings.core_threshold, math.ceil(settings.apart / settings.d_step),
        settings.least_votes, peaks,
    )  # fmt: skip
    errors = walls.vertex_d[rows] + walls.shift_d[rows]
    windows = np.asarray(cells.bins_d * settings.d_step, np.float64)
    doubt = doubts(marks(peaks, walls.facades.lengths[rows], seen, errors, windows), settings.doubt)
    reasons = _why_not(peaks, doubt, settings)
    for reason in rejected:
        rejected[reason] += reasons.count(reason)
    found = tuple(
        _line(int(rows[k]), cells.anchors[k], peaks[k], float(doubt[k]), settings)
        for k in range(len(rows))
        if not reasons[k]
    )
    return Correspondences(found, rows, associated, rejected)


def _line(row: int, anchor: Array, peak: Array, doubt: float, settings: CorrespondenceSettings) -> Correspondence:
    """Correspondence of a peak, as ``extract_lines`` writes it."""
    spare, core_spare = settings.spare_turn, settings.core_turn
    core = Interval(peak[13] - core_spare, peak[14] + core_spare), Interval(*peak[15:17])
    return Correspondence(
        row, anchor, Interval(peak[2] - spare, peak[3] + spare), Interval(*peak[4:6]), int(peak[0]),
        float(peak[1] / peak[0]), float(peak[6]), (float(peak[8]), float(peak[10])), (float(peak[7]), float(peak[11])),
        doubt, core, settings.core_doubt,
    )  # fmt: skip


def _why_not(peaks: Array, doubt: Array, settings: CorrespondenceSettings) -> list[str]:
    """Why each peak is not significant; empty where it is."""
    with np.errstate(invalid="ignore"):
        tests = [
            ("few points", np.isnan(peaks[:, 0])),
            ("few votes", peaks[:, 0] < settings.least_votes),
            ("wide", peaks[:, 3] - peaks[:, 2] > settings.most_turn + 1e-9),
            ("wide", peaks[:, 5] - peaks[:, 4] > settings.most_offset + 1e-9),
            ("rivalled", peaks[:, 1] > settings.most_rivalry * peaks[:, 0]),
            ("uncovered", peaks[:, 6] < settings.least_coverage),
            ("few votes", peaks[:, 12] < 1),
            ("doubtful", doubt > settings.most_doubt),
        ]
    reasons = [""] * len(peaks)
    for reason, failed in reversed(tests):
        for k in np.flatnonzero(failed):
            reasons[k] = reason
    return reasons


def _associate(moved: Box, walls: WallLines, rows: npt.NDArray[np.int64], middle: Array) -> npt.NDArray[np.bool_]:
    c, s = walls.cos_sin
    d = walls.vertex_d[rows] + walls.shift_d[rows]
    hull = walls.hull.bounds[:, rows] - middle[:, None]
    limits = np.ascontiguousarray(np.stack([hull.lo[0], hull.hi[0], hull.lo[1], hull.hi[1]]))
    out = np.empty((len(rows), moved.batch[0]), np.bool_)
    meet_facades(
        moved.lo[0], moved.hi[0], moved.lo[1], moved.hi[1], walls.centres[rows] - middle,
        c.lo[rows], c.hi[rows], s.lo[rows], s.hi[rows], -d, d, limits, out,
    )  # fmt: skip
    return out
