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

from factorloc.factors.prior import PosePrior
from factorloc.geometry import se2, wrap
from factorloc.localization.correspondence import Correspondences
from factorloc.localization.least_squares_settings import LeastSquaresSettings
from factorloc.localization.line_gate import line_points, lines_expected
from factorloc.localization.wall_belief import WallBelief
from factorloc.localization.wall_lines import WallLines
from factorloc.localization.wall_problem import WallProblem
from factorloc.mapping.facade_points import FacadePoints
from factorloc.result import Bounds, Iteration, StopReason

__all__ = ["BoundedEstimate", "estimate_in_bounds", "point_pairs", "solve_pairs"]

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]


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
    belief : WallBelief
        What is known now of the pose and of the map.
    """

    pose: Array
    covariance: Array
    cost: float
    history: tuple[Iteration, ...]
    stop: StopReason
    bounds: Bounds | None
    held: int
    residuals: Array
    belief: WallBelief


def estimate_in_bounds(
    points: FacadePoints,
    correspondences: Correspondences,
    walls: WallLines,
    start: npt.ArrayLike,
    bounds: Bounds | None,
    *,
    conflicts: Sequence[int] = (),
    prior: PosePrior | WallBelief | None = None,
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
    prior : PosePrior or WallBelief, optional
        What else is known; lines that are not where it has them are left out.
    settings : LeastSquaresSettings, optional
        See there.
    """
    settings = settings or LeastSquaresSettings()
    kept = [one for one in correspondences.found if one.facade not in conflicts]
    known = WallBelief.from_prior(prior) if isinstance(prior, PosePrior) else prior
    trusted = [one for one in kept if one.doubt <= settings.most_doubt]
    kept = trusted if trusted or prior is not None else kept
    pose = np.array(start, np.float64) if bounds is None else bounds.nearest(start)
    if known is not None and kept:
        near = lines_expected(kept, walls, known, settings)
        kept = [one for one, expected in zip(kept, near, strict=True) if expected]
    if kept:
        lines, rows = line_points(kept)
        for robust in _widths(known, settings):
            pose = solve_pairs(lines, rows, walls, pose, bounds, known, settings, robust=robust).pose
    pairs, rows = point_pairs(points, correspondences, {one.facade for one in kept})
    return solve_pairs(pairs, rows, walls, pose, bounds, known, settings, robust=settings.cauchy)


def _widths(known: WallBelief | None, settings: LeastSquaresSettings) -> tuple[float, ...]:
    """Thresholds for the lines: no wider ones than a belief has the pose uncertain."""
    least = min(settings.line_cauchy)
    if known is None:
        return settings.line_cauchy
    spread = math.sqrt(float(np.linalg.eigvalsh(known.covariance[:2, :2])[1]))
    return tuple(
        one for one in settings.line_cauchy if one <= max(settings.gate * spread / settings.point_sigma, least)
    )


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
    prior: WallBelief | None,
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
        points, rows, walls, start, prior, point_sigma=settings.point_sigma, robust=robust, weight=settings.information,
        map_sigmas=(settings.shift_sigma, settings.vertex_sigma), surface=settings.surface_sigma,
    )  # fmt: skip
    pose, nuisance = np.array(start, np.float64), problem.start()
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
    return BoundedEstimate(
        pose, _covariance(H, pose[2]), cost, tuple(history), stop, bounds, held, residuals,
        problem.belief(pose, nuisance, H),
    )  # fmt: skip


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
