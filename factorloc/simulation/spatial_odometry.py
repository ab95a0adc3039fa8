"""SpatialOdometryNoise: wheels and an inclinometer, driven through space."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from factorloc.errors import SimulationError
from factorloc.geometry import se2, se3
from factorloc.simulation.odometry import OdometryNoise

__all__ = ["SpatialOdometryNoise"]

Array = npt.NDArray[np.float64]

_LEAST_DEVIATION = 1e-6  # m and rad: a covariance stays invertible where nothing moves


@dataclass(frozen=True)
class SpatialOdometryNoise:
    """Noise of measured motions in space: wheels in the plane of the body, and a walk in height, roll and pitch.

    Parameters
    ----------
    wheels : OdometryNoise
        Turns and lines in the body's plane; by default 1 % of the line, 0.1 degrees a metre.
    height_walk : float
        Standard deviation of the height after one metre, growing with the root of the line, m.
    tilt_walk : float
        The same of roll and of pitch, rad.

    Raises
    ------
    SimulationError
        If a setting is negative or not finite.
    """

    wheels: OdometryNoise = field(default_factory=lambda: OdometryNoise(0.02**2, 0.002**2, 0.01**2, 0.01**2))
    height_walk: float = 0.005
    tilt_walk: float = 0.0005

    def __post_init__(self) -> None:
        for name in ("height_walk", "tilt_walk"):
            if not 0 <= getattr(self, name) < np.inf:
                raise SimulationError(f"odometry noise {name}: {getattr(self, name)}; must be finite and not negative")

    @classmethod
    def none(cls) -> SpatialOdometryNoise:
        """Return the noise of perfect odometry."""
        return cls(OdometryNoise.none(), 0.0, 0.0)

    def sample(self, poses: npt.ArrayLike, rng: np.random.Generator) -> tuple[Array, Array]:
        """Measure the motions between successive true poses.

        Parameters
        ----------
        poses : array_like, shape (N, 4, 4)
            True poses ``T_world_body``, in order.
        rng : numpy.random.Generator
            Source of the noise.

        Returns
        -------
        motions : ndarray, shape (N - 1, 4, 4)
            Measured ``T_body[k]_body[k + 1]``.
        covariances : ndarray, shape (N - 1, 6, 6)
            Of each motion, to first order, in the tangent space ``[rotation, translation]`` of the body after it;
            deviations are at least 1e-6 m and rad.

        Raises
        ------
        GeometryError
            If a pose is no rigid motion.
        """
        truth = se3.as_poses(poses)
        motion = se3.between(truth[:-1], truth[1:])
        planar = se3.to_se2(motion)
        tilt = se3.between(se3.from_se2(planar), motion)  # what the plane does not hold: climbing, roll and pitch
        (first, line, second), deviations = self.wheels.decompose(planar)
        draws = rng.standard_normal((6, len(motion)))
        turn1, way, turn2 = np.stack([first, line, second]) + deviations * draws[:3]
        measured = se3.from_se2(np.stack([way * np.cos(turn1), way * np.sin(turn1), turn1 + turn2], -1))
        walk = np.zeros((len(motion), 6))
        walk[:, :2] = (self.tilt_walk * np.sqrt(line) * draws[3:5]).T
        walk[:, 5] = self.height_walk * np.sqrt(line) * draws[5]
        return measured @ tilt @ se3.exp(walk), self._covariances(planar, tilt, second, deviations)

    def _covariances(self, planar: Array, tilt: Array, second: Array, deviations: Array) -> Array:
        n = len(planar)
        jacobian = np.zeros((n, 6, 3))  # of the planar motion by first turn, line and second turn
        jacobian[:, 2, 0] = jacobian[:, 2, 2] = 1
        # A first turn swings the end of the line around its start.
        jacobian[:, 3:5, 0] = se2.rotate(-planar[:, 2], np.stack([-planar[:, 1], planar[:, 0]], -1))
        jacobian[:, 3:5, 1] = np.stack([np.cos(second), -np.sin(second)], -1)
        jacobian = se3.adjoint(se3.inverse(tilt)) @ jacobian
        spread = jacobian * deviations.T[:, None, :]
        covariances = spread @ np.swapaxes(spread, -1, -2)
        line = np.hypot(planar[:, 0], planar[:, 1])[:, None]
        walk = np.array([self.tilt_walk, self.tilt_walk, 0, 0, 0, self.height_walk]) ** 2
        rows = np.arange(6)
        covariances[:, rows, rows] += line * walk + _LEAST_DEVIATION**2
        return np.asarray(covariances)
