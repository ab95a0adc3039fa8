"""Motion models: what a measured motion says of where each particle goes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import numpy.typing as npt

from factorloc.errors import GeometryError
from factorloc.factors.odometry import OdometryNoise
from factorloc.geometry import group_of, position_heading, se2, wrap

__all__ = ["LostMotion", "MotionModel", "TangentMotion", "TurnDriveTurn"]

Array = npt.NDArray[np.float64]


class MotionModel(Protocol):
    """Draws motions that may lie behind a measured one."""

    def sample(
        self, motion: npt.ArrayLike, count: int, rng: np.random.Generator, covariance: npt.ArrayLike | None = None
    ) -> Array:
        """Draw motions.

        Parameters
        ----------
        motion : array_like, shape (3,) or (4, 4)
            Measured motion ``T_before_after`` of the body.
        count : int
            How many.
        rng : numpy.random.Generator
            Source of randomness.
        covariance : array_like, shape (3, 3) or (6, 6), optional
            What the source of the motion says of it, in the tangent space of the body after the motion.

        Returns
        -------
        ndarray, shape (count, 3) or (count, 4, 4)
            Motions to be applied in the body frame of each particle.

        Raises
        ------
        GeometryError
            If motion and covariance are not of one dimension, or not finite.
        """
        ...


@dataclass(frozen=True)
class TurnDriveTurn:
    """Planar odometry that turns, drives and turns, each with noise of its own (Probabilistic Robotics, table 5.6).

    With the standard deviations of :class:`~factorloc.factors.odometry.OdometryNoise` (which adds them up where the
    table adds variances, and never lets them vanish: particles that stand still would be copies of each other). To
    first order the motions have the covariance that the noise gives the smoother; beyond it, they bend.

    Parameters
    ----------
    noise : OdometryNoise
        alpha_1 to alpha_4, and what even a motion of no length may turn and drive. A covariance given with a motion
        is used instead, as by :class:`TangentMotion`.
    """

    noise: OdometryNoise = field(default_factory=OdometryNoise)

    def sample(
        self, motion: npt.ArrayLike, count: int, rng: np.random.Generator, covariance: npt.ArrayLike | None = None
    ) -> Array:
        """Draw motions; see :class:`MotionModel`."""
        if covariance is not None:
            return TangentMotion(self.noise).sample(motion, count, rng, covariance)
        mean = _as_motion(motion)
        if mean.ndim != 1:
            raise GeometryError("motion: turns and drives in the plane; use TangentMotion in space")
        first, sigmas = self._turn_and_sigmas(mean)
        turn, drive, last_turn = rng.standard_normal((3, count)) * sigmas[:, None]
        along = mean[:2] + drive[:, None] * [np.cos(first), np.sin(first)]
        heading = mean[2] + turn + last_turn
        slip = rng.standard_normal((count, 2)) * (0.5 * self.noise.least_length)
        return np.column_stack([se2.rotate(turn, along) + se2.rotate(heading, slip), wrap(heading)])

    def _turn_and_sigmas(self, motion: Array) -> tuple[float, Array]:
        """Direction of the drive, rad, and standard deviations of first turn, drive and last turn."""
        noise, length = self.noise, float(np.hypot(motion[0], motion[1]))
        # Shorter than its own uncertainty, a motion has no direction; backwards, the wheels turn and not the body.
        first = np.arctan2(motion[1], motion[0]) if length > noise.least_length else 0.0
        first = float(wrap(first + np.pi)) if abs(first) > np.pi / 2 else float(first)
        turns = np.abs([first, float(wrap(motion[2] - first))])
        of_turns = noise.turn_per_turn * turns + noise.turn_per_metre * length + noise.least_turn
        of_drive = noise.length_per_metre * length + noise.length_per_turn * turns.sum() + noise.least_length
        return first, np.array([of_turns[0], of_drive, of_turns[1]])


@dataclass(frozen=True)
class TangentMotion:
    """Gaussian noise in the tangent space of the body after the motion, ``T_before_after * exp(xi)``; plane or space.

    Parameters
    ----------
    noise : OdometryNoise
        Covariances, which grow with the motion, of motions that come without.
    """

    noise: OdometryNoise = field(default_factory=OdometryNoise)

    def sample(
        self, motion: npt.ArrayLike, count: int, rng: np.random.Generator, covariance: npt.ArrayLike | None = None
    ) -> Array:
        """Draw motions; see :class:`MotionModel`."""
        mean = _as_motion(motion)
        group = group_of(2 if mean.ndim == 1 else 3)
        chosen = self.noise.covariances(mean[None])[0] if covariance is None else np.asarray(covariance, np.float64)
        root = _square_root(chosen, 3 if mean.ndim == 1 else 6)
        return group.compose(mean, group.exp(rng.standard_normal((count, len(root))) @ root.T))


@dataclass(frozen=True)
class LostMotion:
    """A motion nobody measured: about what is given (most often none), as wide as told; covariances are not heeded.

    Parameters
    ----------
    position, heading : float
        Standard deviations, m and rad. In space height, roll and pitch have a tenth of them: a vehicle stands on its
        wheels wherever it went.
    """

    position: float = 1.0
    heading: float = 0.35

    def sample(
        self, motion: npt.ArrayLike, count: int, rng: np.random.Generator, covariance: npt.ArrayLike | None = None
    ) -> Array:
        """Draw motions; see :class:`MotionModel`."""
        mean = _as_motion(motion)
        dimension = 2 if mean.ndim == 1 else 3
        sigmas = position_heading(dimension, self.position, self.heading)
        if dimension == 3:
            sigmas[[0, 1, 5]] *= 0.1
        group = group_of(dimension)
        return group.compose(mean, group.exp(rng.standard_normal((count, len(sigmas))) * sigmas))


def _as_motion(motion: npt.ArrayLike) -> Array:
    array = group_of(3 if np.ndim(motion) == 2 else 2).as_poses(motion, "motion")
    if array.shape not in ((3,), (4, 4)):
        raise GeometryError(f"motion: shape {array.shape}; expected one, (3,) or (4, 4)")
    return array


def _square_root(covariance: Array, size: int) -> Array:
    """Symmetric square root of a covariance, which may be singular."""
    if covariance.shape != (size, size) or not np.isfinite(covariance).all():
        raise GeometryError(f"covariance: shape {covariance.shape}; expected a finite {size} x {size} matrix")
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    if values[0] < -1e-9 * max(values[-1], 0.0) or not np.allclose(covariance, covariance.T):
        raise GeometryError("covariance: not symmetric, or negative in some direction")
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)
