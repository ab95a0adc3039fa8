"""Correspondences: lines of a scan that may be facades of the map, found by the interval Hough transform."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc.config import Block
from factorloc.errors import GeometryError
from factorloc.intervals import Box, Interval, move
from factorloc.intervals.hough import HoughAccumulator
from factorloc.localization._facade_kernels import meet_facades
from factorloc.localization._line_kernels import extract_lines
from factorloc.localization.wall_lines import WallLines
from factorloc.mapping.facade_points import FacadePoints
from factorloc.result import Bounds

__all__ = [
    "Correspondence",
    "CorrespondenceSettings",
    "Correspondences",
    "accumulator_of",
    "bounding_box",
    "find_correspondences",
]

Array = npt.NDArray[np.float64]

_WIDEST_START = math.radians(60.0)


class CorrespondenceSettings(Block):
    """Which facades are asked for, and which lines are believed to be theirs.

    A peak is *significant* if it has enough votes, its supporters cover enough of the facade, no other peak rivals it
    and its hull is small. Which of these matter was measured: of short facades half the lines are false, of those with
    a second peak above 0.6 of the first a third to a half, of those below 0.2 one in a hundred.

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
    alpha_step, d_step : float
        Cells of the accumulators, rad and m.
    """

    reach: float = Field(40.0, gt=0)
    least_length: float = Field(7.0, ge=0)
    threshold: float = Field(0.85, gt=0, lt=1)
    least_votes: int = Field(20, gt=0)
    least_coverage: float = Field(0.6, ge=0, le=1)
    most_rivalry: float = Field(0.6, ge=0, le=1)
    apart: float = Field(0.8, ge=0)
    most_turn: float = Field(math.radians(4.0), gt=0)
    most_offset: float = Field(1.5, gt=0)
    alpha_step: float = Field(math.radians(0.25), gt=0)
    d_step: float = Field(0.1, gt=0)


@dataclass(frozen=True, eq=False)
class Correspondence:
    """A line of the scan that stands for a facade.

    In the frame of the body, ``n(alpha) . (p - anchor) = d`` for the points p of the line.

    Parameters
    ----------
    facade : int
        Row of the facade.
    anchor : ndarray, shape (2,)
        About where its middle is, m.
    alpha, d : Interval
        Hull of the peak, rad and m.
    votes : int
        Of the peak.
    rivalry, coverage : float
        Second peak relative to it; covered part of the facade.
    reached : float
        Median of the supporters, from the anchor along the wall, to the left of its normal, m.
    extent : (float, float)
        Where most of them (90 %) begin and end, likewise, m.
    """

    facade: int
    anchor: Array
    alpha: Interval
    d: Interval
    votes: int
    rivalry: float
    coverage: float
    reached: float
    extent: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Correspondences:
    """What a scan tells about facades.

    Parameters
    ----------
    found : tuple of Correspondence
        The significant ones.
    asked : ndarray of int, shape (A,)
        Facades in reach and in sight.
    associated : ndarray of bool, shape (A, N)
        Points that may be of each of them.
    rejected : dict of str to int
        Facades asked for without a correspondence, by reason.
    """

    found: tuple[Correspondence, ...]
    asked: npt.NDArray[np.int64]
    associated: npt.NDArray[np.bool_]
    rejected: dict[str, int]


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
    if theta.width > _WIDEST_START:
        raise GeometryError(f"bounds: headings span {np.degrees(theta.width):.0f} degrees; facades need 60 or less")
    place = bounding_box(start)
    middle = place.mid
    rejected = dict.fromkeys(("short", "out of sight", "few points", "few votes", "wide", "rivalled", "uncovered"), 0)
    near = walls.within(place, settings.reach)
    rows = near[walls.facades.lengths[near] >= settings.least_length]
    rejected["short"] = len(near) - len(rows)
    near, rows = rows, walls.seen_from(place, rows, settings.reach)
    rejected["out of sight"] = len(near) - len(rows)
    moved = move(theta, place[0] - middle[0], place[1] - middle[1], points.boxes)
    associated = _associate(moved, walls, rows, middle)
    cells = _Cells.of(walls, rows, theta, middle, _corners(start) - middle, settings)
    peaks = np.empty((len(rows), 11))
    extract_lines(
        points.points, points.boxes.lo, points.boxes.hi, associated, cells.anchors, walls.facades.lengths[rows],
        cells.first_alpha, cells.bins_alpha, settings.alpha_step, cells.first_d, cells.bins_d, settings.d_step,
        settings.threshold, math.ceil(settings.apart / settings.d_step), settings.least_votes, peaks,
    )  # fmt: skip
    reasons = _why_not(peaks, settings)
    for reason in rejected:
        rejected[reason] += reasons.count(reason)
    found = tuple(
        Correspondence(
            int(rows[k]), cells.anchors[k], Interval(*peaks[k, 2:4]), Interval(*peaks[k, 4:6]), int(peaks[k, 0]),
            float(peaks[k, 1] / peaks[k, 0]), float(peaks[k, 6]), float(peaks[k, 8]),
            (float(peaks[k, 7]), float(peaks[k, 9])),
        )
        for k in range(len(rows)) if not reasons[k]
    )  # fmt: skip
    return Correspondences(found, rows, associated, rejected)


def _corners(bounds: Bounds) -> Array:
    return np.concatenate([polygon for polygon in bounds.polygons if len(polygon)])


def _why_not(peaks: Array, settings: CorrespondenceSettings) -> list[str]:
    """Why each peak is not significant; empty where it is."""
    with np.errstate(invalid="ignore"):
        tests = [
            ("few points", np.isnan(peaks[:, 0])),
            ("few votes", peaks[:, 0] < settings.least_votes),
            ("wide", peaks[:, 3] - peaks[:, 2] > settings.most_turn + 1e-9),
            ("wide", peaks[:, 5] - peaks[:, 4] > settings.most_offset + 1e-9),
            ("rivalled", peaks[:, 1] > settings.most_rivalry * peaks[:, 0]),
            ("uncovered", peaks[:, 6] < settings.least_coverage),
            ("few votes", peaks[:, 10] < 1),
        ]
    reasons = [""] * len(peaks)
    for reason, failed in reversed(tests):
        for k in np.flatnonzero(failed):
            reasons[k] = reason
    return reasons


@dataclass(frozen=True, eq=False)
class _Cells:
    """Accumulators of K facades around their parameters: origins in the frame of the body, first cells and numbers."""

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
        theta: Interval,
        middle: Array,
        corners: Array,
        settings: CorrespondenceSettings,
    ) -> _Cells:
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
        bins_alpha = np.maximum(np.ceil((last - first) / settings.alpha_step), 1).astype(np.int64)
        bins_d = np.maximum(np.ceil((last_d - first_d) / settings.d_step), 1).astype(np.int64)
        return cls(np.ascontiguousarray(anchors), first, bins_alpha, first_d, bins_d)


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


def accumulator_of(
    points: FacadePoints,
    mask: npt.NDArray[np.bool_],
    walls: WallLines,
    row: int,
    start: Bounds,
    settings: CorrespondenceSettings | None = None,
) -> HoughAccumulator:
    """Accumulator of one facade, as :func:`find_correspondences` makes it; for pictures.

    Parameters
    ----------
    points, walls, start, settings
        As there.
    mask : ndarray of bool, shape (N,)
        Points associated with the facade.
    row : int
        Row of the facade.
    """
    settings = settings or CorrespondenceSettings()
    middle = bounding_box(start).mid
    theta = Interval(*start.orientation)
    cells = _Cells.of(walls, np.array([row]), theta, middle, _corners(start) - middle, settings)
    steps = settings.alpha_step, settings.d_step
    boxes = points.boxes.select(mask)
    local = Box(boxes.bounds - Interval(cells.anchors[0][:, None]))
    first = float(cells.first_alpha[0]), float(cells.first_d[0])
    spans = (cells.bins_alpha[0] - 0.5) * steps[0], (cells.bins_d[0] - 0.5) * steps[1]
    alpha, d = (Interval(low, low + span) for low, span in zip(first, spans, strict=True))
    return HoughAccumulator.from_boxes(local, alpha, d, alpha_step=steps[0], d_step=steps[1])
