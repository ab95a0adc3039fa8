"""Sessions of a simulated town over many months: one drive each, a scan a metre, kept on disk once they are cast."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc.config import Block
from factorloc.geometry import se3
from factorloc.scan import RayStatus, Scan
from factorloc.simulation import OdometryNoise, Session, Sessions, SessionSettings, Town, TownSettings, cached
from factorloc.simulation.spatial_lidar import SpatialLidar
from factorloc.simulation.spatial_odometry import SpatialOdometryNoise
from factorloc.simulation.spatial_route import SpatialRoute
from factorloc.simulation.streams import stream

__all__ = ["LongtermLidar", "LongtermOdometry", "LongtermWorld", "Recording", "record"]

Array = npt.NDArray[np.float64]

_UNIT = 1e-3  # m of range in the cache
_BATCH = 50  # scans that are cast at a time


class LongtermLidar(Block):
    """The lidar, which stands still for each scan.

    Parameters
    ----------
    beams, columns : int
        Rays of a scan.
    lowest, highest : float
        Elevations, deg.
    range_limits : (float, float)
        m, at most 65 m.
    range_sigma : float
        Noise of ranges, m.
    spacing : float
        Way between two scans, m.
    """

    beams: int = Field(gt=0)
    lowest: float = Field(gt=-90)
    highest: float = Field(lt=90)
    columns: int = Field(gt=0)
    range_limits: tuple[float, float]
    range_sigma: float = Field(ge=0)
    spacing: float = Field(gt=0)

    @property
    def sensor(self) -> SpatialLidar:
        """The sensor."""
        elevations = np.radians(np.linspace(self.highest, self.lowest, self.beams))
        return SpatialLidar(
            tuple(elevations.tolist()),
            columns=self.columns,
            range_limits=self.range_limits,
            range_sigma=self.range_sigma,
        )


class LongtermOdometry(Block):
    """Noise of the odometry: of each motion as the simulator has it, and a scale that is wrong all session long.

    Parameters
    ----------
    scale : float
        Standard deviation of the scale between sessions, m/m.
    alpha1, alpha2, alpha3, alpha4 : float
        Variances of :class:`factorloc.simulation.OdometryNoise`.
    height_walk, tilt_walk : float
        Of :class:`factorloc.simulation.SpatialOdometryNoise`.
    """

    scale: float = Field(ge=0)
    alpha1: float = Field(ge=0)
    alpha2: float = Field(ge=0)
    alpha3: float = Field(ge=0)
    alpha4: float = Field(ge=0)
    height_walk: float = Field(ge=0)
    tilt_walk: float = Field(ge=0)

    @property
    def noise(self) -> SpatialOdometryNoise:
        """Noise of each motion."""
        wheels = OdometryNoise(self.alpha1, self.alpha2, self.alpha3, self.alpha4)
        return SpatialOdometryNoise(wheels, self.height_walk, self.tilt_walk)


class LongtermWorld(Block):
    """What sessions follow from.

    Parameters
    ----------
    seed : int
        Of the town, and of all noise.
    sessions : int
        How many.
    town : TownSettings
    changes : SessionSettings
        What changes between sessions.
    lidar : LongtermLidar
    odometry : LongtermOdometry
    """

    seed: int = Field(ge=0)
    sessions: int = Field(gt=1)
    town: TownSettings
    changes: SessionSettings
    lidar: LongtermLidar
    odometry: LongtermOdometry

    @property
    def all_sessions(self) -> Sessions:
        """The town through the months."""
        return Sessions(Town(self.town, self.seed), self.changes)


class _Key(Block):
    """Everything a recording follows from."""

    number: int
    world: LongtermWorld


@dataclass(frozen=True)
class Recording:
    """One session as it was recorded.

    Parameters
    ----------
    number : int
        Which session.
    lidar : LongtermLidar
    truth : ndarray, shape (N, 4, 4)
        True poses of the body at the scans.
    odometry : ndarray, shape (N - 1, 4, 4)
        Measured motions.
    covariances : ndarray, shape (N - 1, 6, 6)
        Of the motions, the scale included.
    ranges : ndarray of uint16, shape (N, rays)
        mm; 0 of a ray without return.
    """

    number: int
    lidar: LongtermLidar
    truth: Array
    odometry: Array
    covariances: Array
    ranges: npt.NDArray[np.uint16]

    def __len__(self) -> int:
        return len(self.truth)

    @cached_property
    def planar_truth(self) -> Array:
        """True poses seen from above, (N, 3)."""
        return se3.to_se2(self.truth)

    def scan(self, number: int) -> Scan:
        """One scan; its rays without return are kept, with the maximum range."""
        sensor, ranges = self.lidar.sensor, self.ranges[number].astype(np.float64) * _UNIT
        status = np.where(ranges > 0, RayStatus.RETURN, RayStatus.NO_RETURN).astype(np.uint8)
        return Scan(
            self.lidar.sensor.directions.reshape(-1, 3), ranges, status, self.lidar.range_limits, stamp=float(number),
            T_body_sensor=np.array(sensor.T_body_sensor), frame=sensor.frame,
        )  # fmt: skip


def record(
    world: LongtermWorld, number: int, cache: Path, session: Callable[[int], Session] | None = None
) -> Recording:
    """Drive a session, or read it from the cache.

    Parameters
    ----------
    world : LongtermWorld
        The town and its months.
    number : int
        Which session.
    cache : Path
        Folder of all recordings.
    session : callable, optional
        Builds a session by its number, if a town is there already.
    """
    arrays = cached(cache, _Key(number=number, world=world), lambda: _drive(world, number, session))
    return Recording(number, world.lidar, *(np.asarray(arrays[name]) for name in _ARRAYS))  # type: ignore[arg-type]


_ARRAYS = ("truth", "odometry", "covariances", "ranges")


def _drive(
    world: LongtermWorld, number: int, make: Callable[[int], Session] | None
) -> dict[str, npt.NDArray[np.generic]]:
    session = (make or world.all_sessions.session)(number)
    route = session.route
    path = SpatialRoute(route)
    path.check(session.world)
    sampled = route.sample(world.lidar.spacing / route.speed)
    truth = path.lift(session.world, sampled.poses)
    rng, sensor = stream(world.seed, "longterm lidar", number), world.lidar.sensor
    ranges = np.zeros((len(truth), world.lidar.beams * world.lidar.columns), np.uint16)
    for first in range(0, len(truth), _BATCH):
        part = slice(first, first + _BATCH)
        scans = sensor.cast_many(session.world, truth[part], rng, sampled.stamps[part])
        for k, scan in enumerate(scans):
            ranges[first + k] = np.where(scan.is_return, np.round(scan.ranges / _UNIT), 0)
    wheels = stream(world.seed, "longterm odometry", number)
    scale = 1.0 + world.odometry.scale * wheels.standard_normal()
    odometry, covariances = world.odometry.noise.sample(truth, wheels)
    odometry[:, :3, 3] *= scale
    # A vehicle knows that its scale is wrong by so much, not by what it is wrong.
    ahead = np.linalg.norm(odometry[:, :3, 3], axis=1)
    covariances[:, 3, 3] += (world.odometry.scale * ahead) ** 2
    return {"truth": truth, "odometry": odometry, "covariances": covariances, "ranges": ranges}
