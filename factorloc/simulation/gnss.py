"""Gnss: satellite positions between buildings, with the slow errors of reflected signals and with outages."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.errors import SimulationError
from factorloc.geometry import se3
from factorloc.simulation.mesh_world import MeshWorld
from factorloc.trajectory import Trajectory

__all__ = ["Gnss", "GnssFixes"]

Array = npt.NDArray[np.float64]

_GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))


@dataclass(frozen=True)
class GnssFixes:
    """Positions of the antenna in the metric frame of the world.

    Parameters
    ----------
    stamps : ndarray, shape (M,)
        Times, s; increasing, with gaps where there was no fix.
    positions : ndarray, shape (M, 3)
        Measured positions of the antenna, m.
    covariances : ndarray, shape (M, 3, 3)
        Covariance of each, m²: white noise and the slow error. The errors of successive fixes are correlated.
    blocked : ndarray, shape (M,)
        Share of the sky that solids hide from the antenna.
    antenna : (float, float, float)
        Place of the antenna in the body frame, m.
    outages : int
        Epochs without a fix.
    """

    stamps: Array
    positions: Array
    covariances: Array
    blocked: Array
    antenna: tuple[float, float, float]
    outages: int

    def __len__(self) -> int:
        return len(self.stamps)


@dataclass(frozen=True)
class Gnss:
    """A receiver whose slow error, a Gauss-Markov process of first order, grows with the share of sky that is blocked.

    With share ``b``, the slow error has the deviation ``multipath_sigma * b`` along each horizontal axis and the white
    noise ``sigma``; heights are worse by ``vertical_factor``. There is no fix while more than ``outage_share`` of the
    sky is blocked, nor, by chance, at a fraction ``dropout`` of all epochs.

    Parameters
    ----------
    period : float
        Time between two fixes, s.
    sigma : float
        Deviation of the white noise, m.
    multipath_sigma : float
        Deviation of the slow error under a sky that is blocked all over, m.
    correlation_time : float
        Time in which the slow error forgets all but 1/e of itself, s.
    vertical_factor : float
        How much worse heights are than horizontal positions.
    outage_share : float
        Share of blocked sky above which there is no fix.
    dropout : float
        Probability of losing any other fix.
    sky_rays : int
        Directions in which the sky is probed.
    mask : float
        Elevation below which no satellite is used, rad.
    antenna : (float, float, float)
        Place of the antenna in the body frame, m.

    Raises
    ------
    SimulationError
        If a setting is out of its range.
    """

    period: float = 1.0
    sigma: float = 0.5
    multipath_sigma: float = 10.0
    correlation_time: float = 30.0
    vertical_factor: float = 2.0
    outage_share: float = 0.8
    dropout: float = 0.0
    sky_rays: int = 48
    mask: float = float(np.deg2rad(10))
    antenna: tuple[float, float, float] = (0.0, 0.0, 1.6)

    def __post_init__(self) -> None:
        for good, line in [
            (0 < self.period < np.inf, f"period: {self.period} s; positive"),
            (0 <= self.sigma < np.inf, f"sigma: {self.sigma} m; at least 0"),
            (0 <= self.multipath_sigma < np.inf, f"multipath_sigma: {self.multipath_sigma} m; at least 0"),
            (0 < self.correlation_time < np.inf, f"correlation_time: {self.correlation_time} s; positive"),
            (0 < self.vertical_factor < np.inf, f"vertical_factor: {self.vertical_factor}; positive"),
            (0 <= self.outage_share <= 1, f"outage_share: {self.outage_share}; in [0, 1]"),
            (0 <= self.dropout <= 1, f"dropout: {self.dropout}; a probability"),
            (self.sky_rays >= 1, f"sky_rays: {self.sky_rays}; at least 1"),
            (0 <= self.mask < np.pi / 2, f"mask: {self.mask} rad; in [0, pi/2)"),
            (np.shape(self.antenna) == (3,) and bool(np.isfinite(self.antenna).all()), "antenna: expected (x, y, z)"),
        ]:
            if not good:
                raise SimulationError(f"gnss {line}")

    def blocked_share(self, world: MeshWorld, points: npt.ArrayLike, times: npt.ArrayLike | None = None) -> Array:
        """Share of the sky above the mask that solids hide from points (..., 3), in steps of 1 / sky_rays.

        Canopies let signals pass. The rays are even over the solid angle, on a spiral.
        """
        steps = np.arange(self.sky_rays)
        z = 1 - (1 - np.sin(self.mask)) * (steps + 0.5) / self.sky_rays
        azimuth = _GOLDEN_ANGLE * steps
        flat = np.sqrt(1 - z**2)
        rays = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), z], -1)
        when = None if times is None else np.asarray(times, np.float64)[..., None]
        hits = world.cast(np.asarray(points, np.float64)[..., None, :], rays, None, when)
        return np.asarray(np.isfinite(hits.ranges).mean(-1))

    def sample(
        self, world: MeshWorld, trajectory: Trajectory, rng: np.random.Generator, start: float | None = None
    ) -> GnssFixes:
        """Measure along a trajectory, once a period.

        Parameters
        ----------
        world : MeshWorld
            What hides the sky.
        trajectory : Trajectory
            True poses ``T_world_body``.
        rng : numpy.random.Generator
            Source of all randomness. Each epoch takes the same numbers, whether it has a fix or not.
        start : float, optional
            Time of the first fix, s; the first stamp of the trajectory by default.

        Returns
        -------
        GnssFixes
            Without the epochs of outages.

        Raises
        ------
        GeometryError
            If the stamps of the trajectory do not increase, or it begins later.
        """
        first, end = float(trajectory.stamps[0] if start is None else start), float(trajectory.stamps[-1])
        stamps = first + self.period * np.arange(int((end - first) / self.period + 1e-9) + 1, dtype=np.float64)
        poses = trajectory.to_3d().at(np.minimum(stamps, end)).poses
        truth = se3.transform(poses, np.asarray(self.antenna))
        blocked = self.blocked_share(world, truth, stamps)
        axes = np.array([1.0, 1.0, self.vertical_factor])
        slow = _gauss_markov(rng.standard_normal((len(stamps), 3)), self.period / self.correlation_time)
        bias = self.multipath_sigma * blocked[:, None]
        positions = truth + axes * (bias * slow + self.sigma * rng.standard_normal((len(stamps), 3)))
        has_fix = (blocked <= self.outage_share) & (rng.random(len(stamps)) >= self.dropout)
        variances = axes**2 * (bias**2 + self.sigma**2)
        return GnssFixes(
            stamps[has_fix],
            positions[has_fix],
            (variances[:, :, None] * np.eye(3))[has_fix],
            blocked[has_fix],
            self.antenna,
            int((~has_fix).sum()),
        )


def _gauss_markov(draws: Array, step: float) -> Array:
    """Stationary process of unit variance from standard normal draws (M, 3), a given part of its memory apart."""
    kept = np.exp(-step)
    result = draws.copy()
    for k in range(1, len(draws)):
        result[k] = kept * result[k - 1] + np.sqrt(1 - kept**2) * draws[k]
    return result
