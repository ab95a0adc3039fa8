"""Bounded least squares: the most likely pose of a scan among facades, without leaving its feasible set.

Each point says ``n . (R p + t - centre) = 0`` of its facade, up to its own error, the shift of the building, and the
offset and turn that the errors of the facade's corners give it. These errors of the map are shared by all points of a
building or a facade: they are unknowns of their own with a Gaussian prior, so that a thousand points on one wall count
for one wall. Levenberg and Marquardt's method; as published, an update that would leave the feasible set is recomputed
with a higher damping (Ehambram, Jaulin, Wagner: Hybrid Interval-Probabilistic Localization in Building Maps).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc.config import Block
from factorloc.factors.prior import PosePrior
from factorloc.geometry import se2, wrap
from factorloc.localization.correspondence import Correspondence, Correspondences
from factorloc.localization.wall_lines import WallLines
from factorloc.localization.wall_problem import WallProblem
from factorloc.mapping.facade_points import FacadePoints
from factorloc.result import Bounds, Iteration, StopReason

__all__ = ["BoundedEstimate", "LeastSquaresSettings", "estimate_in_bounds", "line_points", "point_pairs", "solve_pairs"]

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]


class LeastSquaresSettings(Block):
    """What is likely within the bounds, and how it is sought.

    Parameters
    ----------
    point_sigma : float
        Standard deviation of a point's distance from its wall, m.
    cauchy : float
        Threshold of the robust loss, in standard deviations: balconies, parked cars and points of other walls are
        associated too.
    information : float
        Weight of a point; neighbours share a wall's ornaments.
    most_doubt : float
        More doubtful correspondences are left out, unless all are and nothing else is known.
    shift_sigma, vertex_sigma : float
        Standard deviations of shifts and of vertex errors, as parts of their greatest values.
    max_iterations : int
        Accepted steps.
    tolerance : float
        Ends when a step lowers the cost by less.
    initial_damping, damping_factor, max_damping : float
        Of Levenberg and Marquardt's method, relative to the diagonal.
    """

    point_sigma: float = Field(0.1, gt=0)
    cauchy: float = Field(2.0, gt=0)
    information: float = Field(0.2, gt=0, le=1)
    most_doubt: float = Field(0.2, gt=0, le=1)
    shift_sigma: float = Field(0.25, gt=0)
    vertex_sigma: float = Field(0.5, gt=0)
    max_iterations: int = Field(40, gt=0)
    tolerance: float = Field(1e-3, gt=0)
    initial_damping: float = Field(1e-4, gt=0)
    damping_factor: float = Field(10.0, gt=1)
    max_damping: float = Field(1e8, gt=0)


@dataclass(frozen=True, eq=False)
class BoundedEstimate:
    """Where the solver stopped, and why.

    Parameters
    ----------
    pose : ndarray, shape (3,)
        ``T_map_body``.
    covariance : ndarray, shape (3, 3)
        In the tangent space of the body; infinite where nothing determines the pose.
    cost : float
        Final cost.
    history : tuple of Iteration
        Accepted steps.
    stop : StopReason
        Why it ended.
    bounds : Bounds or None
        The feasible set it was held in.
    held : int
        Updates that would have left it.
    residuals : ndarray, shape (M,)
        Distances of the points from their walls at the estimate, signed, m.
    """

    pose: Array
    covariance: Array
    cost: float
    history: tuple[Iteration, ...]
    stop: StopReason
    bounds: Bounds | None
    held: int
    residuals: Array


def estimate_in_bounds(
    points: FacadePoints,
    correspondences: Correspondences,
    walls: WallLines,
    start: npt.ArrayLike,
    bounds: Bounds | None,
    *,
    conflicts: Sequence[int] = (),
    prior: PosePrior | None = None,
    settings: LeastSquaresSettings | None = None,
) -> BoundedEstimate:
    """Find the most likely pose: first by the lines of the correspondences, then by all points of their facades.

    Parameters
    ----------
    points : FacadePoints
        Of the scan.
    correspondences : Correspondences
        What it was associated with.
    walls : WallLines
        The map.
    start : array_like, shape (3,)
        First guess; moved into the feasible set if it is outside.
    bounds : Bounds, optional
        The feasible set; None for no bounds.
    conflicts : sequence of int
        Facades that are left out.
    prior : PosePrior, optional
        What else is known.
    settings : LeastSquaresSettings, optional
        See there.
    """
    settings = settings or LeastSquaresSettings()
    kept = [one for one in correspondences.found if one.facade not in conflicts]
    trusted = [one for one in kept if one.doubt <= settings.most_doubt]
    kept = trusted if trusted or prior is not None else kept
    pose = np.array(start, np.float64) if bounds is None else bounds.nearest(start)
    if kept:
        lines, rows = line_points(kept)
        pose = solve_pairs(lines, rows, walls, pose, bounds, prior, settings, robust=3.0).pose
    pairs, rows = point_pairs(points, correspondences, {one.facade for one in kept})
    return solve_pairs(pairs, rows, walls, pose, bounds, prior, settings, robust=settings.cauchy)


def line_points(found: Sequence[Correspondence]) -> tuple[Array, Rows]:
    """Five points of the middle line of each correspondence, in the frame of the body, and their facades."""
    points, rows = [], []
    for one in found:
        alpha, d = float(one.alpha.mid), float(one.d.mid)
        normal = np.array([math.cos(alpha), math.sin(alpha)])
        along = np.linspace(*one.extent, 5)[:, None] * np.array([-normal[1], normal[0]])
        points.append(one.anchor + d * normal + along)
        rows.append(np.full(5, one.facade))
    return np.concatenate(points), np.concatenate(rows)


def point_pairs(points: FacadePoints, correspondences: Correspondences, facades: set[int]) -> tuple[Array, Rows]:
    """All associated points of some facades, in the frame of the body, and their facades."""
    asked = np.isin(correspondences.asked, list(facades))
    which, of = np.nonzero(correspondences.associated[asked])
    return points.points[of], correspondences.asked[asked][which]


def solve_pairs(
    points: Array,
    rows: Rows,
    walls: WallLines,
    start: Array,
    bounds: Bounds | None,
    prior: PosePrior | None,
    settings: LeastSquaresSettings,
    *,
    robust: float,
) -> BoundedEstimate:
    """Minimize over points and their facades, from a start within the bounds.

    Parameters
    ----------
    points : ndarray, shape (M, 2)
        In the frame of the body, m.
    rows : ndarray of int, shape (M,)
        Facade of each.
    walls, start, bounds, prior, settings
        As in :func:`estimate_in_bounds`.
    robust : float
        Threshold of the Cauchy loss, in standard deviations.
    """
    problem = WallProblem(
        points, rows, walls, prior, point_sigma=settings.point_sigma, robust=robust, weight=settings.information,
        map_sigmas=(settings.shift_sigma, settings.vertex_sigma),
    )  # fmt: skip
    pose, nuisance = np.array(start, np.float64), np.zeros(problem.unknowns)
    cost = problem.cost(pose, nuisance)
    damping, held, history = settings.initial_damping, 0, list[Iteration]()
    stop = StopReason.MAX_ITERATIONS
    H = np.zeros((3 + problem.unknowns,) * 2)
    for _ in range(settings.max_iterations):
        H, g = problem.linearize(pose, nuisance)
        before, trials, small = cost, 0, False
        while damping <= settings.max_damping:
            trials += 1
            step = -np.linalg.solve(H + np.diag(damping * np.maximum(np.diag(H), 1e-3)), g)
            moved = pose + step[:3]
            if bounds is not None and not bounds.contains(moved):
                held += 1
                damping *= settings.damping_factor
                continue
            trial = problem.cost(moved, nuisance + step[3:])
            if trial <= cost:
                small = float(np.abs(step[:3]).max()) < 1e-6
                pose, nuisance, cost = moved, nuisance + step[3:], trial
                break
            damping *= settings.damping_factor
        else:
            stop = StopReason.MAX_DAMPING
            break
        history.append(Iteration(0.0, cost, damping, trials))
        damping = max(damping / settings.damping_factor, settings.initial_damping)
        if small or before - cost < settings.tolerance:
            stop = StopReason.SMALL_STEP if small else StopReason.CONVERGED
            break
    pose[2] = wrap(pose[2]) if bounds is None else pose[2]
    residuals = problem.residuals(pose, np.zeros(problem.unknowns))[0]
    return BoundedEstimate(pose, _covariance(H, pose[2]), cost, tuple(history), stop, bounds, held, residuals)


def _covariance(H: Array, heading: float) -> Array:
    """Of the pose, in the tangent space of the body: nuisances are eliminated."""
    cross = H[:3, 3:]
    information = H[:3, :3] - (cross @ np.linalg.solve(H[3:, 3:], cross.T) if cross.size else 0.0)
    turn = np.eye(3)
    turn[:2, :2] = se2.rotation(heading)
    values, vectors = np.linalg.eigh(turn.T @ information @ turn)
    with np.errstate(divide="ignore"):
        spread = np.where(values > 1e-9, 1.0 / np.maximum(values, 1e-300), 1e9)
    return np.asarray((vectors * spread) @ vectors.T)
