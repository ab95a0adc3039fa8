"""PlanarLidar: a rotating range finder with the noise of a real one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
import numpy.typing as npt

from factorloc.errors import SimulationError
from factorloc.geometry import se2
from factorloc.scan import Scan
from factorloc.simulation.world import World

__all__ = ["Lidar", "PlanarLidar"]

Array = npt.NDArray[np.float64]


class Lidar(Protocol):
    """A sensor that can be carried through a :class:`~factorloc.simulation.world.World` of its dimension."""

    @property
    def dimension(self) -> int:
        """2 or 3."""
        ...

    def cast_many(
        self, world: World, poses: npt.ArrayLike, rng: np.random.Generator, stamps: npt.ArrayLike | None = None
    ) -> list[Scan]:
        """Take one scan at each pose ``T_world_body``."""
        ...


@dataclass(frozen=True)
class PlanarLidar:
    """A lidar that sweeps one plane; by default 181 beams over half a turn, as of the SICK LMS 200.

    Parameters
    ----------
    beams : int
        Rays of a scan, evenly spread from one end of the field of view to the other, both included.
    field_of_view : float
        Angle between the first and the last beam, symmetric about the sensor's x axis, rad; less than a full turn.
    range_limits : (float, float)
        Minimum and maximum range, m.
    range_sigma : float
        Standard deviation of the range noise, m.
    angle_sigma : float
        Standard deviation of the true beam angle about the reported one, drawn anew for each ray, rad.
    dropout : float
        Probability that a reflection is not noticed; such a ray is reported without return.
    T_body_sensor : (float, float, float)
        Pose of the sensor on the body: x and y in m, heading in rad.
    frame : str
        Name of the sensor frame.

    Raises
    ------
    SimulationError
        If a setting is out of its range.
    """

    dimension: ClassVar[int] = 2

    beams: int = 181
    field_of_view: float = np.pi
    range_limits: tuple[float, float] = (0.1, 30.0)
    range_sigma: float = 0.01
    angle_sigma: float = 0.0
    dropout: float = 0.0
    T_body_sensor: tuple[float, float, float] = (0.1, 0.0, 0.0)
    frame: str = "laser"

    def __post_init__(self) -> None:
        low, high = self.range_limits
        for good, line in [
            (self.beams >= 2, f"beams: {self.beams}; at least 2"),
            (0 < self.field_of_view < 2 * np.pi, f"field_of_view: {self.field_of_view} rad; in (0, 2 pi)"),
            (0 <= low < high < np.inf, f"range_limits: ({low}, {high}) m; 0 <= minimum < maximum, both finite"),
            (0 <= self.range_sigma < np.inf, f"range_sigma: {self.range_sigma} m; at least 0"),
            (0 <= self.angle_sigma < np.inf, f"angle_sigma: {self.angle_sigma} rad; at least 0"),
            (0 <= self.dropout <= 1, f"dropout: {self.dropout}; a probability"),
            (np.shape(self.T_body_sensor) == (3,), "T_body_sensor: expected (x, y, heading)"),
        ]:
            if not good:
                raise SimulationError(f"lidar {line}")

    @classmethod
    def wide(cls) -> PlanarLidar:
        """Return a lidar of 541 beams over 270 degrees, every half degree."""
        return cls(beams=541, field_of_view=1.5 * np.pi)

    @property
    def angles(self) -> Array:
        """Reported beam angles in the sensor frame, rad, shape (beams,)."""
        return np.linspace(-self.field_of_view / 2, self.field_of_view / 2, self.beams)

    def cast(self, world: World, T_world_body: npt.ArrayLike, rng: np.random.Generator, stamp: float = 0.0) -> Scan:
        """Take one scan.

        Parameters
        ----------
        world : World
            Planar surroundings.
        T_world_body : array_like, shape (3,)
            Pose of the body.
        rng : numpy.random.Generator
            Source of all randomness.
        stamp : float
            Time, s.

        Returns
        -------
        Scan
            With the beams' reported directions; a ray is ``BELOW_MINIMUM`` or ``NO_RETURN`` by its *measured* range.

        Raises
        ------
        SimulationError
            If the world is not planar.
        GeometryError
            If the pose is not planar and finite.
        """
        return self.cast_many(world, np.asarray(T_world_body, np.float64)[None], rng, [stamp])[0]

    def cast_many(
        self, world: World, poses: npt.ArrayLike, rng: np.random.Generator, stamps: npt.ArrayLike | None = None
    ) -> list[Scan]:
        """Take one scan at each pose, as :meth:`cast` does, all rays in one go.

        Parameters
        ----------
        world : World
            Planar surroundings.
        poses : array_like, shape (S, 3)
            Poses ``T_world_body``.
        rng : numpy.random.Generator
            Source of all randomness.
        stamps : array_like, shape (S,), optional
            Times, s; zero by default.

        Returns
        -------
        list of Scan
            One a pose.

        Raises
        ------
        SimulationError
            If the world is not planar, or the stamps are not as many as the poses.
        GeometryError
            If a pose is not planar and finite.
        """
        if world.dimension != self.dimension:
            raise SimulationError(f"world: has {world.dimension} dimensions; a planar lidar needs 2")
        T_world_sensor = se2.compose(se2.as_poses(poses), np.asarray(self.T_body_sensor))
        times = np.zeros(len(T_world_sensor)) if stamps is None else np.asarray(stamps, np.float64)
        if T_world_sensor.ndim != 2 or times.shape != T_world_sensor.shape[:1]:
            raise SimulationError(f"stamps: shape {times.shape} does not fit poses {T_world_sensor.shape}")
        shape = (len(T_world_sensor), self.beams)
        bearing = T_world_sensor[:, 2:] + self.angles + self.angle_sigma * rng.standard_normal(shape)
        hits = world.cast(T_world_sensor[:, None, :2], np.stack([np.cos(bearing), np.sin(bearing)], -1), rng)
        measured = hits.ranges + self.range_sigma * rng.standard_normal(shape)
        measured[rng.random(shape) < self.dropout] = np.inf
        return self._scans(np.maximum(measured, 0), times)

    def _scans(self, measured: Array, stamps: Array) -> list[Scan]:
        return [
            Scan.from_polar(
                self.angles,
                ranges,
                self.range_limits,
                stamp=float(stamp),
                frame=self.frame,
                T_body_sensor=self.T_body_sensor,
            )
            for ranges, stamp in zip(measured, stamps, strict=True)
        ]
