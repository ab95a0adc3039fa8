"""Pole tracking: a drive block by block, each smoothed together with the metres before it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import gtsam
import numpy as np
import numpy.typing as npt
from gtsam.symbol_shorthand import X
from pydantic import Field

from factorloc.config import Block
from factorloc.factors.native import pose_array, pose_values
from factorloc.factors.odometry import OdometryNoise, odometry_factors
from factorloc.factors.pole_detections import PoleDetections, PoleLandmarks, PoleMixture
from factorloc.factors.pole_term import PoleTerm
from factorloc.factors.prior import PosePrior
from factorloc.geometry import se2
from factorloc.localization.initialization import Initialization, NormalStart
from factorloc.localization.optimizer import Optimized, OptimizerSettings, ScanFactors, optimize
from factorloc.localization.pole_search import SearchSettings, dead_reckoned, search_pose

__all__ = ["PoleTrack", "PoleTrackingSettings", "gaussian", "propagated", "track_poles"]

Array = npt.NDArray[np.float64]

_WIDENED = 9.0  # the detections of the metres before count again: what they made of the first pose counts little
_SLACK = 1e-6


class PoleTrackingSettings(Block):
    """How a drive is tracked.

    Parameters
    ----------
    block : float
        Metres that are added at a time.
    lag : float
        Metres before them that are smoothed again.
    ahead : float
        Metres whose detections a search looks at.
    wide : float
        A position known worse than this (standard deviation, m) is searched anew.
    search : SearchSettings
        How.
    """

    block: float = Field(20.0, gt=0)
    lag: float = Field(30.0, ge=0)
    ahead: float = Field(40.0, gt=0)
    wide: float = Field(0.6, gt=0)
    search: SearchSettings = SearchSettings()


@dataclass(frozen=True)
class PoleTrack:
    """A tracked drive.

    Parameters
    ----------
    poses : ndarray, shape (N, 3)
        ``T_map_body``, each as it was known when its block was the last one but for what later blocks made of it.
    searches : int
        How often the pose was searched.
    """

    poses: Array
    searches: int


def track_poles(
    landmarks: PoleLandmarks,
    detections: PoleDetections,
    motions: Array,
    covariances: Array,
    start: Initialization,
    *,
    mixture: PoleMixture,
    information: float,
    noise: OdometryNoise,
    known: npt.NDArray[np.bool_],
    settings: PoleTrackingSettings,
    optimizer: OptimizerSettings,
    progress: Callable[[int], None] | None = None,
    seed: int = 0,
) -> PoleTrack:
    """Track a drive.

    A block begins where the one before ended, moved on by odometry. Where that is not sure enough, at the start and
    after a way without poles, the pose is searched among all that are possible (:func:`search_pose`). The block is
    smoothed with the metres before it, from a blurred map to a sharp one.

    Parameters
    ----------
    landmarks, detections, mixture, information
        As :class:`~factorloc.factors.pole_term.PoleTerm`; N local maps.
    motions : ndarray, shape (N - 1, 3)
        Odometry.
    covariances : ndarray, shape (N - 1, 3, 3)
        Of the motions.
    start : Initialization
        What is believed of the first pose.
    noise : OdometryNoise
        Its loss.
    known : ndarray of bool, shape (N - 1,)
        Which motions were measured.
    settings : PoleTrackingSettings
        Blocks and searches.
    optimizer : OptimizerSettings
        Steps and tolerances.
    progress : callable, optional
        Called with the number of local maps done.
    seed : int
        Of the searches.
    """
    n = len(detections)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(motions[:, 0], motions[:, 1]))])
    poses, spreads, matched = np.zeros((n, 3)), np.zeros((n, 3, 3)), np.zeros(n, np.bool_)
    belief: Initialization = start
    first, next_begin, searches = 0, 0, 0
    while first < n:
        last = max(int(np.searchsorted(way, way[first] + settings.block)), first + 1)
        begin = next_begin
        searched = False
        guesses = [] if first == 0 else [se2.compose(poses[first - 1], motions[first - 1])]
        reach = max(int(np.searchsorted(way, way[first] + settings.ahead)), first + 1)
        seen = len(detections.rows(first, reach).poles)
        if seen and (first == 0 or _width(belief) > settings.wide):
            found = search_pose(
                landmarks.poles.positions, detections.rows(first, reach), motions[first : reach - 1], belief,
                settings.search, seed + searches,
            )  # fmt: skip
            guesses, searches, searched = [*guesses, *found], searches + 1, True
        elif first == 0:
            guesses = [belief.sample(4096, np.random.default_rng(seed)).mean(0)]
        solve = _Window(
            landmarks, detections.rows(begin, last), motions[begin : last - 1], covariances[begin : last - 1],
            known[begin : last - 1], mixture, information, noise, optimizer,
        )  # fmt: skip
        wider = _WIDENED if matched[begin:first].any() else 1.0
        prior = gaussian(belief, seed) if begin == first == 0 else PosePrior(poses[begin], wider * spreads[begin])
        outcomes = []
        for guess in guesses:
            ahead = dead_reckoned(guess, motions[first : last - 1])
            outcomes.append(solve(np.concatenate([poses[begin:first], ahead]), prior, 0 if searched else 1))
        best = min(outcomes, key=lambda outcome: outcome.cost)
        poses[begin:last] = pose_array(best.values)
        assert best.scan_costs is not None  # every pose has a local map, if an empty one
        matched[begin:last] = best.scan_costs.hessian[:, 0, 0] > 0
        if last < n:  # only these are asked for: the last pose, and the first of the next stretch
            next_begin = min(max(int(np.searchsorted(way, way[last] - settings.lag)), begin), last - 1)
            for k in {next_begin, last - 1}:
                spreads[k] = solve.marginal(best, k - begin)
            leap = propagated(spreads[last - 1], motions[last - 1], covariances[last - 1])
            belief = NormalStart(PosePrior(se2.compose(poses[last - 1], motions[last - 1]), leap))
        if progress:
            progress(last)
        first = last
    return PoleTrack(poses, searches)


def propagated(covariance: Array, motion: Array, of_motion: Array) -> Array:
    """Covariance of a pose after a motion, each in the tangent space of its own body."""
    A = se2.adjoint(se2.inverse(motion))
    moved = A @ covariance @ A.T + of_motion
    return np.asarray((moved + moved.T) / 2 + _SLACK**2 * np.eye(3))


class _Window:
    """A stretch of the drive as a graph."""

    def __init__(
        self,
        landmarks: PoleLandmarks,
        detections: PoleDetections,
        motions: Array,
        covariances: Array,
        known: npt.NDArray[np.bool_],
        mixture: PoleMixture,
        information: float,
        noise: OdometryNoise,
        optimizer: OptimizerSettings,
    ) -> None:
        self.keys = [X(k) for k in range(len(detections))]
        self.term = PoleTerm(detections, landmarks, mixture, information)
        self.odometry = list(odometry_factors(self.keys, motions, noise, known, covariances))
        self.optimizer = optimizer

    def __call__(self, initial: Array, prior: PosePrior, coarsest: int) -> Optimized:
        graph = gtsam.NonlinearFactorGraph()
        graph.push_back(prior.factor(self.keys[0]))
        for factor in self.odometry:
            graph.push_back(factor)
        scans = ScanFactors(self.term, self.keys)
        levels = range(coarsest, len(self.term.blurs))
        return optimize(graph, pose_values(self.keys, initial), scans, levels=levels, settings=self.optimizer)

    def marginal(self, found: Optimized, row: int) -> Array:
        covariance = gtsam.Marginals(found.linear, found.values).marginalCovariance(self.keys[row])
        return np.asarray((covariance + covariance.T) / 2)


def _width(belief: Initialization) -> float:
    """Largest standard deviation of the position, m."""
    assert isinstance(belief, NormalStart)
    return float(np.sqrt(np.linalg.eigvalsh(belief.prior.covariance[:2, :2])[-1]))


def gaussian(belief: Initialization, seed: int = 0) -> PosePrior:
    """Gaussian of a planar belief: its own, or that of draws from it."""
    if isinstance(belief, NormalStart):
        return belief.prior
    draws = belief.sample(4096, np.random.default_rng(seed))
    mean = np.array([*draws[:, :2].mean(0), np.arctan2(np.sin(draws[:, 2]).mean(), np.cos(draws[:, 2]).mean())])
    tangents = se2.log(se2.between(mean, draws))
    return PosePrior(mean, np.cov(tangents.T) + _SLACK * np.eye(3))
