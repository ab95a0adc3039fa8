"""Pole graph: odometry and the detections of a drive, to be solved with one set of landmarks after the other."""

from __future__ import annotations

from collections.abc import Sequence

import gtsam
import numpy as np
import numpy.typing as npt
from gtsam.symbol_shorthand import X

from factorloc.factors.native import pose_values
from factorloc.factors.odometry import OdometryNoise, odometry_factors
from factorloc.factors.pole_detections import PoleDetections, PoleLandmarks, PoleMixture
from factorloc.factors.pole_term import PoleTerm
from factorloc.factors.prior import PosePrior
from factorloc.geometry import position_heading
from factorloc.localization.optimizer import Optimized, OptimizerSettings, ScanFactors, optimize

__all__ = ["UNKNOWN_MOTION", "PoleGraph", "loose_motion"]

Array = npt.NDArray[np.float64]

UNKNOWN_MOTION = (2.0, 0.3)
"""Standard deviations of a motion nobody measured, m and rad."""


def loose_motion(first: int, second: int, motion: Array) -> gtsam.NonlinearFactor:
    """Tie two poses together whose motion nobody measured, so that neither floats."""
    loose = gtsam.noiseModel.Diagonal.Sigmas(position_heading(2, *UNKNOWN_MOTION))
    return gtsam.BetweenFactorPose2(first, second, gtsam.Pose2(*motion), loose)


class PoleGraph:
    """The graph of a drive, for any landmarks.

    Parameters
    ----------
    detections : PoleDetections
        Of N local maps.
    motions, covariances : ndarray, shapes (N - 1, 3), (N - 1, 3, 3)
        Odometry.
    known : ndarray of bool, shape (N - 1,)
        Which motions were measured.
    noise : OdometryNoise
        Its loss.
    mixture, information
        As :class:`~factorloc.factors.pole_term.PoleTerm`.
    optimizer : OptimizerSettings
        Steps and tolerances.
    prior : PosePrior
        Of the first pose.
    """

    def __init__(
        self, detections: PoleDetections, motions: Array, covariances: Array, known: npt.NDArray[np.bool_],
        noise: OdometryNoise,
        mixture: PoleMixture,
        information: float,
        optimizer: OptimizerSettings,
        prior: PosePrior,
    ) -> None:  # fmt: skip
        self.detections, self.mixture, self.information = detections, mixture, information
        self.optimizer, self.prior = optimizer, prior
        self.motions, self.covariances, self.known = motions, covariances, known
        self.keys = [X(k) for k in range(len(detections))]
        self.factors = list(odometry_factors(self.keys, motions, noise, known, covariances))
        for k in np.flatnonzero(~known).tolist():
            self.factors.append(loose_motion(self.keys[k], self.keys[k + 1], motions[k]))

    def term(self, landmarks: PoleLandmarks) -> PoleTerm:
        """Scan term of all detections."""
        return PoleTerm(self.detections, landmarks, self.mixture, self.information)

    def solve(self, landmarks: PoleLandmarks, initial: Array, levels: Sequence[int]) -> Optimized:
        """Solve it from poses (N, 3), through levels of the map."""
        graph = gtsam.NonlinearFactorGraph()
        graph.push_back(self.prior.factor(self.keys[0]))
        for factor in self.factors:
            graph.push_back(factor)
        scans = ScanFactors(self.term(landmarks), self.keys)
        values = pose_values(self.keys, initial)
        return optimize(graph, values, scans, levels=levels, settings=self.optimizer)

    def odometry_costs(self, found: Optimized) -> Array:
        """Cost of each motion."""
        return np.array([factor.error(found.values) for factor in self.factors])
