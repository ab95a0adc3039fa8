"""SpatialLidar: a spinning lidar of many beams, carried along while it turns."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from factorloc.errors import GeometryError, SimulationError
from factorloc.geometry import se3
from factorloc.scan import RayStatus, Scan
from factorloc.simulation.world import World
from factorloc.trajectory import Trajectory

__all__ = ["SpatialLidar"]

Array = npt.NDArray[np.float64]

_ON_THE_ROOF = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 1.73), (0.0, 0.0, 0.0, 1.0))


@dataclass(frozen=True)
class SpatialLidar:
    """A lidar that turns a fan of beams about its z axis, clockwise from above; one column at a time.

    A sweep begins and ends looking back and is stamped in its middle, when the fan looks ahead (along x). The scan is
    organized: its shape is (beams, columns), row by row; each ray has the stamp of its column.

    Parameters
    ----------
    elevations : tuple of float
        Angle of each beam above the sensor's xy plane, rad.
    columns : int
        Firings of the fan in one turn.
    rotation_period : float
        Time of one turn, s.
    range_limits : (float, float)
        Minimum and maximum range, m.
    range_sigma : float
        Standard deviation of the range noise, m.
    angle_sigma : float
        Standard deviation of the true beam about the reported one, along and across the elevation, drawn anew for each
        ray, rad.
    dropout : float
        Probability that a reflection is not noticed; such a ray is reported without return.
    T_body_sensor : array_like, shape (4, 4)
        Pose of the sensor on the body, by default 1.73 m above its origin; kept as nested tuples.
    motion_distortion : bool
        How a sweep from a moving body is reported. False: each ray with its true origin and direction in the sensor
        frame at the stamp of the scan, perfectly de-skewed. True: raw, as if the sensor had stood still.
    frame : str
        Name of the sensor frame.

    Raises
    ------
    SimulationError
        If a setting is out of its range.
    """

    dimension: ClassVar[int] = 3

    elevations: tuple[float, ...]
    columns: int = 1800
    rotation_period: float = 0.1
    range_limits: tuple[float, float] = (0.5, 100.0)
    range_sigma: float = 0.02
    angle_sigma: float = 0.0
    dropout: float = 0.0
    T_body_sensor: tuple[tuple[float, ...], ...] = _ON_THE_ROOF
    motion_distortion: bool = False
    frame: str = "lidar"

    def __post_init__(self) -> None:
        low, high = self.range_limits
        elevations = np.asarray(self.elevations, np.float64)
        for good, line in [
            (elevations.ndim == 1 and len(elevations) > 0, f"elevations: shape {elevations.shape}; one angle a beam"),
            (bool((np.abs(elevations) < np.pi / 2).all()), "elevations: rad, between -pi/2 and pi/2"),
            (self.columns >= 1, f"columns: {self.columns}; at least 1"),
            (0 < self.rotation_period < np.inf, f"rotation_period: {self.rotation_period} s; positive"),
            (0 <= low < high < np.inf, f"range_limits: ({low}, {high}) m; 0 <= minimum < maximum, both finite"),
            (0 <= self.range_sigma < np.inf, f"range_sigma: {self.range_sigma} m; at least 0"),
            (0 <= self.angle_sigma < np.inf, f"angle_sigma: {self.angle_sigma} rad; at least 0"),
            (0 <= self.dropout <= 1, f"dropout: {self.dropout}; a probability"),
        ]:
            if not good:
                raise SimulationError(f"lidar {line}")
        try:
            mount = se3.as_poses(self.T_body_sensor, "T_body_sensor").reshape(4, 4)
        except (GeometryError, ValueError) as error:
            raise SimulationError(f"lidar {error}") from error
        object.__setattr__(self, "elevations", tuple(elevations.tolist()))
        object.__setattr__(self, "T_body_sensor", tuple(map(tuple, mount.tolist())))

    @property
    def azimuths(self) -> Array:
        """Reported azimuth of each column, rad, shape (columns,): falls from just below pi to just above -pi."""
        return np.pi * (1 - (2 * np.arange(self.columns) + 1) / self.columns)

    @property
    def column_times(self) -> Array:
        """Time of each column after the stamp of the sweep, s, shape (columns,)."""
        return self.rotation_period * ((np.arange(self.columns) + 0.5) / self.columns - 0.5)

    def cast(self, world: World, T_world_body: npt.ArrayLike, rng: np.random.Generator, stamp: float = 0.0) -> Scan:
        """Take one scan from a body that stands still, as :meth:`cast_many` does."""
        return self.cast_many(world, np.asarray(T_world_body, np.float64)[None], rng, [stamp])[0]

    def cast_many(
        self, world: World, poses: npt.ArrayLike, rng: np.random.Generator, stamps: npt.ArrayLike | None = None
    ) -> list[Scan]:
        """Take one scan at each pose, standing still.

        Parameters
        ----------
        world : World
            Spatial surroundings.
        poses : array_like, shape (S, 4, 4)
            Poses ``T_world_body``.
        rng : numpy.random.Generator
            Source of all randomness.
        stamps : array_like, shape (S,), optional
            Times, s; zero by default.

        Returns
        -------
        list of Scan
            One a pose; a ray is ``BELOW_MINIMUM`` or ``NO_RETURN`` by its *measured* range.

        Raises
        ------
        SimulationError
            If the world is not spatial, or the stamps are not as many as the poses.
        GeometryError
            If a pose is no rigid motion.
        """
        T_world_body = se3.as_poses(poses)
        times = np.zeros(len(T_world_body)) if stamps is None else np.asarray(stamps, np.float64)
        if T_world_body.ndim != 3 or times.shape != T_world_body.shape[:1]:
            raise SimulationError(f"stamps: shape {times.shape} does not fit poses {T_world_body.shape}")
        return [
            self._sweep(world, pose, np.broadcast_to(pose, (self.columns, 4, 4)), float(stamp), rng)
            for pose, stamp in zip(T_world_body, times, strict=True)
        ]

    def sweep(self, world: World, trajectory: Trajectory, rng: np.random.Generator, stamp: float) -> Scan:
        """Take one scan from a moving body: each column from where the body is at its time.

        Parameters
        ----------
        world : World
            Spatial surroundings.
        trajectory : Trajectory
            True poses ``T_world_body``; they reach half a turn of the lidar beyond the stamp, to both sides.
        rng : numpy.random.Generator
            Source of all randomness.
        stamp : float
            Middle of the sweep, s.

        Returns
        -------
        Scan
            With the rays as ``motion_distortion`` says.

        Raises
        ------
        SimulationError
            If the world is not spatial.
        GeometryError
            If the trajectory is too short.
        """
        moving = trajectory.to_3d().at(np.append(stamp + self.column_times, stamp)).poses
        return self._sweep(world, moving[-1], moving[:-1], float(stamp), rng)

    @cached_property
    def directions(self) -> Array:
        """Reported unit directions in the sensor frame, shape (beams, columns, 3)."""
        return _unit(self.azimuths[None, :], np.array(self.elevations)[:, None])

    def _sweep(self, world: World, T_world_body: Array, columns: Array, stamp: float, rng: np.random.Generator) -> Scan:
        """Cast one sweep from the poses of the body at each column (columns, 4, 4), reported for one pose (4, 4)."""
        if world.dimension != self.dimension:
            raise SimulationError(f"world: has {world.dimension} dimensions; a spatial lidar needs 3")
        mount = np.array(self.T_body_sensor)
        shape = (len(self.elevations), self.columns)
        T_world_columns = columns @ mount
        azimuth_noise, elevation_noise = self.angle_sigma * rng.standard_normal((2, *shape))
        elevation = np.array(self.elevations)[:, None]
        true = self.directions
        if self.angle_sigma > 0:
            true = _unit(self.azimuths + azimuth_noise / np.cos(elevation), elevation + elevation_noise)
        times = stamp + self.column_times
        hits = world.cast(T_world_columns[:, :3, 3], _turned(T_world_columns, true), rng, times)
        measured = np.maximum(hits.ranges + self.range_sigma * rng.standard_normal(shape), 0)
        measured[rng.random(shape) < self.dropout] = np.inf
        low, high = self.range_limits
        status = np.full(shape, RayStatus.RETURN, np.uint8)
        status[measured < low], status[measured >= high] = RayStatus.BELOW_MINIMUM, RayStatus.NO_RETURN
        directions, origins = self.directions, np.zeros((0, 3))
        if not self.motion_distortion:
            T_sensor_columns = se3.between(T_world_body @ mount, T_world_columns)
            directions = _turned(T_sensor_columns, directions)
            origins = np.broadcast_to(T_sensor_columns[:, :3, 3], (*shape, 3)).reshape(-1, 3)
        return Scan(
            directions=directions.reshape(-1, 3),
            ranges=np.minimum(measured, high).ravel(),
            status=status.ravel(),
            range_limits=self.range_limits,
            origins=origins,
            stamp=stamp,
            stamps=np.broadcast_to(times, shape).ravel(),
            shape=shape,
            frame=self.frame,
            T_body_sensor=mount,
        )


def _unit(azimuth: Array, elevation: Array) -> Array:
    """Unit vectors of azimuths and elevations, rad, which broadcast; shape (..., 3)."""
    flat = np.cos(elevation)
    return np.stack(np.broadcast_arrays(flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)), -1)


def _turned(poses: Array, directions: Array) -> Array:
    """Directions (beams, columns, 3) turned by the pose of their column (columns, 4, 4)."""
    # One matrix product a column instead of an einsum over all rays, at half the time.
    return np.asarray(np.swapaxes(np.swapaxes(directions, 0, 1) @ np.swapaxes(poses[:, :3, :3], -1, -2), 0, 1))
