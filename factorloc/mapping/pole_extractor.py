"""Pole extractor: from registered scans of a short stretch to the poles beside it (thesis, 12.4.1)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import betainc, betaincc, betaln

from factorloc import _jit
from factorloc.errors import MapError
from factorloc.geometry import se3
from factorloc.mapping._pole_kernels import (
    fill_tail_table,
    find_seeds,
    look_up,
    reflection_moments,
    score_slice,
    shift_to_modes,
    stack_columns,
    width_weights,
)
from factorloc.mapping.beta_prior import BetaPrior
from factorloc.mapping.grid import Grid
from factorloc.mapping.pole_evidence import find_by_evidence
from factorloc.mapping.pole_settings import NCLT_LIKE, PoleSettings
from factorloc.mapping.poles import Poles
from factorloc.mapping.reflection_window import ReflectionWindow, spatial_poses
from factorloc.mapping.shaft_fit import fit_shafts
from factorloc.scan import Scan

__all__ = ["PoleExtractor", "occupancy"]

Array = npt.NDArray[np.float64]
Single = npt.NDArray[np.float32]

_TABLE = (64, 1024)  # hits and misses up to which tails come from a table; more are rare
_REACH = 3.0  # bandwidths to where the kernel of mean shift is followed


@dataclass(frozen=True)
class PoleExtractor:
    """Finds upright objects that are surrounded by free space.

    A full-posterior reflection map of the scans becomes a map of occupancy; every box of cells is scored by its mean
    occupancy less the greatest in the hull around it; where scores surpass a threshold up to a height, columns are
    stacked; the modes of the stacks are poles.

    Parameters
    ----------
    settings : PoleSettings
        Cells and thresholds.

    Notes
    -----
    The thesis takes, for a cell, the best of the boxes whose lowest corners lie in a box that *begins* at the cell:
    most of those do not cover it, and scores would move by up to a width. Here it is the best of all boxes that cover
    the cell. The score of a pole is that of its stack; the mean over the scores of all widths, with which the thesis
    weighs, mostly tells how wide a pole is.
    """

    settings: PoleSettings = NCLT_LIKE

    def extract(self, scans: Sequence[Scan], poses: npt.ArrayLike, centre: npt.ArrayLike | None = None) -> Poles:
        """Find the poles around a place.

        Parameters
        ----------
        scans : sequence of Scan
            Spatial scans of a short stretch; none have no poles.
        poses : array_like, shape (S, 4, 4) or (S, 3)
            Pose of the body at each, in one levelled frame with z up.
        centre : array_like, shape (3,), optional
            Where the lidar is in the middle of the local map, m; by default the mean of where it was.

        Returns
        -------
        Poles
            In the frame of the poses, by falling score.

        Raises
        ------
        MapError
            If scans are planar, or there is not one pose a scan.
        """
        if len(scans) == 0:
            return Poles.none()
        bodies = spatial_poses(scans, poses)
        if centre is None:
            mounts = [scan.T_body_sensor for scan in scans]
            centre = np.mean([se3.compose(T, m)[:3, 3] for T, m in zip(bodies, mounts, strict=True)], axis=0)
        window = ReflectionWindow.from_scans(scans, bodies, self.window(centre))
        poles = self.find(window)
        return fit_shafts(poles, scans, bodies, window.grid, self.settings.hull_cells) if self.settings.fit else poles

    def window(self, centre: npt.ArrayLike) -> Grid:
        """Grid of the local map around a lidar; its cells lie on the raster of the frame.

        Parameters
        ----------
        centre : array_like, shape (3,)
            Where the lidar is, m.
        """
        s = self.settings
        place = np.asarray(centre, np.float64)
        if place.shape != (3,) or not np.isfinite(place).all():
            raise MapError(f"centre: {place.tolist()}; expected three finite coordinates")
        x, y, z = s.shape
        cells = np.round(place / s.resolution - [x / 2, y / 2, s.depth / s.resolution])
        return Grid(tuple(cells * s.resolution), s.resolution, (x, y, z))

    def find(self, window: ReflectionWindow) -> Poles:
        """Find the poles in a local map."""
        s, grid = self.settings, window.grid
        if s.evidence is not None:
            return find_by_evidence(window, s, s.evidence)
        occupied = occupancy(window, s.occupied_above)
        if occupied is None:
            return Poles.none()
        widths = np.arange(1, s.most_width + 1)
        scores = np.empty_like(occupied)

        def score(first: int, last: int) -> None:
            sums = np.empty((grid.shape[0] + 1, grid.shape[1] + 1))
            for z in range(first, last):
                score_slice(occupied[z], widths, s.hull_cells, s.least_score, sums, scores[z])

        _jit.in_threads(score, grid.shape[2])
        plane = grid.shape[:2]
        stacked, bottoms, tops = np.empty(plane), np.empty(plane, np.int64), np.empty(plane, np.int64)
        work = np.empty(plane, np.int64), np.empty(plane)
        stack_columns(scores, s.least_score, s.height_cells, *work, stacked, bottoms, tops)
        modes = _modes(stacked, s.bandwidth / grid.resolution)
        if len(modes) == 0:
            return Poles.none()
        cells = _nearest_columns(stacked, modes)
        at = tuple(cells.T)
        weights = np.empty((len(modes), len(widths)))
        sums = np.empty((plane[0] + 1, plane[1] + 1))
        width_weights(occupied, cells, bottoms[at], tops[at], widths, s.hull_cells, sums, weights)
        spans = np.stack([bottoms[at], tops[at]], 1) * grid.resolution + grid.origin[2]
        poles = Poles(
            (modes + 0.5) * grid.resolution + grid.origin[:2],
            grid.resolution * (weights @ widths) / weights.sum(1),
            spans,
            stacked[at],
        )
        return poles.select(np.argsort(-poles.scores, kind="stable"))


def occupancy(window: ReflectionWindow, above: float) -> Single | None:
    """Probability of every cell to reflect more of its rays than that, shape (n_z, n_x, n_y).

    The prior of all cells has the moments of H / (H + M) over the visited cells (thesis, 12.4.1).

    Parameters
    ----------
    window : ReflectionWindow
        Hits and misses.
    above : float
        Reflection probability.

    Returns
    -------
    ndarray of float32 or None
        None if no cell was hit or none was missed: there is nothing to tell occupied from free.
    """
    prior = _prior(window)
    if prior is None:
        return None
    alpha, beta = prior.hits, prior.misses
    table = np.empty(_TABLE)
    term = math.exp(alpha * math.log(above) + beta * math.log1p(-above) - betaln(alpha, beta))
    fill_tail_table(float(betaincc(alpha, beta, above)), term, alpha, beta, above, table)
    n_x, n_y, n_z = window.grid.shape
    result = np.empty((n_z, n_x, n_y), np.float32)
    hits, misses = window.rimmed_hits, window.rimmed_misses
    _jit.in_threads(lambda first, last: look_up(hits, misses, table, first, last, result), n_z)
    beyond = result < 0
    if beyond.any():
        h, m = (counts[1:-1, 1:-1, 1:-1][beyond].astype(np.float64) for counts in (hits, misses))
        result[beyond] = 1.0 - betainc(h + alpha, m + beta, above)
    return result


def _prior(window: ReflectionWindow) -> BetaPrior | None:
    """Beta distribution with the moments of H / (H + M); one of half a ray where all cells are 0 or 1."""
    count, first, second = reflection_moments(
        window.rimmed_hits[1:-1].reshape(-1), window.rimmed_misses[1:-1].reshape(-1)
    )
    if count == 0 or first == 0 or first == count:
        return None
    mean = first / count
    variance = second / count - mean**2
    total = mean * (1 - mean) / variance - 1 if variance > 0 else math.inf
    if not 1e-6 < total < math.inf:
        total = 0.5
    return BetaPrior(mean * total, (1 - mean) * total)


def _modes(stacked: Array, bandwidth: float) -> Array:
    """Modes of a score map, cells, (N, 2), from its local maxima; those that meet are one."""
    seeds = np.empty((1024, 2))
    count = find_seeds(stacked, seeds)
    if count > len(seeds):
        seeds = np.empty((count, 2))
        find_seeds(stacked, seeds)
    modes = seeds[:count].copy()
    shift_to_modes(stacked, bandwidth, math.ceil(_REACH * bandwidth), modes)
    kept: list[Array] = []
    for mode in modes:
        if all(np.hypot(*(mode - other)) > 0.5 for other in kept):
            kept.append(mode)
    return np.array(kept).reshape(-1, 2)


def _nearest_columns(stacked: Array, modes: Array) -> npt.NDArray[np.int64]:
    """Of the columns with a stack, the one nearest to each mode, which may lie between two, (N, 2)."""
    cells = np.round(modes).astype(np.int64)
    for k, mode in enumerate(modes):
        if stacked[tuple(cells[k])] <= 0:
            columns = np.argwhere(stacked > 0)
            cells[k] = columns[np.argmin(np.hypot(*(columns - mode).T))]
    return cells
