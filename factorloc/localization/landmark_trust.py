"""Landmark trust: leave out the landmarks that contradict odometry, and take back those that do not."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from factorloc.factors.native import pose_array
from factorloc.factors.pole_detections import PoleLandmarks
from factorloc.localization.moved_poles import visibility
from factorloc.localization.optimizer import Optimized
from factorloc.localization.pole_consensus import Conflict, ConsensusSettings, bridge, find_conflicts
from factorloc.localization.pole_graph import PoleGraph

__all__ = ["LandmarkTrust"]

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]


class LandmarkTrust:
    """Landmarks and an estimate on their way to agree with odometry.

    Parameters
    ----------
    graph : PoleGraph
        Of the drive.
    landmarks : PoleLandmarks
        The map.
    found : Optimized
        The graph, solved with all landmarks.
    settings : ConsensusSettings
        When they disagree.
    reach : float
        How far a local map sees, m.

    Attributes
    ----------
    trusted : ndarray of bool, shape (L,)
        Landmarks that take part.
    found : Optimized
        The graph, solved with those.
    conflicts : list of Conflict
        What was found, with rows of the landmarks.
    broken : int
        Bridges that odometry does not meet, in the end.
    history : tuple of Iteration
        Steps of all solutions.
    """

    def __init__(
        self, graph: PoleGraph, landmarks: PoleLandmarks, found: Optimized, settings: ConsensusSettings, reach: float
    ) -> None:
        self.graph, self.landmarks, self.found = graph, landmarks, found
        self.settings, self.reach = settings, reach
        self.trusted = np.ones(len(landmarks), np.bool_)
        self.conflicts: list[Conflict] = []
        self.broken = 0
        self.history = found.history

    def matches(self) -> Index:
        """Landmark of each detection among those that are trusted, or -1."""
        rows = np.flatnonzero(self.trusted)
        if len(rows) == 0:
            return np.full(len(self.graph.detections.poles), -1, np.int64)
        found, _ = self.graph.term(self.landmarks.select(rows)).matches(pose_array(self.found.values))
        return np.where(found >= 0, rows[found], -1)

    def seek(self) -> None:
        """Leave out landmarks in conflict, and solve again from the bridges, until there are none."""
        for _ in range(self.settings.rounds):
            fresh = self._conflicts()
            if not fresh:
                return
            graph, poses = self.graph, pose_array(self.found.values)
            initial = poses.copy()
            for conflict in fresh:
                part = slice(conflict.first, conflict.last)
                over = bridge(
                    poses[conflict.first], poses[conflict.last], graph.motions[part], graph.covariances[part],
                    self.settings.held_covariance,
                )  # fmt: skip
                initial[conflict.first : conflict.last + 1] = over.poses
                self.trusted[conflict.landmarks] = False
            self.conflicts += fresh
            if not self.trusted.any():
                return
            self._solve(initial)

    def pardon(self) -> None:
        """Trust those again that fit now that others are left out, if that makes no conflict."""
        doubted = np.flatnonzero(~self.trusted)
        if len(doubted) == 0 or not self.trusted.any():
            return
        poses, detections = pose_array(self.found.values), self.graph.detections
        alone = self.landmarks.select(doubted)
        matches, _ = self.graph.term(alone).matches(poses)
        seen, in_view = visibility(poses, detections, matches, alone.poles.positions, self.reach)
        fits = doubted[(seen > 0) & (seen >= self.settings.pardoned * in_view)]
        if len(fits) == 0:
            return
        before = self.found, self.trusted.copy(), self.broken
        self.trusted[fits] = True
        self._solve(poses)
        if self._conflicts():
            self.found, self.trusted, self.broken = before

    def _solve(self, initial: Array) -> None:
        self.found = self.graph.solve(self.landmarks.select(self.trusted), initial, (2, 3))
        self.history += self.found.history

    def _conflicts(self) -> list[Conflict]:
        graph, mixture = self.graph, self.graph.mixture
        found, self.broken = find_conflicts(
            pose_array(self.found.values), graph.motions, graph.covariances, graph.detections, self.matches(),
            self.landmarks.poles.positions, float(np.hypot(mixture.sigma, mixture.landmark_sigma)), self.settings,
            graph.known,
        )  # fmt: skip
        return found
