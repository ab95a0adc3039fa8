"""OdometryNoise: how wheels misjudge a motion, and how their increments add up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.errors import SimulationError
from factorloc.geometry import se2, wrap

__all__ = ["OdometryNoise", "integrate_odometry"]

Array = npt.NDArray[np.float64]

_STANDSTILL = 1e-6  # m; the direction of a shorter motion says nothing about how the wheels turned


@dataclass(frozen=True)
class OdometryNoise:
    """The rotation-translation-rotation model (Thrun, Burgard and Fox, Probabilistic Robotics, table 5.6).

    A motion is a turn towards its goal, a straight line, and a turn into the final heading. Each of the three is
    measured with independent Gaussian noise, of variance ``alpha1 * turn**2 + alpha2 * line**2`` for a turn and
    ``alpha3 * line**2 + alpha4 * (first turn**2 + second turn**2)`` for the line.

    Parameters
    ----------
    alpha1 : float
        Variance of a turn by turning, rad²/rad².
    alpha2 : float
        Variance of a turn by driving, rad²/m².
    alpha3 : float
        Variance of the line by driving, m²/m².
    alpha4 : float
        Variance of the line by turning, m²/rad².

    Raises
    ------
    SimulationError
        If one of them is negative or not finite.
    """

    alpha1: float = 0.03**2
    alpha2: float = 0.01**2
    alpha3: float = 0.03**2
    alpha4: float = 0.02**2

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0 <= value < np.inf:
                raise SimulationError(f"odometry noise {name}: {value}; must be finite and not negative")

    @classmethod
    def none(cls) -> OdometryNoise:
        """Return the noise of perfect wheels."""
        return cls(0.0, 0.0, 0.0, 0.0)

    def sample(self, poses: npt.ArrayLike, rng: np.random.Generator) -> Array:
        """Measure the motions between successive true poses.

        Parameters
        ----------
        poses : array_like, shape (N, 3)
            True poses ``T_world_body``, in order.
        rng : numpy.random.Generator
            Source of the noise.

        Returns
        -------
        ndarray, shape (N - 1, 3)
            Measured motions ``[dx, dy, dtheta]`` in the body frame at the start of each, m and rad.

        Raises
        ------
        GeometryError
            If the poses are not planar and finite.
        """
        truth = se2.as_poses(poses)
        turns_and_lines, deviations = self.decompose(se2.between(truth[:-1], truth[1:]))
        first, line, second = turns_and_lines + deviations * rng.standard_normal(deviations.shape)
        return np.stack([line * np.cos(first), line * np.sin(first), wrap(first + second)], -1)

    def decompose(self, motions: npt.ArrayLike) -> tuple[Array, Array]:
        """Split motions into turn, line and turn, with the deviation at which each is measured.

        Parameters
        ----------
        motions : array_like, shape (N, 3)
            ``[dx, dy, dtheta]`` in the body frame at the start, m and rad.

        Returns
        -------
        turns_and_lines, deviations : ndarray, shape (3, N)
            First turn (rad), line (m) and second turn (rad) of each motion, and their standard deviations.
        """
        motion = np.asarray(motions, np.float64)
        line = np.hypot(motion[:, 0], motion[:, 1])
        first = np.where(line < _STANDSTILL, 0.0, np.arctan2(motion[:, 1], motion[:, 0]))
        second = wrap(motion[:, 2] - first)
        # A vehicle that backs up does not turn around for it: what it turns is the angle to the nearer direction.
        turn1, turn2 = (np.minimum(np.abs(turn), np.pi - np.abs(turn)) for turn in (first, second))
        deviations = np.sqrt(
            [
                self.alpha1 * turn1**2 + self.alpha2 * line**2,
                self.alpha3 * line**2 + self.alpha4 * (turn1**2 + turn2**2),
                self.alpha1 * turn2**2 + self.alpha2 * line**2,
            ]
        )
        return np.stack([first, line, second]), deviations


def integrate_odometry(start: npt.ArrayLike, increments: npt.ArrayLike) -> Array:
    """Chain motions to poses: dead reckoning.

    Parameters
    ----------
    start : array_like, shape (3,)
        First pose ``T_world_body``.
    increments : array_like, shape (N - 1, 3)
        Motions ``[dx, dy, dtheta]``, each in the body frame at its start, m and rad.

    Returns
    -------
    ndarray, shape (N, 3)
        Poses, the first of which is the start.

    Raises
    ------
    GeometryError
        If the arguments are not planar and finite.
    """
    first, steps = se2.as_poses(start, "start"), se2.as_poses(increments, "increments")
    headings = first[2] + np.concatenate([[0.0], np.cumsum(steps[:, 2])])
    moves = se2.rotate(headings[:-1], steps[:, :2])
    positions = first[:2] + np.concatenate([np.zeros((1, 2)), np.cumsum(moves, axis=0)])
    return np.column_stack([positions, wrap(headings)])
