"""Odometry: relative motions with the rotation-translation-rotation noise model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import gtsam
import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc.config import Block
from factorloc.errors import GeometryError
from factorloc.factors.native import between_factor
from factorloc.geometry import group_of, se2, se3, wrap

__all__ = ["OdometryNoise", "known_motions", "motion_covariances", "odometry_factors"]

Array = npt.NDArray[np.float64]


class OdometryNoise(Block):
    """Noise of a planar motion that turns, drives and turns (Thrun, Burgard, Fox: Probabilistic Robotics, 5.4).

    A motion of length ``s`` with turns ``r_1`` and ``r_2`` has standard deviations ``a_1 |r| + a_2 s + b_r`` for each
    turn and ``a_3 s + a_4 (|r_1| + |r_2|) + b_s`` for the length.

    Parameters
    ----------
    turn_per_turn : float
        a_1, rad/rad.
    turn_per_metre : float
        a_2, rad/m.
    length_per_metre : float
        a_3, m/m.
    length_per_turn : float
        a_4, m/rad.
    least_turn : float
        b_r, rad: what even a motion of no length may turn.
    least_length : float
        b_s, m.
    huber : float
        Threshold of the Huber loss on the whitened motion; wheels slip.

    Raises
    ------
    ConfigError
        If a number is negative, or zero where it must not be.
    """

    turn_per_turn: float = Field(0.2, ge=0)
    turn_per_metre: float = Field(0.1, ge=0)
    length_per_metre: float = Field(0.1, ge=0)
    length_per_turn: float = Field(0.04, ge=0)
    least_turn: float = Field(0.02, gt=0)
    least_length: float = Field(0.04, gt=0)
    huber: float = Field(1.5, gt=0)

    def covariances(self, motions: npt.ArrayLike) -> Array:
        """Covariances of relative motions in the tangent space of the body *after* each motion.

        Parameters
        ----------
        motions : array_like, shape (N, 3) or (N, 4, 4)
            Motions ``T_before_after``.

        Returns
        -------
        ndarray, shape (N, 3, 3) or (N, 6, 6)
            Positive definite. A motion in space has the noise of its projection, and of what a vehicle on wheels hardly
            does (heave, roll, pitch) as much as the least turn and length, and a tenth of what its way adds to turns
            and length.
        """
        if np.ndim(motions) == 3:
            return self._spatial_covariances(se3.as_poses(motions, "motions"))
        motion = se2.as_poses(motions, "motions")
        length = np.hypot(motion[:, 0], motion[:, 1])
        # Shorter than its own uncertainty, a motion has no direction: all turning then counts as one turn.
        moving = length > self.least_length
        first = np.where(moving, np.arctan2(motion[:, 1], motion[:, 0]), 0.0)
        # Backwards is a turn of the wheels, not of the body.
        backwards = np.abs(first) > np.pi / 2
        first = np.where(backwards, wrap(first + np.pi), first)
        last = wrap(motion[:, 2] - first)
        turn = self.turn_per_metre * length + self.least_turn
        sigma_first = self.turn_per_turn * np.abs(first) + turn
        sigma_last = self.turn_per_turn * np.abs(last) + turn
        sigma_length = (
            self.length_per_metre * length + self.length_per_turn * (np.abs(first) + np.abs(last)) + self.least_length
        )
        # Displacement (dx, dy) = s (cos r_1, sin r_1): its derivatives by r_1 and s, turned into the frame after.
        by_first = np.stack([-motion[:, 1], motion[:, 0]], -1)
        by_length = np.stack([np.cos(first), np.sin(first)], -1)
        J = np.zeros((len(motion), 3, 3))
        J[:, :2, 0] = se2.rotate(-motion[:, 2], by_first)
        J[:, :2, 1] = se2.rotate(-motion[:, 2], by_length)
        J[:, 2, 0] = J[:, 2, 2] = 1
        sigmas = np.stack([sigma_first, sigma_length, sigma_last], -1)
        covariance = np.einsum("nij,nj,nkj->nik", J, sigmas**2, J)
        # A vehicle that hardly moves slides sideways as easily as ahead.
        covariance[:, :2, :2] += np.eye(2) * (0.5 * self.least_length) ** 2
        return np.asarray(covariance)

    def _spatial_covariances(self, motions: Array) -> Array:
        planar = self.covariances(se3.to_se2(motions))
        length = np.linalg.norm(motions[:, :3, 3], axis=-1)
        covariance = np.zeros((len(motions), 6, 6))
        rows = np.array([3, 4, 2])  # where x, y and heading stand in [rotation, translation]
        covariance[:, rows[:, None], rows] = planar
        covariance[:, 0, 0] = covariance[:, 1, 1] = (self.least_turn + 0.1 * self.turn_per_metre * length) ** 2
        covariance[:, 5, 5] = (self.least_length + 0.1 * self.length_per_metre * length) ** 2
        return covariance


def known_motions(known: npt.ArrayLike | None, count: int) -> npt.NDArray[np.bool_]:
    """Which of so many motions were measured, shape (count,); all if nothing is said.

    Raises
    ------
    GeometryError
        If there is not one flag a motion.
    """
    flags = np.ones(count, np.bool_) if known is None else np.asarray(known, np.bool_)
    if flags.shape != (count,):
        raise GeometryError(f"known: shape {flags.shape}; expected one flag for each of the {count} motions")
    return flags


def odometry_factors(
    keys: Sequence[int],
    motions: npt.ArrayLike,
    noise: OdometryNoise,
    known: npt.ArrayLike | None = None,
    covariances: npt.ArrayLike | None = None,
) -> Iterator[gtsam.NonlinearFactor]:
    """Robust native factors between consecutive poses.

    Parameters
    ----------
    keys : sequence of int, length N + 1
        Poses in order.
    motions : array_like, shape (N, 3) or (N, 4, 4)
        Motions ``T_k_k+1``.
    noise : OdometryNoise
        Its model.
    known : array_like of bool, shape (N,), optional
        Where a motion was measured at all; unmeasured ones make no factor.
    covariances : array_like, shape (N, 3, 3) or (N, 6, 6), optional
        What the source of the motions says of them, in the tangent space of the body after each; by default what the
        noise model says.

    Raises
    ------
    GeometryError
        If there is not one motion, one flag and one covariance between each pair of neighbours.
    """
    motion = group_of(3 if np.ndim(motions) == 3 else 2).as_poses(motions, "motions")
    if len(motion) != len(keys) - 1:
        raise GeometryError(f"motions: {len(motion)} between {len(keys)} poses; expected {len(keys) - 1}")
    use = known_motions(known, len(motion))
    loss = gtsam.noiseModel.mEstimator.Huber.Create(noise.huber)
    for k, covariance in enumerate(motion_covariances(motion, noise, covariances)):
        if use[k]:
            model = gtsam.noiseModel.Robust.Create(loss, gtsam.noiseModel.Gaussian.Covariance(covariance))
            yield between_factor(keys[k], keys[k + 1], motion[k], model)


def motion_covariances(motions: Array, noise: OdometryNoise, given: npt.ArrayLike | None = None) -> Array:
    """Covariances of motions: those given, or those of the noise model.

    Raises
    ------
    GeometryError
        If those given are not one finite matrix a motion.
    """
    if given is None:
        return noise.covariances(motions)
    covariances = np.asarray(given, np.float64)
    n = 3 if motions.ndim == 2 else 6
    if covariances.shape != (len(motions), n, n) or not np.isfinite(covariances).all():
        raise GeometryError(f"covariances: shape {covariances.shape}; expected a finite {n} x {n} matrix a motion")
    return covariances
