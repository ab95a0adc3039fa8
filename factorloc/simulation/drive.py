"""SimulatedDrive: what a vehicle records on a route, and where it truly was."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.scan import Scan
from factorloc.simulation.lidar import Lidar, PlanarLidar
from factorloc.simulation.odometry import OdometryNoise
from factorloc.simulation.route import Route
from factorloc.simulation.world import World
from factorloc.trajectory import Trajectory

__all__ = ["SimulatedDrive", "simulate_drive"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class SimulatedDrive:
    """Measurements of a drive and their exact truth.

    Parameters
    ----------
    scans : tuple of Scan
        One a pose, N in all.
    odometry : ndarray, shape (N - 1, 3)
        Measured motions ``[dx, dy, dtheta]`` between successive scans, in the body frame at the first, m and rad.
    truth : Trajectory
        True poses ``T_world_body`` at the stamps of the scans.
    name : str
        What it is called.
    """

    scans: tuple[Scan, ...]
    odometry: Array
    truth: Trajectory
    name: str = "simulation"

    def __len__(self) -> int:
        return len(self.scans)

    @property
    def stamps(self) -> Array:
        """Times of the scans, s, shape (N,)."""
        return self.truth.stamps


def simulate_drive(
    world: World,
    route: Route,
    lidar: Lidar | None = None,
    odometry_noise: OdometryNoise | None = None,
    *,
    seed: int,
    period: float = 0.5,
    name: str = "simulation",
) -> SimulatedDrive:
    """Drive a route through a world.

    Parameters
    ----------
    world : World
        The surroundings.
    route : Route
        Where to drive.
    lidar : Lidar, optional
        The sensor; a :class:`PlanarLidar` with its defaults if not given.
    odometry_noise : OdometryNoise, optional
        The wheels; with the default noise if not given.
    seed : int
        The same seed gives the same drive. Lidar and wheels draw from streams of their own: to change one of them
        leaves the other's noise as it is.
    period : float
        Time between two scans, s.
    name : str
        What to call the drive.

    Returns
    -------
    SimulatedDrive
        Scans, odometry and truth.

    Raises
    ------
    SimulationError
        If the body touches something on its way, or world and lidar differ in dimension.
    """
    route.check(world)
    truth = route.sample(period)
    lidar_rng, wheel_rng = np.random.default_rng(seed).spawn(2)
    scans = (lidar or PlanarLidar()).cast_many(world, truth.poses, lidar_rng, truth.stamps)
    odometry = (odometry_noise or OdometryNoise()).sample(truth.poses, wheel_rng)
    return SimulatedDrive(tuple(scans), odometry, truth, name)
