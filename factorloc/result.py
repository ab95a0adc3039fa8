"""Result: everything an estimator knows when it stops."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from factorloc.errors import GeometryError

if TYPE_CHECKING:
    from factorloc.trajectory import Trajectory

__all__ = ["Bounds", "Iteration", "Result", "StopReason"]

Array = npt.NDArray[np.float64]


class StopReason(enum.StrEnum):
    """Why an optimization ended."""

    CONVERGED = "converged: the cost changed less than the tolerance"
    SMALL_STEP = "converged: the step was shorter than the tolerance"
    MAX_ITERATIONS = "stopped: the iteration limit was reached"
    MAX_DAMPING = "stopped: no damping gave a better step"
    SEQUENTIAL = "finished: every scan was registered once, in order"
    FILTERED = "finished: every scan was weighed once, in order"
    INTERSECTED = "finished: every scan was intersected once, in order"

    @property
    def converged(self) -> bool:
        """Whether the estimate is a minimum to the asked tolerance."""
        return self in (StopReason.CONVERGED, StopReason.SMALL_STEP)


@dataclass(frozen=True)
class Iteration:
    """One accepted step of an optimizer.

    Parameters
    ----------
    level : float
        Blur of the map pyramid in force, m (0 for the map itself).
    cost : float
        Cost after the step.
    damping : float
        Damping that was accepted.
    trials : int
        Linear systems solved for this step.
    """

    level: float
    cost: float
    damping: float
    trials: int


@dataclass(frozen=True)
class Bounds:
    """Guaranteed bounds of one pose: an orientation interval and a union of convex polygons.

    Parameters
    ----------
    orientation : (float, float)
        Lowest and highest heading, rad; not wrapped, so that the first is never above the second.
    polygons : tuple of ndarray, each of shape (V, 2)
        Corners, counter-clockwise, of convex polygons that enclose the position, m; none, if no pose is possible.
    """

    orientation: tuple[float, float]
    polygons: tuple[Array, ...]

    @classmethod
    def around(cls, pose: npt.ArrayLike, position: float, heading: float) -> Bounds:
        """A square of half side ``position`` (m), and ``heading`` (rad) to either side, around ``[x, y, theta]``."""
        x, y, theta = np.asarray(pose, np.float64)
        corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        return cls((float(theta - heading), float(theta + heading)), (corners * position + [x, y],))

    @property
    def is_empty(self) -> bool:
        """Whether no pose is possible."""
        return not self.polygons

    def heading(self, theta: float) -> float:
        """The same heading in the turn nearest to the middle of the interval, rad."""
        middle = 0.5 * (self.orientation[0] + self.orientation[1])
        return float(theta - 2 * np.pi * np.round((theta - middle) / (2 * np.pi)))

    def contains(self, pose: npt.ArrayLike, tolerance: float = 0.0) -> bool:
        """Whether a pose ``[x, y, theta]`` is possible, up to a tolerance (m and rad)."""
        x, y, theta = np.asarray(pose, np.float64)
        low, high = self.orientation
        if not low - tolerance <= self.heading(theta) <= high + tolerance:
            return False
        return any(_inside(polygon, np.array([x, y]), tolerance) for polygon in self.polygons)

    def nearest(self, pose: npt.ArrayLike) -> Array:
        """The pose itself if it is possible, else one nearby that is: just inside the nearest polygon.

        Raises
        ------
        GeometryError
            If no pose is possible.
        """
        if self.is_empty:
            raise GeometryError("bounds: no pose is possible; there is none to begin with")
        given = np.array(pose, np.float64)
        low, high = self.orientation
        inset = 1e-6 * (high - low)
        theta = float(np.clip(self.heading(given[2]), low + inset, high - inset))
        if any(_inside(polygon, given[:2], 0.0) for polygon in self.polygons):
            return np.array([*given[:2], theta])
        places = [_nearest_of(polygon, given[:2]) for polygon in self.polygons]
        best = min(places, key=lambda place: float(np.hypot(*(place - given[:2]))))
        return np.array([*best, theta])


def _inside(polygon: Array, point: Array, tolerance: float) -> bool:
    edge, away = np.roll(polygon, -1, 0) - polygon, point - polygon
    cross = edge[:, 0] * away[:, 1] - edge[:, 1] * away[:, 0]
    return bool(len(polygon) and (cross >= -tolerance * np.hypot(edge[:, 0], edge[:, 1])).all())


def _nearest_of(polygon: Array, point: Array) -> Array:
    edge = np.roll(polygon, -1, 0) - polygon
    square = np.maximum((edge**2).sum(1), 1e-300)
    along = np.clip(((point - polygon) * edge).sum(1) / square, 0.0, 1.0)
    feet = polygon + along[:, None] * edge
    foot = feet[np.argmin(((feet - point) ** 2).sum(1))]
    return np.asarray(foot + 1e-6 * (polygon.mean(0) - foot))


@dataclass(frozen=True)
class Result:
    """An estimated trajectory and how it came about.

    Parameters
    ----------
    trajectory : Trajectory
        Estimated poses, with marginal covariances where the estimator has them.
    cost : float
        Final cost (half the sum of squared whitened residuals, plus the scans' negative log-likelihoods).
    history : tuple of Iteration
        Accepted steps, in order.
    stop : StopReason
        Why it ended.
    residuals : dict of str to ndarray
        Cost of each factor at the estimate, by kind of factor (``"scan"``, ``"odometry"``, ``"prior"``, ...).
    rejected : dict of str to int
        What was left out, and how much of it.
    seconds : float
        Wall time without compilation.
    bounds : tuple of Bounds, optional
        Guaranteed bounds, one a pose.
    """

    trajectory: Trajectory
    cost: float
    history: tuple[Iteration, ...]
    stop: StopReason
    residuals: dict[str, Array] = field(default_factory=dict)
    rejected: dict[str, int] = field(default_factory=dict)
    seconds: float = 0.0
    bounds: tuple[Bounds, ...] | None = None

    @property
    def iterations(self) -> int:
        """Accepted steps over all levels."""
        return len(self.history)

    @property
    def converged(self) -> bool:
        """Whether the optimizer met its tolerance."""
        return self.stop.converged

    def summary(self) -> str:
        """Return one line for people."""
        return f"{len(self.trajectory)} poses, cost {self.cost:.2f}, {self.iterations} iterations, {self.stop.value}"
