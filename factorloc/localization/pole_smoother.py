"""Pole smoother: a whole drive in a map of poles, from odometry and the poles of its local maps."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
from pydantic import Field
from scipy.spatial import cKDTree

from factorloc.config import Block
from factorloc.errors import MapError
from factorloc.factors.native import pose_array
from factorloc.factors.odometry import OdometryNoise
from factorloc.factors.pole_detections import PoleDetections, PoleLandmarks, PoleMixture
from factorloc.factors.prior import PosePrior
from factorloc.geometry import position_heading, se2
from factorloc.localization.drive_noise import UNTOLD, DriveNoise
from factorloc.localization.initialization import AroundPose, Initialization, NormalStart
from factorloc.localization.landmark_trust import LandmarkTrust
from factorloc.localization.moved_poles import MovedPolesSettings, find_moved_groups
from factorloc.localization.optimizer import OptimizerSettings
from factorloc.localization.pole_consensus import Conflict, ConsensusSettings
from factorloc.localization.pole_fit import PoleFit
from factorloc.localization.pole_localization import PoleLocalization
from factorloc.localization.pole_observations import PoleObservations
from factorloc.localization.pole_tracking import PoleTrackingSettings
from factorloc.localization.pole_window import WindowModel
from factorloc.localization.smoother import marginal_covariances
from factorloc.mapping.poles import Poles
from factorloc.result import Result
from factorloc.trajectory import Trajectory

__all__ = ["PoleSmootherSettings", "smooth_poles"]

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]


class PoleSmootherSettings(Block):
    """Everything the localization among poles may be told; the defaults run.

    Parameters
    ----------
    mixture : PoleMixture
        How detections come from landmarks.
    information : float
        Weight of the detections: a landmark has the same error in all local maps that see it.
    duplicates : float
        Landmarks nearer to another than this are left out, m.
    start_position, start_heading : float
        Radius (m) and largest turn (rad) around a start that is given as a pose.
    lost : float
        A stretch without any matched pole longer than this is reported, m.
    map_position, map_heading : float
        Standard deviations of what the map itself is wrong by at any one place, m and rad, added to every covariance.
    odometry : OdometryNoise, optional
        Noise of motions that come without covariances, and the loss of all. By default the noise is found from the
        drive itself: it is localized with a generous one first, and what odometry was then off by is taken.
    tracking : PoleTrackingSettings
    consensus : ConsensusSettings
    moved : MovedPolesSettings
    optimizer : OptimizerSettings
    """

    mixture: PoleMixture = PoleMixture()
    information: float = Field(0.3, gt=0, le=1)
    duplicates: float = Field(0.3, ge=0)
    start_position: float = Field(3.0, gt=0)
    start_heading: float = Field(float(np.radians(5.0)), gt=0)
    lost: float = Field(200.0, gt=0)
    map_position: float = Field(0.03, ge=0)
    map_heading: float = Field(0.002, ge=0)
    odometry: OdometryNoise | None = None
    tracking: PoleTrackingSettings = PoleTrackingSettings()
    consensus: ConsensusSettings = ConsensusSettings()
    moved: MovedPolesSettings = MovedPolesSettings()
    optimizer: OptimizerSettings = OptimizerSettings()


def smooth_poles(
    landmarks: PoleLandmarks,
    local_maps: Sequence[Poles] | PoleDetections,
    odometry: npt.ArrayLike,
    start: npt.ArrayLike | PosePrior | Initialization,
    *,
    known: npt.ArrayLike | None = None,
    covariances: npt.ArrayLike | None = None,
    stamps: npt.ArrayLike | None = None,
    frame: str = "map",
    settings: PoleSmootherSettings | None = None,
    progress: Callable[[int], None] | None = None,
    seed: int = 0,
) -> PoleLocalization:
    """Localize a drive.

    It is tracked block by block (:func:`~factorloc.localization.pole_tracking.track_poles`) and then smoothed as a
    whole, association and poses together. The estimate is held against odometry
    (:mod:`~factorloc.localization.pole_consensus`): landmarks that agree with each other, but not with the way that was
    driven, are named and left out, until none is left.

    Parameters
    ----------
    landmarks : PoleLandmarks
        The map.
    local_maps : sequence of Poles, or PoleDetections
        Poles seen from each of N poses, in the frame of the body; ``Poles.none()`` where there is no local map.
    odometry : array_like, shape (N - 1, 3)
        Motions of the body between them.
    start : array_like, shape (3,), PosePrior or Initialization
        Where the drive begins, about: a pose that may be off by what the settings say, or a belief of its own.
    known : array_like of bool, shape (N - 1,), optional
        Which motions were measured.
    covariances : array_like, shape (N - 1, 3, 3), optional
        Of the motions, in the tangent space of the body after each; by default as the settings say.
    stamps : array_like, shape (N,), optional
        Times, s; numbers of poses by default.
    frame : str
        Name of the map's frame.
    settings : PoleSmootherSettings, optional
        All settings.
    progress : callable, optional
        Called with the number of poses tracked.
    seed : int
        Of the search for the start.

    Raises
    ------
    MapError
        If there are no landmarks, or none near the start and the way from there.
    GeometryError
        If numbers of local maps, motions and flags disagree.
    """
    began = time.perf_counter()
    settings = settings or PoleSmootherSettings()
    given = PoleObservations.of(local_maps, odometry, known, covariances, settings.odometry or UNTOLD)
    detections, motions, measured = given.detections, given.motions, given.measured
    n = len(detections)
    belief = _belief(start, settings)
    way = float(np.hypot(motions[:, 0], motions[:, 1]).sum())
    _require_near(landmarks, belief, way, seed)
    kept = _distinct(landmarks, settings.duplicates)
    used = landmarks.select(kept)
    loss = settings.odometry or UNTOLD
    model = WindowModel(used, settings.mixture, settings.information, loss, settings.optimizer)
    fit = PoleFit.of(model, given, belief, settings.tracking, progress, seed)
    source = "odometry: covariances as given" if covariances is not None else "odometry: noise as set"
    if covariances is None and settings.odometry is None:
        found, driven = pose_array(fit.found.values), fit.calibration.applied(given.motions)
        noise = DriveNoise.of(found, driven, given.measured)
        if noise is None:
            source = (
                "odometry: came without covariances, and the drive is too short to tell its noise: a moved row of "
                "landmarks may pass; give covariances or settings.odometry"
            )
        else:
            source = f"odometry: came without covariances; against the map it is good to {noise}"
            given = given.with_covariances(noise.covariances(driven))
            fit = PoleFit.of(model, given, belief, settings.tracking, progress, seed)
    graph, found_all = fit.graph, fit.found
    consensus = LandmarkTrust(graph, used, found_all, settings.consensus, settings.moved.reach)
    consensus.seek()
    consensus.pardon()
    solved, trusted = consensus.found, consensus.trusted
    poses = pose_array(solved.values)
    matches = consensus.matches()
    matches = np.where(matches >= 0, kept[matches], -1)
    conflicts = [Conflict(c.first, c.last, c.distance, kept[c.landmarks]) for c in consensus.conflicts]
    missed, moved = find_moved_groups(poses, detections, matches, landmarks.poles.positions, settings.moved)
    floor = np.diag(position_heading(2, settings.map_position, settings.map_heading) ** 2)
    times = np.arange(n, dtype=np.float64) if stamps is None else np.asarray(stamps, np.float64)
    trajectory = Trajectory(times, poses, marginal_covariances(solved, graph.keys) + floor, world=frame)
    residuals = {"odometry": graph.odometry_costs(solved)}
    if solved.scan_costs is not None:
        residuals["scan"] = solved.scan_costs.cost
    distrusted = kept[~trusted]
    rejected = {
        "detections without landmark": int((matches < 0).sum()),
        "local maps without poles": int((np.diff(detections.offsets) == 0).sum()),
        "metres farthest without a pole": round(_longest_gap(motions, detections, matches)),
        "duplicate landmarks": len(landmarks) - len(used),
        "landmarks distrusted": len(distrusted),
        "landmarks missed": len(missed),
        "bridges odometry does not meet": consensus.broken,
        "motions not measured": int((~measured).sum()),
        "searches": fit.searches,
    }
    result = Result(
        trajectory, solved.cost, fit.history + consensus.history, solved.stop, residuals, rejected,
        time.perf_counter() - began,
    )  # fmt: skip
    return PoleLocalization(
        result, matches, distrusted, tuple(conflicts), missed, tuple(moved), fit.calibration, source
    )


def _belief(start: npt.ArrayLike | PosePrior | Initialization, settings: PoleSmootherSettings) -> Initialization:
    if isinstance(start, Initialization):
        return start
    if isinstance(start, PosePrior):
        return NormalStart(start)
    return AroundPose(np.asarray(start, np.float64), settings.start_position, settings.start_heading)


def _require_near(landmarks: PoleLandmarks, belief: Initialization, way: float, seed: int) -> None:
    """Refuse a map that the drive cannot reach: it is of another place, or in another coordinate system."""
    if len(landmarks) == 0:
        raise MapError("landmarks: none; a map without poles localizes nothing")
    about = belief.sample(64, np.random.default_rng(seed))[:, :2].mean(0)
    nearest = float(np.hypot(*(landmarks.poles.positions - about).T).min())
    if nearest > way + 100.0:
        raise MapError(
            f"landmarks: the nearest is {nearest:.0f} m from the start, the drive {way:.0f} m long; is the map of "
            "another place, or in another coordinate system?"
        )


def _distinct(landmarks: PoleLandmarks, distance: float) -> Index:
    """Rows of landmarks that are not near another one with a higher score."""
    order = np.argsort(-landmarks.poles.scores, kind="stable")
    positions = landmarks.poles.positions
    kept = np.ones(len(landmarks), np.bool_)
    if distance > 0:
        rank = np.argsort(order)
        for a, b in cKDTree(positions).query_pairs(distance):
            worse = a if rank[a] > rank[b] else b
            kept[worse] = False
    return np.flatnonzero(kept)


def _longest_gap(motions: Array, detections: PoleDetections, matches: Index) -> float:
    """Longest way without a matched pole, m."""
    way = se2.way(motions)
    seen = way[np.unique(detections.pose_of[matches >= 0])]
    return float(np.diff(np.concatenate([[0.0], seen, [way[-1]]])).max())
