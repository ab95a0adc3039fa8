"""Pole fit: a drive tracked, and solved as a whole, with odometry calibrated on the way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from factorloc.factors.native import pose_array
from factorloc.localization.initialization import Initialization
from factorloc.localization.odometry_calibration import OdometryCalibration
from factorloc.localization.optimizer import Optimized
from factorloc.localization.pole_graph import PoleGraph
from factorloc.localization.pole_observations import PoleObservations
from factorloc.localization.pole_tracking import PoleTrackingSettings, gaussian, track_poles
from factorloc.localization.pole_window import WindowModel
from factorloc.result import Iteration

__all__ = ["PoleFit"]


@dataclass(frozen=True)
class PoleFit:
    """A drive in a map of poles that is believed in all its landmarks.

    Parameters
    ----------
    graph : PoleGraph
        Of the whole drive, odometry calibrated.
    found : Optimized
        Its solution.
    calibration : OdometryCalibration
        What was wrong with odometry all along.
    searches : int
        How often the pose was searched.
    history : tuple of Iteration
        Steps of all solutions.
    """

    graph: PoleGraph
    found: Optimized
    calibration: OdometryCalibration
    searches: int
    history: tuple[Iteration, ...]

    @classmethod
    def of(
        cls,
        model: WindowModel,
        given: PoleObservations,
        start: Initialization,
        settings: PoleTrackingSettings,
        progress: Callable[[int], None] | None = None,
        seed: int = 0,
    ) -> PoleFit:
        """Track a drive, and solve it twice: what tracking left of wrong scale and drift is seen in the first solution.

        Parameters
        ----------
        model : WindowModel
            Map, mixture, losses.
        given : PoleObservations
            Detections and odometry.
        start : Initialization
            What is believed of the first pose.
        settings : PoleTrackingSettings
            Of the tracking.
        progress : callable, optional
            Called with the number of poses tracked.
        seed : int
            Of the searches.
        """
        track = track_poles(
            model, given.detections, given.motions, given.covariances, given.measured, start, settings, progress, seed
        )
        prior = gaussian(start, seed)

        def graph_of(calibration: OdometryCalibration) -> PoleGraph:
            return PoleGraph(
                given.detections, calibration.applied(given.motions), given.covariances, given.measured, model.noise,
                model.mixture, model.information, model.optimizer, prior,
            )  # fmt: skip

        graph = graph_of(track.calibration)
        rough = graph.solve(model.landmarks, track.poses, (1, 2, 3))
        left = OdometryCalibration.of(pose_array(rough.values), graph.motions, given.measured)
        calibration = track.calibration.then(left)
        graph = graph_of(calibration)
        found = graph.solve(model.landmarks, pose_array(rough.values), (2, 3))
        return cls(graph, found, calibration, track.searches, rough.history)
