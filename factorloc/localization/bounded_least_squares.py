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
from factorloc.localization.correspondences import Correspondence, Correspondences
from factorloc.localization.wall_lines import WallLines
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
    problem = _Problem(points, rows, walls, prior, settings, robust)
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


class _Problem:
    """Unknowns: the pose in the world's coordinates, a shift of each building, offset and turn of each facade."""

    def __init__(
        self, points: Array, rows: Rows, walls: WallLines, prior: PosePrior | None, settings: LeastSquaresSettings,
        robust: float,
    ) -> None:  # fmt: skip
        self.points = points
        facades, self.of = np.unique(rows, return_inverse=True)
        buildings, owner = np.unique(walls.facades.buildings[facades], return_inverse=True)
        self.normals, self.along, self.centres = walls.normals[facades], walls.along[facades], walls.centres[facades]
        self.count, self.buildings = len(facades), len(buildings)
        self.unknowns = 2 * self.buildings + 2 * self.count
        self.sigma, self.robust, self.weight = settings.point_sigma, robust, settings.information
        shifts = np.zeros(self.buildings)
        shifts[owner] = walls.facades.shifts[facades]
        vertex = settings.vertex_sigma * walls.facades.vertex_errors[facades]
        sigmas = np.concatenate([
            np.repeat(settings.shift_sigma * shifts, 2),
            vertex / math.sqrt(2.0),
            math.sqrt(2.0) * vertex / walls.facades.lengths[facades],
        ])  # fmt: skip
        self.confidence = 1.0 / np.maximum(sigmas, 1e-4) ** 2
        # How 1, the derivative by the heading and the way along a facade enter the unknowns, for each facade.
        self.spread = np.zeros((self.count, 3, 3 + self.unknowns))
        k = np.arange(self.count)
        self.spread[k, 0, :2] = self.normals
        self.spread[:, 1, 2] = 1.0
        for axis in range(2):
            self.spread[k, 0, 3 + 2 * owner + axis] = -self.normals[:, axis]
        self.spread[k, 0, 3 + 2 * self.buildings + k] = -1.0
        self.spread[k, 2, 3 + 2 * self.buildings + self.count + k] = -1.0
        self.owner = owner
        self.mean, self.information = np.zeros(3), np.zeros((3, 3))
        if prior is not None:
            turn = np.eye(3)
            turn[:2, :2] = se2.rotation(prior.pose[2])
            self.mean, self.information = prior.pose, turn @ prior.information @ turn.T

    def residuals(self, pose: Array, nuisance: Array) -> tuple[Array, Array, Array]:
        """Distances, their derivatives by the heading, and ways along the facades."""
        c, s = math.cos(pose[2]), math.sin(pose[2])
        x, y = c * self.points[:, 0] - s * self.points[:, 1], s * self.points[:, 0] + c * self.points[:, 1]
        n, u, of = self.normals, self.along, self.of
        shift = pose[:2] - self.centres
        shifts = nuisance[: 2 * self.buildings].reshape(-1, 2)[self.owner]
        offset = (n * (shift - shifts)).sum(1) - nuisance[2 * self.buildings : 2 * self.buildings + self.count]
        turns = nuisance[2 * self.buildings + self.count :]
        nx, ny = n[of, 0], n[of, 1]
        along = u[of, 0] * x + u[of, 1] * y + (u * shift).sum(1)[of]
        r = nx * x + ny * y + offset[of] - turns[of] * along
        return r, ny * x - nx * y, along

    def cost(self, pose: Array, nuisance: Array) -> float:
        r = self.residuals(pose, nuisance)[0] / self.sigma
        c2 = self.robust**2
        away = self._from_prior(pose)
        return float(
            0.5 * self.weight * c2 * np.log1p(r * r / c2).sum()
            + 0.5 * (self.confidence * nuisance**2).sum()
            + 0.5 * away @ self.information @ away
        )

    def linearize(self, pose: Array, nuisance: Array) -> tuple[Array, Array]:
        r, turn, along = self.residuals(pose, nuisance)
        z = r / self.sigma
        w = self.weight / (self.sigma**2 * (1.0 + z * z / self.robust**2))
        basis = (np.ones_like(r), turn, along)
        M, v = np.empty((self.count, 3, 3)), np.empty((self.count, 3))
        for i in range(3):
            weighted = w * basis[i]
            v[:, i] = np.bincount(self.of, weighted * r, self.count)
            for j in range(i, 3):
                M[:, i, j] = M[:, j, i] = np.bincount(self.of, weighted * basis[j], self.count)
        flat = self.spread.reshape(-1, self.spread.shape[2])
        H = flat.T @ (M @ self.spread).reshape(flat.shape)
        g = flat.T @ v.ravel()
        H[np.arange(3, len(H)), np.arange(3, len(H))] += self.confidence
        g[3:] += self.confidence * nuisance
        H[:3, :3] += self.information
        g[:3] += self.information @ self._from_prior(pose)
        return H, g

    def _from_prior(self, pose: Array) -> Array:
        away = pose - self.mean
        away[2] = wrap(away[2])
        return np.asarray(away)


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
