"""SimulatedDrive: what a vehicle records on a route, and where it truly was."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from factorloc.errors import SimulationError
from factorloc.scan import Scan
from factorloc.simulation.gnss import Gnss, GnssFixes
from factorloc.simulation.lidar import Lidar, PlanarLidar
from factorloc.simulation.lidar_models import hdl_32e
from factorloc.simulation.mesh_world import MeshWorld
from factorloc.simulation.odometry import OdometryNoise
from factorloc.simulation.route import Route
from factorloc.simulation.spatial_lidar import SpatialLidar
from factorloc.simulation.spatial_odometry import SpatialOdometryNoise
from factorloc.simulation.spatial_route import SpatialRoute
from factorloc.simulation.streams import stream
from factorloc.simulation.sweeps import Sweeps
from factorloc.simulation.world import World
from factorloc.trajectory import Trajectory

__all__ = ["SimulatedDrive", "simulate_drive"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class SimulatedDrive:
    """Measurements of a drive and their exact truth.

    Parameters
    ----------
    scans : sequence of Scan
        One a pose, N in all: a tuple, or :class:`~factorloc.simulation.sweeps.Sweeps` that are cast when asked for.
    odometry : ndarray, shape (N - 1, 3) or (N - 1, 4, 4)
        Measured motions between successive scans, in the body frame at the first: ``[dx, dy, dtheta]`` in the plane, m
        and rad; homogeneous matrices in space.
    truth : Trajectory
        True poses ``T_world_body`` at the stamps of the scans.
    name : str
        What it is called.
    odometry_covariances : ndarray, shape (N - 1, 6, 6), optional
        In space: covariance of each motion in the tangent space of the body after it.
    gnss : GnssFixes, optional
        Satellite positions, if there was a receiver.
    """

    scans: Sequence[Scan]
    odometry: Array
    truth: Trajectory
    name: str = "simulation"
    odometry_covariances: Array | None = None
    gnss: GnssFixes | None = None

    def __len__(self) -> int:
        return len(self.scans)

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return self.truth.dimension

    @property
    def stamps(self) -> Array:
        """Times of the scans, s, shape (N,)."""
        return self.truth.stamps


def simulate_drive(
    world: World,
    route: Route | SpatialRoute,
    lidar: Lidar | None = None,
    odometry_noise: OdometryNoise | SpatialOdometryNoise | None = None,
    *,
    seed: int,
    period: float = 0.5,
    name: str = "simulation",
    gnss: Gnss | None = None,
    keep_scans: bool = True,
    on_scan: Callable[[int, Scan], None] | None = None,
) -> SimulatedDrive:
    """Drive a route through a world.

    Parameters
    ----------
    world : World
        The surroundings; a :class:`~factorloc.simulation.mesh_world.MeshWorld` to drive in space.
    route : Route or SpatialRoute
        Where to drive; in space, a planar route is laid onto the ground.
    lidar : Lidar, optional
        The sensor; in the plane, a :class:`PlanarLidar` with its defaults if not given; in space, an HDL-32E. A
        spatial lidar turns while the vehicle moves.
    odometry_noise : OdometryNoise or SpatialOdometryNoise, optional
        The wheels; with the default noise if not given. In space, planar noise is that of the wheels alone.
    seed : int
        The same seed gives the same drive. All sensors draw from streams of their own: to change one of them leaves
        the noise of the others as it is.
    period : float
        Time between two scans, s.
    name : str
        What to call the drive.
    gnss : Gnss, optional
        A satellite receiver, in space; none by default.
    keep_scans : bool
        Hold all scans in memory. Otherwise, in space, each is cast when it is asked for (see
        :class:`~factorloc.simulation.sweeps.Sweeps`), to be exported one by one. Planar scans are always held.
    on_scan : callable, optional
        Called with the number of each scan and the scan, in order, as soon as it is cast.

    Returns
    -------
    SimulatedDrive
        Scans, odometry and truth.

    Raises
    ------
    SimulationError
        If the body touches something on its way or has no ground under it, or world, route, lidar and noise differ in
        dimension.
    """
    if isinstance(world, MeshWorld):
        drive = _drive_in_space(world, route, lidar, odometry_noise, gnss, seed, period, name)
    else:
        drive = _drive_in_plane(world, route, lidar, odometry_noise, gnss, seed, period, name)
    if on_scan is None and not keep_scans:
        return drive
    kept = []
    for k, scan in enumerate(drive.scans):
        if on_scan is not None:
            on_scan(k, scan)
        if keep_scans:
            kept.append(scan)
    return replace(drive, scans=tuple(kept)) if keep_scans else drive


def _drive_in_plane(
    world: World,
    route: Route | SpatialRoute,
    lidar: Lidar | None,
    noise: OdometryNoise | SpatialOdometryNoise | None,
    gnss: Gnss | None,
    seed: int,
    period: float,
    name: str,
) -> SimulatedDrive:
    if isinstance(route, SpatialRoute) or isinstance(noise, SpatialOdometryNoise) or gnss is not None:
        raise SimulationError("world: is no mesh world; spatial routes, spatial odometry noise and gnss need one")
    route.check(world)
    truth = route.sample(period)
    lidar_rng, wheel_rng = np.random.default_rng(seed).spawn(2)
    scans = (lidar or PlanarLidar()).cast_many(world, truth.poses, lidar_rng, truth.stamps)
    odometry = (noise or OdometryNoise()).sample(truth.poses, wheel_rng)
    return SimulatedDrive(tuple(scans), odometry, truth, name)


def _drive_in_space(
    world: MeshWorld,
    route: Route | SpatialRoute,
    lidar: Lidar | None,
    noise: OdometryNoise | SpatialOdometryNoise | None,
    gnss: Gnss | None,
    seed: int,
    period: float,
    name: str,
) -> SimulatedDrive:
    lidar = hdl_32e() if lidar is None else lidar
    if not isinstance(lidar, SpatialLidar):
        raise SimulationError(f"lidar: has {lidar.dimension} dimensions; a mesh world needs a SpatialLidar")
    if not isinstance(noise, SpatialOdometryNoise):
        noise = SpatialOdometryNoise() if noise is None else SpatialOdometryNoise(wheels=noise)
    path = route if isinstance(route, SpatialRoute) else SpatialRoute(route)
    path.check(world)
    stamps = path.route.sample(period).stamps
    half_turn = lidar.rotation_period / 2
    motion = path.motion(world, -half_turn, stamps[-1] + half_turn)
    truth = motion.at(stamps)
    odometry, covariances = noise.sample(truth.poses, stream(seed, "odometry"))
    return SimulatedDrive(
        Sweeps(world, lidar, motion, stamps, np.arange(len(stamps)), seed),
        odometry,
        truth,
        name,
        covariances,
        None if gnss is None else gnss.sample(world, motion, stream(seed, "gnss"), start=0.0),
    )
