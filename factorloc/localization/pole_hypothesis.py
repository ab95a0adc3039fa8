"""Pole hypothesis: one way a drive may have gone so far, and what it costs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from factorloc.factors.prior import PosePrior
from factorloc.geometry import se2, wrap
from factorloc.localization.calibration_belief import CalibrationBelief
from factorloc.localization.initialization import NormalStart
from factorloc.localization.pole_window import WindowEstimate

__all__ = ["PoleHypothesis", "propagated", "select_hypotheses"]

Array = npt.NDArray[np.float64]

_SLACK = 1e-6
_SAME = (0.3, 0.02)  # m and rad; nearer to a cheaper one, a hypothesis tells nothing of its own


@dataclass(frozen=True, eq=False)
class PoleHypothesis:
    """A drive of N poses, known as far as it was tracked.

    Parameters
    ----------
    poses : ndarray, shape (N, 3)
        ``T_map_body``.
    covariances : ndarray, shape (N, 3, 3)
        Each as its latest window left it.
    matched : ndarray of bool, shape (N,)
        Whether a landmark holds the pose.
    scan_costs, motion_costs : ndarray, shapes (N,), (N - 1,)
        Of detections and odometry, each as its latest window left it.
    start_cost : float
        Of the first pose.
    calibration : CalibrationBelief
        Of odometry.
    begin : int
        First pose that the next window solves again.
    tracked : int
        Poses tracked.
    """

    poses: Array
    covariances: Array
    matched: npt.NDArray[np.bool_]
    scan_costs: Array
    motion_costs: Array
    start_cost: float
    calibration: CalibrationBelief
    begin: int = 0
    tracked: int = 0

    @classmethod
    def start(cls, count: int, calibration: CalibrationBelief) -> PoleHypothesis:
        """Nothing was tracked yet, of a drive of so many poses."""
        return cls(
            np.zeros((count, 3)), np.zeros((count, 3, 3)), np.zeros(count, np.bool_), np.zeros(count),
            np.zeros(max(count - 1, 0)), 0.0, calibration,
        )  # fmt: skip

    @property
    def cost(self) -> float:
        """Of all that was tracked."""
        return self.start_cost + float(self.scan_costs.sum() + self.motion_costs.sum())

    def ahead(self, motion: Array, of_motion: Array) -> NormalStart:
        """Belief of the next pose: the last one, and a motion (3,) with its covariance (3, 3)."""
        pose, covariance = self.poses[self.tracked - 1], self.covariances[self.tracked - 1]
        return NormalStart(PosePrior(se2.compose(pose, motion), propagated(covariance, motion, of_motion)))

    def extended(
        self, found: WindowEstimate, prior: PosePrior, last: int, next_begin: int, share: float
    ) -> PoleHypothesis:
        """Take over what a window found of the poses from ``begin`` to ``last``.

        Parameters
        ----------
        found : WindowEstimate
            The window's.
        prior : PosePrior
            Of its first pose.
        last : int
            Pose behind its last one.
        next_begin : int
            First pose of the next window.
        share : float
            Of the window that is new.
        """
        here = slice(self.begin, last)
        poses, covariances, matched = self.poses.copy(), self.covariances.copy(), self.matched.copy()
        scan_costs, motion_costs = self.scan_costs.copy(), self.motion_costs.copy()
        poses[here], covariances[here], matched[here] = found.poses, found.covariances, found.matched
        scan_costs[here], motion_costs[self.begin : last - 1] = found.scan_costs, found.motion_costs
        start_cost = self.start_cost
        if self.begin == 0:
            off = se2.log(se2.between(prior.pose, found.poses[0]))
            start_cost = float(off @ prior.information @ off) / 2
        return replace(
            self, poses=poses, covariances=covariances, matched=matched, scan_costs=scan_costs,
            motion_costs=motion_costs, start_cost=start_cost,
            calibration=self.calibration.learned(found.step, found.learned, share), begin=next_begin, tracked=last,
        )  # fmt: skip


def propagated(covariance: Array, motion: Array, of_motion: Array) -> Array:
    """Covariance of a pose after a motion, each in the tangent space of its own body."""
    A = se2.adjoint(se2.inverse(motion))
    moved = A @ covariance @ A.T + of_motion
    return np.asarray((moved + moved.T) / 2 + _SLACK**2 * np.eye(3))


def select_hypotheses(all_of_them: list[PoleHypothesis], last: int, most: int, margin: float) -> list[PoleHypothesis]:
    """The likeliest, each elsewhere than all likelier ones: at most so many, none by a margin worse than the best.

    Parameters
    ----------
    all_of_them : list of PoleHypothesis
        At least one.
    last : int
        Pose at which they are compared.
    most : int
        So many.
    margin : float
        Of cost.
    """
    kept: list[PoleHypothesis] = []
    for one in sorted(all_of_them, key=lambda each: each.cost):
        if len(kept) == most or (kept and one.cost > kept[0].cost + margin):
            break
        apart = [one.poses[last] - other.poses[last] for other in kept]
        if all(np.hypot(d[0], d[1]) > _SAME[0] or abs(float(wrap(d[2]))) > _SAME[1] for d in apart):
            kept.append(one)
    return kept
