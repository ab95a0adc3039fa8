"""Route: a drivable path of straight lines and arcs through waypoints."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from factorloc.errors import SimulationError
from factorloc.geometry import se2, wrap
from factorloc.simulation.world import World
from factorloc.trajectory import Trajectory

__all__ = ["Route"]

Array = npt.NDArray[np.float64]

_CHECK_STEP = 0.02  # m; between two such points an arc of 0.3 m radius strays by less than 0.2 mm


@dataclass(frozen=True)
class Route:
    """A path with corners rounded by arcs, driven forwards at constant speed.

    Parameters
    ----------
    waypoints : tuple of (float, float)
        Corners of the path in the world, m; it begins at the first and ends at the last.
    radius : float
        Radius of the arcs, m.
    speed : float
        Speed of the body's origin along the path, m/s.
    body_radius : float
        The body is a disc of this radius about its origin, m.

    Raises
    ------
    SimulationError
        If there are fewer than two waypoints, two that coincide, a corner too sharp or a leg too short for the arcs, or
        a setting that is not positive.
    """

    waypoints: tuple[tuple[float, float], ...]
    radius: float = 0.5
    speed: float = 1.0
    body_radius: float = 0.25

    def __post_init__(self) -> None:
        if np.ndim(self.waypoints) != 2 or np.shape(self.waypoints)[1] != 2 or len(self.waypoints) < 2:
            raise SimulationError(f"waypoints: shape {np.shape(self.waypoints)}; expected at least two points (x, y)")
        for name in ("radius", "speed", "body_radius"):
            if not 0 < getattr(self, name) < np.inf:
                raise SimulationError(f"route {name}: {getattr(self, name)}; must be positive and finite")
        _ = self._pieces

    @property
    def length(self) -> float:
        """Length of the path, m."""
        return float(self._ends[-1])

    @property
    def duration(self) -> float:
        """Time to drive it, s."""
        return self.length / self.speed

    def poses_at(self, distances: npt.ArrayLike) -> Array:
        """Poses ``T_world_body`` after given distances along the path (...), m, shape (..., 3)."""
        s = np.asarray(distances, np.float64)
        starts, _, curvatures = self._pieces
        piece = np.minimum(np.searchsorted(self._ends, s, side="right"), len(self._ends) - 1)
        rest = s - np.concatenate([[0.0], self._ends])[piece]
        return se2.compose(starts[piece], se2.exp(np.stack([rest, np.zeros_like(s), rest * curvatures[piece]], -1)))

    def sample(self, period: float) -> Trajectory:
        """Drive the route and note the pose once a period, from time 0 on.

        Parameters
        ----------
        period : float
            Time between two poses, s.

        Raises
        ------
        SimulationError
            If the period is not positive.
        """
        if not 0 < period < np.inf:
            raise SimulationError(f"period: {period} s; must be positive and finite")
        # A route of exactly n periods has n + 1 poses, whichever way its length was rounded.
        stamps = period * np.arange(int(self.duration / period + 1e-9) + 1, dtype=np.float64)
        return Trajectory(stamps, self.poses_at(np.minimum(stamps * self.speed, self.length)))

    def clearance(self, world: World) -> float:
        """Return the smallest distance between the driven disc and the world, m; negative where they overlap."""
        return float(self._clearances(world).min())

    def check(self, world: World) -> None:
        """Make sure that the body touches nothing.

        Parameters
        ----------
        world : World
            Planar surroundings.

        Raises
        ------
        SimulationError
            If the body touches something; names the first place.
        """
        touching = np.flatnonzero(self._clearances(world) <= 0)
        if len(touching):
            s = min(touching[0] * _CHECK_STEP, self.length)
            x, y, _ = self.poses_at(s)
            raise SimulationError(
                f"route: a body of radius {self.body_radius:.2f} m touches something at ({x:.2f}, {y:.2f}), {s:.1f} m "
                "along; move the waypoints"
            )

    def _clearances(self, world: World) -> Array:
        steps = np.arange(int(self.length / _CHECK_STEP) + 2) * _CHECK_STEP
        return world.clearance(self.poses_at(np.minimum(steps, self.length))[:, :2]) - self.body_radius

    @cached_property
    def _ends(self) -> Array:
        return np.cumsum(self._pieces[1])

    @cached_property
    def _pieces(self) -> tuple[Array, Array, Array]:
        """Start poses (P, 3), lengths (P,) and curvatures (P,) of lines and arcs in turn, beginning with a line."""
        points = np.asarray(self.waypoints, np.float64)
        legs = np.diff(points, axis=0)
        lengths = np.hypot(legs[:, 0], legs[:, 1])
        if not np.isfinite(points).all() or not (lengths > 0).all():
            raise SimulationError("waypoints: not finite, or one equals the next; leave it out")
        headings = np.arctan2(legs[:, 1], legs[:, 0])
        turns = wrap(np.diff(headings))
        with np.errstate(over="ignore"):
            tangents = np.concatenate([[0.0], self.radius * np.abs(np.tan(turns / 2)), [0.0]])
        lines = lengths - tangents[:-1] - tangents[1:]
        if (lines < -1e-9).any():
            short = int(lines.argmin())
            raise SimulationError(
                f"route: the leg from {self.waypoints[short]} to {self.waypoints[short + 1]} is {-lines[short]:.2f} m "
                f"too short for arcs of radius {self.radius} m; move the waypoints or turn less sharply"
            )
        unit = legs / lengths[:, None]
        starts = np.empty((2 * len(legs) - 1, 3))
        starts[::2] = np.column_stack([points[:-1] + unit * tangents[:-1, None], headings])
        starts[1::2] = np.column_stack([points[1:-1] - unit[:-1] * tangents[1:-1, None], headings[:-1]])
        arcs = np.zeros((2, len(starts)))
        arcs[0, ::2], arcs[0, 1::2] = np.maximum(lines, 0), self.radius * np.abs(turns)
        arcs[1, 1::2] = np.sign(turns) / self.radius
        return starts, arcs[0], arcs[1]
