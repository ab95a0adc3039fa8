"""Pole tracking: a drive block by block, each smoothed together with the metres before it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc.config import Block
from factorloc.factors.pole_detections import PoleDetections
from factorloc.factors.prior import PosePrior
from factorloc.geometry import se2
from factorloc.localization.calibration_belief import CalibrationBelief
from factorloc.localization.initialization import Initialization, NormalStart
from factorloc.localization.odometry_calibration import OdometryCalibration
from factorloc.localization.pole_hypothesis import PoleHypothesis, select_hypotheses
from factorloc.localization.pole_search import SearchSettings, dead_reckoned, search_pose
from factorloc.localization.pole_window import PoleWindow, WindowModel

__all__ = ["PoleTrack", "PoleTrackingSettings", "gaussian", "track_poles"]

Array = npt.NDArray[np.float64]

_WIDENED = 9.0  # the detections of the metres before count again: what they made of the first pose counts little
_SLACK = 1e-6
_ENOUGH, _SOME = 20, 4  # detections before a block, and in it, from which on it may be in doubt


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
    hypotheses : int
        So many places that a search found are tracked, until detections have told them apart.
    margin : float
        One that costs more than the best by this is given up.
    doubt : float
        Where a block's detections fit less than this share of what they did on average before, the pose is searched.
    astray : (float, float)
        Standard deviations of a pose that is in doubt, m and rad: wheels slip, and landmarks are taken for others.
    scale, drift : float
        Standard deviations of what odometry is wrong by all along, m/m and rad/m.
    """

    block: float = Field(20.0, gt=0)
    lag: float = Field(30.0, ge=0)
    ahead: float = Field(40.0, gt=0)
    wide: float = Field(0.6, gt=0)
    search: SearchSettings = SearchSettings()
    hypotheses: int = Field(6, gt=0)
    margin: float = Field(8.0, gt=0)
    doubt: float = Field(0.4, ge=0, lt=1)
    astray: tuple[float, float] = (2.0, 0.1)
    scale: float = Field(0.02, gt=0)
    drift: float = Field(3e-4, gt=0)


@dataclass(frozen=True)
class PoleTrack:
    """A tracked drive.

    Parameters
    ----------
    poses : ndarray, shape (N, 3)
        ``T_map_body``, each as it was known when its block was the last one but for what later blocks made of it.
    searches : int
        How often the pose was searched.
    calibration : OdometryCalibration
        What was wrong with odometry all along.
    """

    poses: Array
    searches: int
    calibration: OdometryCalibration


def track_poles(
    model: WindowModel,
    detections: PoleDetections,
    motions: Array,
    covariances: Array,
    known: npt.NDArray[np.bool_],
    start: Initialization,
    settings: PoleTrackingSettings,
    progress: Callable[[int], None] | None = None,
    seed: int = 0,
) -> PoleTrack:
    """Track a drive.

    A block begins where the one before ended, moved on by odometry. Where that is not sure enough, at the start and
    after a way without poles, the pose is searched among all that are possible (:func:`search_pose`), and the best are
    all tracked until their costs differ. A block is smoothed with the metres before it, from a blurred map to a sharp
    one, and scale and drift of odometry with them.

    Parameters
    ----------
    model : WindowModel
        The map and how it is seen.
    detections : PoleDetections
        Of N local maps.
    motions, covariances : ndarray, shapes (N - 1, 3), (N - 1, 3, 3)
        Odometry.
    known : ndarray of bool, shape (N - 1,)
        Which motions were measured.
    start : Initialization
        What is believed of the first pose.
    settings : PoleTrackingSettings
        Blocks, searches, hypotheses.
    progress : callable, optional
        Called with the number of local maps done.
    seed : int
        Of the searches.
    """
    drive = _Drive(model, detections, motions, covariances, known, start, settings, seed)
    alive = [PoleHypothesis.start(len(detections), CalibrationBelief.from_sigmas(settings.scale, settings.drift))]
    first = 0
    while first < len(detections):
        last = drive.block(first)
        grown = [each for one in alive for each in drive.grown(one, first, last)]
        best = min(grown, key=lambda each: each.cost)
        if drive.in_doubt(best, first, last):
            grown += drive.grown(alive[0], first, last, astray=True)
        alive = select_hypotheses(grown, last - 1, settings.hypotheses, settings.margin)
        if progress:
            progress(last)
        first = last
    return PoleTrack(alive[0].poses, drive.searches, alive[0].calibration.mean)


