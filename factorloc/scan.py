"""Scan: what a lidar reports in one sweep, as rays."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from factorloc.errors import GeometryError
from factorloc.geometry import se2, se3

__all__ = ["RayStatus", "Scan"]

Array = npt.NDArray[np.float64]


class RayStatus(enum.IntEnum):
    """What became of a ray (thesis, eq. 7.14)."""

    RETURN = 0
    """Reflected within the range limits."""
    BELOW_MINIMUM = 1
    """Reflected nearer than the sensor can measure (``sub``)."""
    NO_RETURN = 2
    """Not reflected up to the maximum range (``sup``)."""


@dataclass(frozen=True)
class Scan:
    """Rays of one sweep in the sensor frame, and where the sensor sits on the body.

    Parameters
    ----------
    directions : ndarray, shape (N, D)
        Unit vectors in the sensor frame; D is 2 or 3.
    ranges : ndarray, shape (N,)
        Distance from ray origin to reflection, m. For a ray without return it is set to the maximum range, for one
        below the minimum to the minimum range: the length over which that ray says something.
    status : ndarray of uint8, shape (N,)
        :class:`RayStatus` of each ray.
    range_limits : (float, float)
        Minimum and maximum range of the sensor, m.
    origins : ndarray, shape (N, D), optional
        Ray origins in the sensor frame, m; zero by default.
    stamp : float
        Time of the sweep, s.
    stamps : ndarray, shape (N,), optional
        Time of each ray, s.
    shape : (int, int), optional
        Rows and columns of an organized scan; their product is N.
    frame : str
        Name of the sensor frame.
    T_body_sensor : ndarray, shape (3,) or (4, 4), optional
        Pose of the sensor on the body; identity by default.

    Raises
    ------
    GeometryError
        If shapes disagree, a direction is not of unit length, a range is negative or not finite, or the limits cross.
    """

    directions: Array
    ranges: Array
    status: npt.NDArray[np.uint8]
    range_limits: tuple[float, float]
    origins: Array = field(default_factory=lambda: np.zeros(0))
    stamp: float = 0.0
    stamps: Array | None = None
    shape: tuple[int, int] | None = None
    frame: str = "sensor"
    T_body_sensor: Array = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        directions = np.ascontiguousarray(self.directions, np.float64)
        if directions.ndim != 2 or directions.shape[1] not in (2, 3):
            raise GeometryError(f"directions: shape {directions.shape}; expected (rays, 2) or (rays, 3)")
        n, d = directions.shape
        ranges = np.array(self.ranges, np.float64)
        if not np.isin(self.status, list(RayStatus)).all():
            raise GeometryError("status: holds an unknown code; use RayStatus")
        status = np.ascontiguousarray(self.status, np.uint8)
        origins = np.ascontiguousarray(self.origins, np.float64)
        origins = np.zeros((n, d)) if origins.size == 0 else origins
        shapes = {"ranges": (ranges.shape, (n,)), "status": (status.shape, (n,)), "origins": (origins.shape, (n, d))}
        for name, (given, expected) in shapes.items():
            if given != expected:
                raise GeometryError(f"{name}: shape {given}; expected {expected}, one row a ray")
        low, high = (float(limit) for limit in self.range_limits)
        if not 0 <= low < high:
            raise GeometryError(f"range_limits: ({low}, {high}); expected 0 <= minimum < maximum")
        if not np.isfinite(high) and (status == RayStatus.NO_RETURN).any():
            raise GeometryError("range_limits: a ray without return needs a finite maximum range")
        ranges[status == RayStatus.BELOW_MINIMUM] = low
        ranges[status == RayStatus.NO_RETURN] = high
        if not (np.isfinite(ranges).all() and (ranges >= 0).all()):
            raise GeometryError("ranges: negative or not finite; mark such rays NO_RETURN or leave them out")
        if not (np.isfinite(directions).all() and np.abs(np.linalg.norm(directions, axis=1) - 1).max(initial=0) < 1e-6):
            raise GeometryError("directions: not of unit length; normalize them")
        if not np.isfinite(origins).all():
            raise GeometryError("origins: not finite")
        stamps = None if self.stamps is None else np.ascontiguousarray(self.stamps, np.float64)
        if stamps is not None and not (stamps.shape == (n,) and np.isfinite(stamps).all()):
            raise GeometryError(f"stamps: shape {stamps.shape}; expected {(n,)}, one finite time a ray")
        if self.shape is not None and self.shape[0] * self.shape[1] != n:
            raise GeometryError(f"shape: {self.shape} holds not {n} rays")
        mount = np.asarray(self.T_body_sensor, np.float64)
        if d == 2:
            mount = se2.identity() if mount.size == 0 else se2.as_poses(mount, "T_body_sensor")
        else:
            mount = se3.identity() if mount.size == 0 else se3.as_poses(mount, "T_body_sensor")
        if mount.ndim != d - 1:
            raise GeometryError(f"T_body_sensor: shape {mount.shape}; a scan has one sensor pose")
        arrays = {"directions": directions, "ranges": ranges, "status": status, "origins": origins}
        for name, array in {**arrays, "T_body_sensor": mount}.items():
            object.__setattr__(self, name, array)
        object.__setattr__(self, "stamps", stamps)
        object.__setattr__(self, "range_limits", (low, high))

    @classmethod
    def from_polar(
        cls,
        angles: npt.ArrayLike,
        ranges: npt.ArrayLike,
        range_limits: tuple[float, float],
        *,
        stamp: float = 0.0,
        frame: str = "sensor",
        T_body_sensor: npt.ArrayLike | None = None,
    ) -> Scan:
        """Build a planar scan; the status of each ray follows from its range and the limits.

        Parameters
        ----------
        angles : array_like, shape (N,)
            Beam angles in the sensor frame, rad, counter-clockwise from the x axis.
        ranges : array_like, shape (N,)
            Measured ranges, m. Infinity, and whatever reaches the maximum, is a ray without return.
        range_limits : (float, float)
            Minimum and maximum range, m.
        stamp : float
            Time, s.
        frame : str
            Name of the sensor frame.
        T_body_sensor : array_like, shape (3,), optional
            Pose of the sensor on the body.

        Raises
        ------
        GeometryError
            If a range is NaN or negative, or shapes disagree.
        """
        angle, r = np.asarray(angles, np.float64), np.asarray(ranges, np.float64)
        if angle.shape != r.shape or angle.ndim != 1:
            raise GeometryError(f"ranges: shape {r.shape} does not fit the {angle.shape} angles")
        if np.isnan(r).any() or (r < 0).any():
            raise GeometryError("ranges: NaN or negative; mark such rays with infinity (no return) or leave them out")
        status = np.full(r.shape, RayStatus.RETURN, np.uint8)
        status[r < range_limits[0]] = RayStatus.BELOW_MINIMUM
        status[r >= range_limits[1]] = RayStatus.NO_RETURN
        return cls(
            directions=np.stack([np.cos(angle), np.sin(angle)], -1),
            ranges=np.where(np.isfinite(r), r, range_limits[1]),
            status=status,
            range_limits=range_limits,
            stamp=stamp,
            frame=frame,
            T_body_sensor=np.zeros(0) if T_body_sensor is None else np.asarray(T_body_sensor, np.float64),
        )

    @classmethod
    def from_points(
        cls,
        points: npt.ArrayLike,
        range_limits: tuple[float, float],
        *,
        stamp: float = 0.0,
        stamps: npt.ArrayLike | None = None,
        shape: tuple[int, int] | None = None,
        frame: str = "sensor",
        T_body_sensor: npt.ArrayLike | None = None,
    ) -> Scan:
        """Build a scan from points in the sensor frame: every point is a ray that starts at the sensor's origin.

        A point nearer than the minimum range is a ray below the minimum, one at or beyond the maximum a ray without
        return. A point cloud does not say where rays met nothing at all. Recorders write (0, 0, 0) or NaN for those;
        neither has a direction, so the reader counts them and leaves them out.

        Parameters
        ----------
        points : array_like, shape (N, D)
            Measured points, m; D is 2 or 3.
        range_limits : (float, float)
            Minimum and maximum range, m.
        stamp : float
            Time of the sweep, s.
        stamps : array_like, shape (N,), optional
            Time of each point, s.
        shape : (int, int), optional
            Rows and columns of an organized cloud.
        frame : str
            Name of the sensor frame.
        T_body_sensor : array_like, shape (3,) or (4, 4), optional
            Pose of the sensor on the body.

        Raises
        ------
        GeometryError
            If a point is not finite or at the origin, or shapes disagree.
        """
        ends = np.asarray(points, np.float64)
        if ends.ndim != 2 or ends.shape[1] not in (2, 3):
            raise GeometryError(f"points: shape {ends.shape}; expected (points, 2) or (points, 3)")
        if not np.isfinite(ends).all():
            raise GeometryError("points: NaN or infinity; leave those points out, they are no rays")
        r = np.linalg.norm(ends, axis=1)
        if (r == 0).any():
            raise GeometryError(f"points: {(r == 0).sum()} at the sensor's origin, of no direction; leave them out")
        status = np.full(r.shape, RayStatus.RETURN, np.uint8)
        status[r < range_limits[0]] = RayStatus.BELOW_MINIMUM
        status[r >= range_limits[1]] = RayStatus.NO_RETURN
        return cls(
            directions=ends / r[:, None],
            ranges=r,
            status=status,
            range_limits=range_limits,
            stamp=stamp,
            stamps=None if stamps is None else np.asarray(stamps, np.float64),
            shape=shape,
            frame=frame,
            T_body_sensor=np.zeros(0) if T_body_sensor is None else np.asarray(T_body_sensor, np.float64),
        )

    def __len__(self) -> int:
        return len(self.ranges)

    @property
    def dimension(self) -> int:
        """2 for a planar scan, 3 for a spatial one."""
        return int(self.directions.shape[1])

    @property
    def is_return(self) -> npt.NDArray[np.bool_]:
        """Which rays were reflected within the limits, shape (N,)."""
        return np.asarray(self.status == RayStatus.RETURN)

    def points(self) -> Array:
        """End points of the rays with a return, in the sensor frame, shape (returns, D)."""
        keep = self.is_return
        return np.asarray(self.origins[keep] + self.directions[keep] * self.ranges[keep, None])

    def select(self, keep: npt.ArrayLike) -> Scan:
        """Return the scan of some of its rays (mask or indices); an organized shape is lost."""
        keep = np.asarray(keep)
        stamps = None if self.stamps is None else self.stamps[keep]
        return replace(
            self,
            directions=self.directions[keep],
            ranges=self.ranges[keep],
            status=self.status[keep],
            origins=self.origins[keep],
            stamps=stamps,
            shape=None,
        )
