"""Priors: what is known of a pose before any scan."""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np
import numpy.typing as npt

from factorloc.errors import GeometryError
from factorloc.geometry import se2

__all__ = ["PosePrior"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class PosePrior:
    """Gaussian belief of one planar pose.

    Parameters
    ----------
    pose : ndarray, shape (3,)
        Mean ``T_map_body``.
    covariance : ndarray, shape (3, 3)
        In the tangent space of the body.

    Raises
    ------
    GeometryError
        If the pose is not one finite planar pose, or the covariance not symmetric positive definite.
    """

    pose: Array
    covariance: Array

    def __post_init__(self) -> None:
        pose = se2.as_poses(self.pose, "prior pose")
        if pose.shape != (3,):
            raise GeometryError(f"prior pose: shape {pose.shape}; expected a single [x, y, theta]")
        object.__setattr__(self, "pose", pose)
        covariance = np.asarray(self.covariance, np.float64)
        if covariance.shape != (3, 3) or not np.isfinite(covariance).all() or not np.allclose(covariance, covariance.T):
            raise GeometryError(f"prior covariance: shape {covariance.shape}; expected a finite symmetric 3 x 3 matrix")
        if np.linalg.eigvalsh(covariance).min() <= 0:
            raise GeometryError("prior covariance: not positive definite; give every direction some variance")
        object.__setattr__(self, "covariance", covariance)

    @classmethod
    def from_sigmas(cls, pose: npt.ArrayLike, position: float, heading: float) -> PosePrior:
        """Make a prior of equal standard deviations of position along both axes (m) and of heading (rad)."""
        return cls(np.asarray(pose, np.float64), np.diag([position**2, position**2, heading**2]))

    @property
    def information(self) -> Array:
        """Inverse covariance, shape (3, 3)."""
        return np.asarray(np.linalg.inv(self.covariance))

    def factor(self, key: int) -> gtsam.PriorFactorPose2:
        """Make the native gtsam factor of this prior."""
        noise = gtsam.noiseModel.Gaussian.Covariance(self.covariance)
        return gtsam.PriorFactorPose2(key, gtsam.Pose2(*self.pose), noise)