@dataclass
class _Drive:
    """What is tracked; arguments as :func:`track_poles`."""

    model: WindowModel
    detections: PoleDetections
    motions: Array
    covariances: Array
    known: npt.NDArray[np.bool_]
    start: Initialization
    settings: PoleTrackingSettings
    seed: int
    searches: int = 0

    def __post_init__(self) -> None:
        self.way = se2.way(self.motions)

    def block(self, first: int) -> int:
        """Pose behind the last one of the block that begins here."""
        return self._reach(first, self.settings.block)

    def in_doubt(self, one: PoleHypothesis, first: int, last: int) -> bool:
        """Whether the detections of a block fit the map much worse than those before it did."""
        before, now = self.detections.offsets[first], self.detections.offsets[last] - self.detections.offsets[first]
        if before < _ENOUGH or now < _SOME:
            return False
        usual = one.scan_costs[:first].sum() / before
        return bool(one.scan_costs[first:last].sum() / now > self.settings.doubt * usual)

    def grown(self, one: PoleHypothesis, first: int, last: int, astray: bool = False) -> list[PoleHypothesis]:
        """Track a block: one hypothesis, or more where a pose was searched, as it is if it went astray."""
        begin, motions = one.begin, one.calibration.mean.applied(self.motions)
        guesses, searched = self._guesses(one, first, motions, astray)
        if begin == first == 0:
            prior = gaussian(self.start, self.seed)
        else:
            wider = _WIDENED if one.matched[begin:first].any() else 1.0
            prior = PosePrior(one.poses[begin], wider * one.covariances[begin])
        part = slice(begin, last - 1)
        window = PoleWindow(
            self.model, self.detections.rows(begin, last), self.motions[part], self.covariances[part],
            self.known[part], prior, one.calibration,
        )  # fmt: skip
        way, before = self.way, max(first - 1, 0)
        share = float((way[last - 1] - way[before]) / max(way[last - 1] - way[begin], 1e-9))
        # The lag is counted from the first pose of the next block.
        behind = int(np.searchsorted(way, way[min(last, len(way) - 1)] - self.settings.lag))
        following = min(max(behind, begin), last - 1)
        out = []
        for guess in guesses:
            path = np.concatenate([one.poses[begin:first], dead_reckoned(guess, motions[first : last - 1])])
            found = window.solve(path, 0 if searched else 1)
            out.append(one.extended(found, prior, last, following, share))
        return out

    def _guesses(self, one: PoleHypothesis, first: int, motions: Array, astray: bool) -> tuple[list[Array], bool]:
        """Where the first pose of a block may be, and whether it was searched."""
        belief: Initialization = self.start
        guesses: list[Array] = []
        if first > 0:
            normal = one.ahead(motions[first - 1], self.covariances[first - 1])
            guesses, belief = [normal.prior.pose], normal
            if astray:
                position, heading = self.settings.astray
                guesses, belief = [], NormalStart.standing(normal.prior.pose, position, heading)
            elif np.linalg.eigvalsh(normal.prior.covariance[:2, :2])[-1] <= self.settings.wide**2:
                return guesses, False
        reach = self._reach(first, self.settings.ahead)
        seen = self.detections.rows(first, reach)
        if len(seen.poles) == 0:
            return guesses or [gaussian(self.start, self.seed).pose], False
        found = search_pose(
            self.model.landmarks.poles.positions, seen, motions[first : reach - 1], belief, self.settings.search,
            self.seed + self.searches,
        )  # fmt: skip
        self.searches += 1
        return [*guesses, *found], True

    def _reach(self, first: int, length: float) -> int:
        return max(int(np.searchsorted(self.way, self.way[first] + length)), first + 1)


def gaussian(belief: Initialization, seed: int = 0) -> PosePrior:
    """Gaussian of a planar belief: its own, or that of draws from it."""
    if isinstance(belief, NormalStart):
        return belief.prior
    draws = belief.sample(4096, np.random.default_rng(seed))
    mean = np.array([*draws[:, :2].mean(0), np.arctan2(np.sin(draws[:, 2]).mean(), np.cos(draws[:, 2]).mean())])
    tangents = se2.log(se2.between(mean, draws))
    return PosePrior(mean, np.cov(tangents.T) + _SLACK * np.eye(3))
