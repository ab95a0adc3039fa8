"""Runs of Monte Carlo localization, and when they had converged."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchmarks.mcl_scenes import Run
from factorloc.evaluation import nees
from factorloc.geometry import group_of, se3
from factorloc.localization import Initialization, MonteCarloSettings, Particles, localize_by_particles
from factorloc.mapping.sensor_model import SensorModel

__all__ = ["Outcome", "converged_at", "errors", "measure", "wilson"]

Array = npt.NDArray[np.float64]

_Z = 1.959964  # quantile of 97.5 % of the normal distribution


@dataclass(frozen=True)
class Outcome:
    """How one run went.

    Parameters
    ----------
    position, heading : ndarray, shape (N,)
        Errors of each scan's estimate, m and deg (in space of the whole rotation).
    converged_at : int or None
        First scan from which on all are small, if the last one is.
    weighed : ndarray
        NEES of the second half of the run, if it converged before.
    milliseconds : float
        A scan took.
    recoveries : int
        How often particles were drawn elsewhere.
    particles : float
        Mean number.
    """

    position: Array
    heading: Array
    converged_at: int | None
    weighed: Array
    milliseconds: float
    recoveries: int
    particles: float


def measure(
    numbers: Sequence[int],
    drive: Callable[[int], Run],
    model: SensorModel,
    settings: MonteCarloSettings,
    success: tuple[float, float],
    free_space: Initialization | None,
    on_particles: Callable[[Particles], None] | None = None,
) -> list[Outcome]:
    """Localize drives; particles of the first one are handed out."""
    outcomes = []
    for number in numbers:
        run = drive(number)
        found = localize_by_particles(
            model, run.scans, run.odometry, run.start, covariances=run.covariances, settings=settings,
            free_space=free_space, on_particles=on_particles if number == numbers[0] else None, seed=run.seed,
        )  # fmt: skip
        position, heading = errors(found.trajectory.poses, run.truth)
        near = (position < success[0]) & (heading < success[1])
        first = converged_at(near)
        late = slice(len(near) // 2, None)
        group = group_of(model.grid.dimension)
        tangent = group.log(group.between(found.trajectory.poses, run.truth))[late]
        assert found.trajectory.covariances is not None
        weighed = nees(tangent, found.trajectory.covariances[late]).values / tangent.shape[1]
        outcomes.append(
            Outcome(
                position,
                heading,
                first,
                weighed if first is not None and first <= len(near) // 2 else weighed[:0],
                1e3 * found.seconds / len(run.scans),
                found.rejected["recoveries"],
                float(found.residuals["particles"].mean()),
            )
        )
    return outcomes


def errors(found: Array, truth: Array) -> tuple[Array, Array]:
    """Errors of position, m, and of heading (in space of rotation), deg, shape (N,) each."""
    if truth.ndim == 2:
        turn = np.abs(np.angle(np.exp(1j * (found[:, 2] - truth[:, 2]))))
        return np.linalg.norm(found[:, :2] - truth[:, :2], axis=1), np.degrees(turn)
    tangent = se3.log(se3.between(truth, found))
    return np.linalg.norm(found[:, :3, 3] - truth[:, :3, 3], axis=1), np.degrees(np.linalg.norm(tangent[:, :3], axis=1))


def converged_at(near: npt.NDArray[np.bool_]) -> int | None:
    """First scan from which on all are near; None if the last one is not."""
    if not near[-1]:
        return None
    far = np.flatnonzero(~near)
    return int(far[-1]) + 1 if len(far) else 0


def wilson(successes: int, runs: int, z: float = _Z) -> tuple[float, float]:
    """Confidence interval of a probability after so many successes (Wilson 1927)."""
    share, spread_of = successes / runs, z * z / runs
    middle = share + spread_of / 2
    reach = z * np.sqrt(share * (1 - share) / runs + spread_of / (4 * runs))
    return float((middle - reach) / (1 + spread_of)), float((middle + reach) / (1 + spread_of))
