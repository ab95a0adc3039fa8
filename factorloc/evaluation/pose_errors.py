"""PoseErrors: how far poses are from their truth, in the body frame of the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.errors import EvaluationError
from factorloc.evaluation.statistics import ErrorStatistics
from factorloc.geometry import se2, se3

__all__ = ["PoseErrors"]

Array = npt.NDArray[np.float64]

_UNITS = {
    "translation": "m",
    "rotation": "rad",
    "longitudinal": "m",
    "lateral": "m",
    "vertical": "m",
    "heading": "rad",
}


@dataclass(frozen=True)
class PoseErrors:
    """One error pose ``T_truth_estimate`` a row; every metric is read from it.

    Parameters
    ----------
    stamps : ndarray, shape (N,)
        Times, s.
    T_truth_estimate : ndarray, shape (N, 3) or (N, 4, 4)
        Pose of the estimate in the body frame of the truth; the identity where there is no error.
    """

    stamps: Array
    T_truth_estimate: Array

    def __len__(self) -> int:
        return len(self.stamps)

    @property
    def dimension(self) -> int:
        """2 for planar poses, 3 for spatial ones."""
        return 2 if self.T_truth_estimate.ndim == 2 else 3

    @property
    def names(self) -> tuple[str, ...]:
        """Metrics that :meth:`statistics` knows; planar poses have no vertical error."""
        return tuple(name for name in _UNITS if name != "vertical" or self.dimension == 3)

    @property
    def offset(self) -> Array:
        """Position of the estimate in the body frame of the truth, m, shape (N, D)."""
        return self.T_truth_estimate[:, :2] if self.dimension == 2 else self.T_truth_estimate[:, :3, 3]

    @property
    def translation(self) -> Array:
        """Distance of the positions, m, shape (N,)."""
        return np.asarray(np.linalg.norm(self.offset, axis=1))

    @property
    def rotation(self) -> Array:
        """Angle of the rotation between the two, rad in [0, pi], shape (N,)."""
        if self.dimension == 2:
            return np.abs(self.T_truth_estimate[:, 2])
        return np.asarray(np.linalg.norm(se3.log(self.T_truth_estimate)[:, :3], axis=1))

    @property
    def longitudinal(self) -> Array:
        """How far the estimate is ahead of the truth, m, shape (N,)."""
        return self.offset[:, 0]

    @property
    def lateral(self) -> Array:
        """How far the estimate is to the left of the truth, m, shape (N,)."""
        return self.offset[:, 1]

    @property
    def vertical(self) -> Array:
        """How far the estimate is above the truth, m, shape (N,); zero in the plane."""
        return np.zeros(len(self)) if self.dimension == 2 else self.offset[:, 2]

    @property
    def heading(self) -> Array:
        """How far the estimate is turned to the left (yaw), rad in (-pi, pi], shape (N,)."""
        return self.T_truth_estimate[:, 2] if self.dimension == 2 else se3.to_se2(self.T_truth_estimate)[:, 2]

    @property
    def tangent(self) -> Array:
        """Errors in the tangent space of the estimated body: ``log(T_estimate_truth)``, shape (N, 3) or (N, 6).

        That is the space of :attr:`factorloc.trajectory.Trajectory.covariances`.
        """
        return -se2.log(self.T_truth_estimate) if self.dimension == 2 else -se3.log(self.T_truth_estimate)

    def statistics(self, name: str) -> ErrorStatistics:
        """Summarize the *magnitudes* of one metric.

        Parameters
        ----------
        name : str
            One of :attr:`names`. The bias of a signed one is the mean of its array.

        Raises
        ------
        EvaluationError
            If there is no such metric.
        """
        if name not in self.names:
            raise EvaluationError(f"metric: no '{name}' of {self.dimension}-D poses; known: {', '.join(self.names)}")
        return ErrorStatistics.of(np.abs(getattr(self, name)), _UNITS[name], name)
