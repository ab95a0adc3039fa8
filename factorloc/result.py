"""Result: everything an estimator knows when it stops."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

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
        Lowest and highest heading, rad.
    polygons : tuple of ndarray, each of shape (V, 2)
        Corners of convex polygons that enclose the position, m.
    """

    orientation: tuple[float, float]
    polygons: tuple[Array, ...]


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
