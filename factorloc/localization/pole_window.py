"""Pole window: a stretch of a drive as a graph, with the errors that odometry has all along as further unknowns."""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np
import numpy.typing as npt
from gtsam.symbol_shorthand import X

from factorloc.factors.native import pose_array, pose_values
from factorloc.factors.odometry import OdometryNoise, odometry_factors
from factorloc.factors.pole_detections import PoleDetections, PoleLandmarks, PoleMixture
from factorloc.factors.pole_term import PoleTerm
from factorloc.factors.prior import PosePrior
from factorloc.geometry import se2
from factorloc.localization.calibration_belief import CalibrationBelief, calibration_jacobians
from factorloc.localization.optimizer import Optimized, OptimizerSettings, ScanFactors, optimize
from factorloc.localization.pole_graph import loose_motion

__all__ = ["PoleWindow", "WindowEstimate", "WindowModel"]

Array = npt.NDArray[np.float64]

_MOVED = 0.03  # m; a calibration that moves the far end by less needs no second solution
_ROUNDS = 3


@dataclass(frozen=True)
class WindowModel:
    """What all windows of a drive have in common.

    Parameters
    ----------
    landmarks : PoleLandmarks
    mixture : PoleMixture
    information : float
        As :class:`~factorloc.factors.pole_term.PoleTerm`.
    noise : OdometryNoise
        Loss of odometry.
    optimizer : OptimizerSettings
    """

    landmarks: PoleLandmarks
    mixture: PoleMixture
    information: float
    noise: OdometryNoise
    optimizer: OptimizerSettings


@dataclass(frozen=True)
class WindowEstimate:
    """A stretch as its own detections have it.

    Parameters
    ----------
    poses : ndarray, shape (M, 3)
    covariances : ndarray, shape (M, 3, 3)
        Errors that odometry has all along included.
    step : ndarray, shape (2,)
        Scale and drift, from what was believed of them.
    learned : ndarray, shape (2, 2)
        Information on them in this stretch.
    scan_costs : ndarray, shape (M,)
        Of the detections.
    motion_costs : ndarray, shape (M - 1,)
        Of odometry.
    matched : ndarray of bool, shape (M,)
        Whether a landmark holds the pose.
    """

    poses: Array
    covariances: Array
    step: Array
    learned: Array
    scan_costs: Array
    motion_costs: Array
    matched: npt.NDArray[np.bool_]


class PoleWindow:
    """A stretch of M poses, to be solved from guesses.

    Parameters
    ----------
    model : WindowModel
        Map, detections' mixture, losses.
    detections : PoleDetections
        Of M local maps.
    motions, covariances, known
        Odometry between them, as it was measured.
    prior : PosePrior
        Of the first pose.
    calibration : CalibrationBelief
        Of odometry.
    """

    def __init__(
        self, model: WindowModel, detections: PoleDetections, motions: Array, covariances: Array,
        known: npt.NDArray[np.bool_], prior: PosePrior, calibration: CalibrationBelief,
    ) -> None:  # fmt: skip
        self.model, self.calibration, self.prior = model, calibration, prior
        self.motions, self.covariances, self.known = motions, covariances, known
        self.keys = [X(k) for k in range(len(detections))]
        self.term = PoleTerm(detections, model.landmarks, model.mixture, model.information)
        self.length = float(np.hypot(motions[:, 0], motions[:, 1]).sum())
        self.weights = np.linalg.inv(covariances) * known[:, None, None]

    def solve(self, initial: Array, coarsest: int) -> WindowEstimate:
        """Solve poses from a guess through the levels of the map, then poses and calibration together.

        The calibration enters a cost that is quadratic in it: the poses are eliminated from the system as it stands at
        their solution, and both take the step; the poses are solved again where it moves them.
        """
        step, levels = np.zeros(2), range(coarsest, len(self.term.blurs))
        motions = self.calibration.mean.applied(self.motions)
        for _ in range(_ROUNDS):
            graph = gtsam.NonlinearFactorGraph()
            graph.push_back(self.prior.factor(self.keys[0]))
            for factor in odometry_factors(self.keys, motions, self.model.noise, self.known, self.covariances):
                graph.push_back(factor)
            for k in np.flatnonzero(~self.known).tolist():
                graph.push_back(loose_motion(self.keys[k], self.keys[k + 1], motions[k]))
            found = optimize(
                graph, pose_values(self.keys, initial), ScanFactors(self.term, self.keys), levels=levels,
                settings=self.model.optimizer,
            )  # fmt: skip
            poses = pose_array(found.values)
            system = self._system(found, poses, motions, step)
            step = step + system.step
            motions = self.calibration.shifted(step).applied(self.motions)
            moved = abs(system.step[0]) * self.length + abs(system.step[1]) * self.length**2 / 2
            if moved < _MOVED:
                break
            initial = se2.compose(poses, se2.exp(system.of_poses))
            levels = range(len(self.term.blurs) - 1, len(self.term.blurs))
        assert found.scan_costs is not None  # every pose has a local map, if an empty one
        return WindowEstimate(
            poses, system.covariances, step, system.information, found.scan_costs.cost, system.motion_costs,
            found.scan_costs.hessian[:, 0, 0] > 0,
        )  # fmt: skip

    def _system(self, found: Optimized, poses: Array, motions: Array, step: Array) -> _System:
        n = len(poses)
        H, _ = found.linear.hessian()
        driven = se2.between(poses[:-1], poses[1:])
        left = se2.log(se2.between(motions, driven))
        squared = np.einsum("ni,nij,nj->n", left, self.weights, left)
        huber = self.model.noise.huber
        heavy = np.sqrt(squared) > huber
        costs = np.where(heavy, huber * np.sqrt(squared) - huber**2 / 2, squared / 2)
        W = self.weights * np.where(heavy, huber / np.sqrt(np.where(heavy, squared, 1.0)), 1.0)[:, None, None]
        J = calibration_jacobians(motions)
        WJ = W @ J
        cross = np.zeros((n, 3, 2))
        cross[1:] -= WJ
        cross[:-1] += np.swapaxes(se2.adjoint(se2.inverse(driven)), 1, 2) @ WJ
        columns = cross.reshape(3 * n, 2)
        of_itself = np.einsum("nji,njk->ik", J, WJ)
        gradient = -np.einsum("nji,nj->i", WJ, left)
        inverse = np.linalg.inv(H)
        eliminated = inverse @ columns
        information = of_itself - columns.T @ eliminated
        total = information + self.calibration.information
        change = -np.linalg.solve(total, gradient + self.calibration.information @ step)
        spread = inverse + eliminated @ np.linalg.solve(total, eliminated.T)
        blocks = spread.reshape(n, 3, n, 3)[np.arange(n), :, np.arange(n)]
        return _System(
            change, -(eliminated @ change).reshape(n, 3), information, (blocks + np.swapaxes(blocks, 1, 2)) / 2, costs
        )  # fmt: skip


@dataclass(frozen=True)
class _System:
    """The linear system at a solution, with the calibration: steps, information, covariances, costs of odometry."""

    step: Array
    of_poses: Array
    information: Array
    covariances: Array
    motion_costs: Array
