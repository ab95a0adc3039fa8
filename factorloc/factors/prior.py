"""Priors: what is known of a pose before any scan."""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np
import numpy.typing as npt

from factorloc.errors import GeometryError
from factorloc.factors.native import prior_factor
from factorloc.geometry import group_of, position_heading

__all__ = ["PosePrior"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class PosePrior:
    """Gaussian belief of one pose, in the plane or in space.

    Parameters
    ----------
    pose : ndarray, shape (3,) or (4, 4)
        Mean ``T_map_body``.
    covariance : ndarray, shape (3, 3) or (6, 6)
        In the tangent space of the body.

    Raises
    ------
    GeometryError
        If the pose is not one finite pose, or the covariance not symmetric positive definite.
    """

    pose: Array
    covariance: Array

    def __post_init__(self) -> None:
        dimension = 3 if np.shape(self.pose) == (4, 4) else 2
        pose = group_of(dimension).as_poses(self.pose, "prior pose")
        if pose.shape not in ((3,), (4, 4)):
            raise GeometryError(f"prior pose: shape {pose.shape}; expected a single [x, y, theta] or 4 x 4 matrix")
        object.__setattr__(self, "pose", pose)
        covariance = np.asarray(self.covariance, np.float64)
        n = 3 if dimension == 2 else 6
        if covariance.shape != (n, n) or not np.isfinite(covariance).all() or not np.allclose(covariance, covariance.T):
            raise GeometryError(
                f"prior covariance: shape {covariance.shape}; expected a finite symmetric {n} x {n} matrix"
            )
        if np.linalg.eigvalsh(covariance).min() <= 0:
            raise GeometryError("prior covariance: not positive definite; give every direction some variance")
        object.__setattr__(self, "covariance", covariance)

    @classmethod
    def from_sigmas(cls, pose: npt.ArrayLike, position: float, heading: float) -> PosePrior:
        """Make a prior of equal standard deviations of position along all axes (m) and of all rotations (rad)."""
        mean = np.asarray(pose, np.float64)
        return cls(mean, np.diag(position_heading(2 if mean.ndim == 1 else 3, position, heading) ** 2))

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return 2 if self.pose.ndim == 1 else 3

    @property
    def position(self) -> Array:
        """Mean position, m, shape (D,)."""
        return self.pose[:2] if self.dimension == 2 else self.pose[:3, 3]

    @property
    def information(self) -> Array:
        """Inverse covariance."""
        return np.asarray(np.linalg.inv(self.covariance))

    def factor(self, key: int) -> gtsam.NonlinearFactor:
        """Make the native gtsam factor of this prior."""
        return prior_factor(key, self.pose, gtsam.noiseModel.Gaussian.Covariance(self.covariance))
