"""Particles: weighted poses that stand for a belief, their weights as logarithms throughout."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.errors import GeometryError
from factorloc.geometry import PoseGroup, group_of

__all__ = ["Particles", "log_sum_exp"]

Array = npt.NDArray[np.float64]


def log_sum_exp(values: npt.ArrayLike) -> float:
    """Logarithm of the sum of exponentials, without over- or underflow; -inf if every value is, or there is none."""
    array = np.asarray(values, np.float64)
    most = float(array.max(initial=-np.inf))
    return most if np.isinf(most) else most + float(np.log(np.exp(array - most).sum()))


@dataclass(frozen=True)
class Particles:
    """Poses with normalized weights.

    Parameters
    ----------
    poses : ndarray, shape (P, 3) or (P, 4, 4)
        Poses ``T_map_body``; at least one.
    log_weights : ndarray, shape (P,)
        Logarithms of weights, of any common scale; kept such that the weights add up to one.

    Raises
    ------
    GeometryError
        If there is no pose, a pose is not finite, shapes disagree, a weight is NaN or infinite, or all are zero.
    """

    poses: Array
    log_weights: Array

    def __post_init__(self) -> None:
        group = group_of(3 if np.ndim(self.poses) == 3 else 2)
        poses = group.as_poses(self.poses, "particles")
        weights = np.asarray(self.log_weights, np.float64)
        if poses.ndim not in (2, 3) or len(poses) == 0:
            raise GeometryError(f"particles: poses of shape {poses.shape}; expected at least one, (P, 3) or (P, 4, 4)")
        if weights.shape != (len(poses),):
            raise GeometryError(f"log_weights: shape {weights.shape}; expected one for each of the {len(poses)} poses")
        total = log_sum_exp(weights)
        if not np.isfinite(total):
            raise GeometryError("log_weights: NaN, infinite, or all weights zero; they say nothing of the poses")
        object.__setattr__(self, "poses", poses)
        object.__setattr__(self, "log_weights", weights - total)

    @classmethod
    def uniform(cls, poses: npt.ArrayLike) -> Particles:
        """Give all poses the same weight."""
        array = np.asarray(poses, np.float64)
        return cls(array, np.zeros(len(array)))

    def __len__(self) -> int:
        return len(self.log_weights)

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return 2 if self.poses.ndim == 2 else 3

    @property
    def group(self) -> PoseGroup:
        """SE(2) or SE(3)."""
        return group_of(self.dimension)

    @property
    def positions(self) -> Array:
        """Positions, m, shape (P, D)."""
        return self.poses[:, :2] if self.dimension == 2 else self.poses[:, :3, 3]

    @property
    def weights(self) -> Array:
        """Weights, which add up to one, shape (P,)."""
        return np.asarray(np.exp(self.log_weights))

    @property
    def effective_size(self) -> float:
        """How many particles of equal weight say as much: ``1 / sum(w^2)``, from 1 to P (Kong, Liu, Wong 1994)."""
        return float(np.exp(-log_sum_exp(2 * self.log_weights)))

    def moved(self, motions: npt.ArrayLike) -> Particles:
        """Return the particles after a motion each, in their body frames; shape as the poses."""
        return Particles(self.group.compose(self.poses, motions), self.log_weights)

    def log_mean(self, log_factors: npt.ArrayLike) -> float:
        """Logarithm of the weighted mean of factors given as logarithms; -inf if all are zero."""
        return log_sum_exp(self.log_weights + np.asarray(log_factors, np.float64))

    def reweighted(self, log_factors: npt.ArrayLike) -> Particles:
        """Return the particles with weights multiplied by factors, given as logarithms, shape (P,)."""
        return Particles(self.poses, self.log_weights + np.asarray(log_factors, np.float64))

    def select(self, indices: npt.ArrayLike) -> Particles:
        """Return particles of equal weight at the poses of some, with repetitions."""
        return Particles.uniform(self.poses[np.asarray(indices)])
