"""Pole search: which of many poses explains the poles seen along some metres of a drive best."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc.config import Block
from factorloc.factors.pole_detections import PoleDetections
from factorloc.geometry import se2
from factorloc.localization.initialization import Initialization
from factorloc.mapping.pole_likelihood import PoleLikelihood, pole_scan

__all__ = ["SearchSettings", "dead_reckoned", "search_pose"]

Array = npt.NDArray[np.float64]

_FINER = 0.25  # m; a second draw spreads so far around the best of the first


class SearchSettings(Block):
    """How a pose is searched.

    Parameters
    ----------
    candidates : int
        Poses that are asked in each of two draws.
    kept : int
        Best ones that are returned, apart from each other.
    apart : float
        How far apart, m.
    sigma : float
        Standard deviation of a detection's distance, m: what odometry adds up to on the way, and the spread of the
        candidates.
    epsilon : float
        Density of detections that are not in the map, 1/m.
    """

    candidates: int = Field(8000, gt=0)
    kept: int = Field(4, gt=0)
    apart: float = Field(0.6, gt=0)
    sigma: float = Field(0.5, gt=0)
    epsilon: float = Field(0.1, gt=0)


def dead_reckoned(start: npt.ArrayLike, motions: Array) -> Array:
    """Poses (N + 1, 3) of motions (N, 3) from a start."""
    poses = np.empty((len(motions) + 1, 3))
    poses[0] = start
    for k, motion in enumerate(motions):
        poses[k + 1] = se2.compose(poses[k], motion)
    return poses


def search_pose(
    positions: npt.ArrayLike,
    detections: PoleDetections,
    motions: Array,
    start: Initialization,
    settings: SearchSettings | None = None,
    seed: int = 0,
) -> Array:
    """Draw poses, weigh each by all detections of the next metres, and again around the best.

    Parameters
    ----------
    positions : array_like, shape (L, 2)
        Poles of the map, m.
    detections : PoleDetections
        Of N local maps.
    motions : ndarray, shape (N - 1, 3)
        Between them; the detections are written in the frame of the first by odometry.
    start : Initialization
        What is believed of the first pose.
    settings : SearchSettings, optional
        How it is searched.
    seed : int
        Of the draws.

    Returns
    -------
    ndarray, shape (C, 3)
        Poses of the first local map, the likeliest first; at least one.
    """
    settings = settings or SearchSettings()
    rng = np.random.default_rng(seed)
    model = PoleLikelihood(np.asarray(positions), settings.sigma, settings.epsilon, 4 * settings.sigma, None)
    together = pole_scan(detections.placed(dead_reckoned(np.zeros(3), motions)))
    poses = start.sample(settings.candidates, rng)
    best = _apart(poses, model.scan_log_likelihoods(together, poses), settings)
    finer = np.concatenate([best[rng.integers(len(best), size=settings.candidates)], best])
    finer[: -len(best)] += rng.normal(0, _FINER, (settings.candidates, 3)) * [1.0, 1.0, 0.1]
    return _apart(finer, model.scan_log_likelihoods(together, finer), settings)


def _apart(poses: Array, scores: Array, settings: SearchSettings) -> Array:
    """The best poses, each apart from all better ones."""
    kept: list[Array] = []
    for row in np.argsort(-scores, kind="stable")[: 50 * settings.kept]:
        if all(np.hypot(*(poses[row, :2] - other[:2])) >= settings.apart for other in kept):
            kept.append(poses[row])
        if len(kept) == settings.kept:
            break
    return np.array(kept)
