"""Calibration belief: what is known, while driving, of the errors that odometry has all along."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.geometry import se2
from factorloc.localization.odometry_calibration import OdometryCalibration

__all__ = ["CalibrationBelief", "calibration_jacobians"]

Array = npt.NDArray[np.float64]

_FLOOR = np.array([0.005, 1e-4])
"""What one stretch says of scale (m/m) and drift (rad/m) is never surer than this: its landmarks may be the wrong ones,
or moved, all together."""


@dataclass(frozen=True, eq=False)
class CalibrationBelief:
    """Gaussian of scale and drift.

    Covariances of motions say what each of them is off by on its own. A tyre that lost pressure, or the offset of a
    gyro, is the same in all of them: after 100 m at two percent it is two metres, where errors that are independent
    would have averaged out.

    Parameters
    ----------
    mean : OdometryCalibration
        Likeliest.
    information : ndarray, shape (2, 2)
        Inverse covariance of scale (m/m) and drift (rad/m).
    """

    mean: OdometryCalibration
    information: Array

    @classmethod
    def from_sigmas(cls, scale: float, drift: float) -> CalibrationBelief:
        """Odometry is believed to be right but for these standard deviations, m/m and rad/m."""
        return cls(OdometryCalibration(), np.diag([scale**-2, drift**-2]))

    def shifted(self, step: Array) -> OdometryCalibration:
        """Calibration a step ``[scale, drift]`` beside the mean."""
        return OdometryCalibration(self.mean.scale + float(step[0]), self.mean.drift + float(step[1]))

    def learned(self, step: Array, information: Array, share: float) -> CalibrationBelief:
        """Belief after a stretch moved the estimate by a step, and said so much of it.

        Parameters
        ----------
        step : ndarray, shape (2,)
            From the mean to the estimate of this belief and the stretch together.
        information : ndarray, shape (2, 2)
            Of the stretch alone.
        share : float
            Of it that is new: stretches overlap.
        """
        # In units of the floor, so that nothing depends on metres and radians.
        scaling = np.outer(_FLOOR, _FLOOR)
        stretch, before = information * scaling, self.information * scaling
        own = np.linalg.lstsq(stretch, (before + stretch) @ (step / _FLOOR), rcond=1e-9)[0]
        roots, axes = np.linalg.eigh((stretch + stretch.T) / 2)
        roots = np.maximum(roots, 0.0)
        new = share * (axes * (roots / (1 + roots))) @ axes.T
        total = before + new
        return CalibrationBelief(self.shifted(_FLOOR * np.linalg.solve(total, new @ own)), total / scaling)


def calibration_jacobians(motions: npt.ArrayLike) -> Array:
    """Derivatives (N, 3, 2) of motions (N, 3), in the tangent space after each, by scale and drift."""
    of = np.asarray(motions, np.float64)
    out = np.zeros((len(of), 3, 2))
    out[:, :2, 0] = se2.rotate(-of[:, 2], of[:, :2])
    out[:, 2, 1] = np.hypot(of[:, 0], of[:, 1])
    return out
