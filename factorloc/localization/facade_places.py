"""Facade places: where among facades a scan may be from, told by how near all its points are to some wall.

A line is found for a wall that is known about; of a place that is metres off, no line tells. All points do: from
a wrong place half of them are in the middle of a street, or behind walls.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import shapely
from pydantic import Field

from factorloc.config import Block
from factorloc.localization.least_squares_settings import LeastSquaresSettings
from factorloc.localization.wall_lines import WallLines
from factorloc.mapping.end_point import EndPointModel
from factorloc.mapping.facade_likelihood import facade_likelihood
from factorloc.mapping.facade_points import FacadePoints
from factorloc.result import Bounds
from factorloc.scan import Scan

__all__ = ["FacadePlaces", "PlaceSettings"]

Array = npt.NDArray[np.float64]

_ROOM = 20.0  # m; so much farther than asked for, the likelihood is made at once


class PlaceSettings(Block):
    """How places are looked for.

    Parameters
    ----------
    points : int
        About so many points of a scan are looked up.
    step_position, step_heading : float
        Grid of poses in a set, m and rad; walls are looked up no more sharply than the step.
    most_poses : int
        In a set that has more poses, the grid is wider.
    apart : float
        Places are at least so far from each other, m.
    hit, random : float
        Weights of walls and of everything else.
    resolution, farthest : float
        Of the field of distances: edge of a cell, and where they end, m.
    reach : float
        Points farther along x or y are not looked up, m.
    """

    points: int = Field(200, gt=0)
    step_position: float = Field(0.5, gt=0)
    step_heading: float = Field(math.radians(1.0), gt=0)
    most_poses: int = Field(50_000, gt=0)
    apart: float = Field(1.5, gt=0)
    hit: float = Field(0.9, gt=0)
    random: float = Field(0.1, gt=0)
    resolution: float = Field(0.2, gt=0)
    farthest: float = Field(3.0, gt=0)
    reach: float = Field(50.0, gt=0)


class FacadePlaces:
    """Log likelihoods of scans among the facades of a map (end-point model; thesis, section 7.3.2).

    The field of distances is that of a square around where it is asked for, and made anew where that ends: about 15 MB,
    however large the map.

    Parameters
    ----------
    walls : WallLines
        The map.
    settings : PlaceSettings
        See there.
    likely : LeastSquaresSettings
        Standard deviations of points and of the errors of the map.
    """

    def __init__(self, walls: WallLines, settings: PlaceSettings, likely: LeastSquaresSettings) -> None:
        self.walls, self.settings = walls, settings
        facades = walls.facades
        parts = likely.point_sigma, likely.shift_sigma * facades.shifts, likely.vertex_sigma * facades.vertex_errors
        spread = math.sqrt(sum(float(np.median(part)) ** 2 for part in parts)) if len(facades) else 0.0
        self.sigma = max(spread, settings.step_position)
        self._middle, self._room = np.zeros(2), -1.0
        self._model: EndPointModel | None = None

    def scores(self, points: FacadePoints, poses: Array) -> Array:
        """Log likelihoods of a scan at some poses (P, 3), up to a constant of the scan; natural units, shape (P,)."""
        near = points.points[np.abs(points.points).max(1, initial=0.0) < self.settings.reach]
        model = self._model_around(poses[:, :2]) if len(near) else None
        if model is None:
            return np.zeros(len(poses))
        ends = near[:: max(len(near) // self.settings.points, 1)]
        return model.scan_log_likelihoods(Scan.from_points(ends, (0.0, 2.0 * self.settings.reach)), poses)

    def best(self, points: FacadePoints, bounds: Bounds, number: int) -> Array:
        """The poses of a set that fit a scan best, one a place and at most so many, best first, shape (P, 3).

        Parameters
        ----------
        points : FacadePoints
            The scan.
        bounds : Bounds
            The set; not empty.
        number : int
            Places.
        """
        settings = self.settings
        low, high = bounds.orientation
        turns = max(math.ceil((high - low) / settings.step_heading), 1)
        sides = np.ptp(np.concatenate(bounds.polygons), axis=0)
        least = math.sqrt(float(sides.prod()) * turns / settings.most_poses)
        spots = _spots(bounds, max(settings.step_position, least))
        headings = low + (np.arange(turns) + 0.5) * (high - low) / turns
        poses = np.concatenate([np.repeat(spots, turns, 0), np.tile(headings, len(spots))[:, None]], 1)
        scores = self.scores(points, poses).reshape(len(spots), turns)
        poses = poses.reshape(len(spots), turns, 3)[np.arange(len(spots)), scores.argmax(1)]
        kept = list[Array]()
        for k in np.argsort(-scores.max(1), kind="stable"):
            if all(math.hypot(*(poses[k] - one)[:2]) >= settings.apart for one in kept):
                kept.append(poses[k])
            if len(kept) == number:
                break
        return np.array(kept)

    def _model_around(self, spots: Array) -> EndPointModel | None:
        """Likelihood around some positions; None where there is no facade."""
        low, high = spots.min(0), spots.max(0)
        if max(float(np.abs(low - self._middle).max()), float(np.abs(high - self._middle).max())) > self._room:
            settings = self.settings
            self._middle, self._room = 0.5 * (low + high), _ROOM + 0.5 * float((high - low).max())
            near = self.walls.facades.within(self._middle, math.sqrt(2.0) * (self._room + settings.reach))
            self._model = None
            if len(near):
                self._model = facade_likelihood(
                    self.walls.facades.select(near), self.sigma, hit=settings.hit, random=settings.random,
                    resolution=settings.resolution, farthest=settings.farthest, margin=settings.farthest,
                )  # fmt: skip
        return self._model


def _spots(bounds: Bounds, step: float) -> Array:
    """Positions of a set: the middle of each of its polygons, and those of a grid, shape (S, 2)."""
    corners = np.concatenate(bounds.polygons)
    low, high = corners.min(0), corners.max(0)
    axes = [low[k] + step * (np.arange(math.ceil((high[k] - low[k]) / step)) + 0.5) for k in range(2)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 2)
    within = np.zeros(len(grid), np.bool_)
    for polygon in bounds.polygons:
        within |= shapely.contains_xy(shapely.convex_hull(shapely.MultiPoint(polygon)), grid[:, 0], grid[:, 1])
    return np.concatenate([[polygon.mean(0) for polygon in bounds.polygons], grid[within]])
