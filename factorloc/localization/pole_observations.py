"""Pole observations: what localization among poles is given of a drive, checked and complete."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from factorloc.errors import GeometryError
from factorloc.factors.odometry import OdometryNoise, known_motions, motion_covariances
from factorloc.factors.pole_detections import PoleDetections
from factorloc.geometry import position_heading, se2
from factorloc.localization.pole_graph import UNKNOWN_MOTION
from factorloc.mapping.poles import Poles

__all__ = ["PoleObservations"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class PoleObservations:
    """Detections from N poses, and the motions between them.

    Parameters
    ----------
    detections : PoleDetections
        Of N local maps.
    motions : ndarray, shape (N - 1, 3)
        Motions of the body, m and rad.
    measured : ndarray of bool, shape (N - 1,)
        Which of them were measured.
    covariances : ndarray, shape (N - 1, 3, 3)
        Of the motions; wide where none was measured.
    """

    detections: PoleDetections
    motions: Array
    measured: npt.NDArray[np.bool_]
    covariances: Array

    @classmethod
    def of(
        cls,
        local_maps: Sequence[Poles] | PoleDetections,
        odometry: npt.ArrayLike,
        known: npt.ArrayLike | None,
        covariances: npt.ArrayLike | None,
        noise: OdometryNoise,
        factor: float = 1.0,
    ) -> PoleObservations:
        """Complete what is given; arguments as :func:`~factorloc.localization.pole_smoother.smooth_poles`.

        Parameters
        ----------
        local_maps, odometry, known, covariances
            As there.
        noise : OdometryNoise
            Noise of motions that come without covariances.
        factor : float
            Of all covariances of motions that were measured.

        Raises
        ------
        GeometryError
            If numbers of local maps, motions and flags disagree.
        """
        detections = local_maps if isinstance(local_maps, PoleDetections) else PoleDetections.of(local_maps)
        motions = se2.as_poses(np.asarray(odometry, np.float64).reshape(-1, 3), "odometry")
        n = len(detections)
        if n == 0 or len(motions) != n - 1:
            raise GeometryError(
                f"odometry: {len(motions)} motions between {n} local maps; expected one between each two"
            )
        measured = known_motions(known, n - 1)
        of_motions = factor * motion_covariances(motions, noise, covariances)
        of_motions[~measured] = np.diag(position_heading(2, *UNKNOWN_MOTION) ** 2)
        return cls(detections, motions, measured, of_motions)

    def with_covariances(self, covariances: Array) -> PoleObservations:
        """Return the same, with other covariances (N - 1, 3, 3) of the motions that were measured."""
        return replace(self, covariances=np.where(self.measured[:, None, None], covariances, self.covariances))
