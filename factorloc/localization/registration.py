"""Registration: one scan, or many guesses of it at once, brought into a map from coarse to fine."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc._jit import in_threads
from factorloc.config import Block
from factorloc.errors import GeometryError, OptimizationError
from factorloc.factors.grid_scan_term import GridScanTerm
from factorloc.factors.prior import PosePrior
from factorloc.factors.spatial_scan_term import SpatialScanTerm
from factorloc.geometry import group_of, se2
from factorloc.localization._registration_kernels import register_batch
from factorloc.localization._spatial_registration_kernels import register_spatial_batch
from factorloc.localization.prepared_map import PreparedMap
from factorloc.result import Iteration, Result, StopReason
from factorloc.scan import Scan
from factorloc.trajectory import Trajectory

__all__ = ["Registration", "RegistrationSettings", "register", "register_many"]

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]


class RegistrationSettings(Block):
    """How a scan is registered.

    Parameters
    ----------
    max_iterations : int
        Trial steps on each level.
    max_translation, max_rotation : float
        Longest step, m and rad.
    tolerance : float
        A level ends when an accepted step lowers the cost by less; in space also by less than 1e-5 of it.
    least_translation : float
        A level ends when a step is shorter, m, and turns by less than half as many radians; on a blurred level, when it
        is shorter than a hundredth of the blur.
    initial_damping : float
        Damping relative to the diagonal of the Hessian.
    """

    max_iterations: int = Field(40, gt=0)
    max_translation: float = Field(1.0, gt=0)
    max_rotation: float = Field(0.2, gt=0)
    tolerance: float = Field(1e-3, ge=0)
    least_translation: float = Field(1e-4, gt=0)
    initial_damping: float = Field(1e-3, gt=0)

    @property
    def limits(self) -> Array:
        """All of them in the order the kernel takes."""
        numbers = [self.max_iterations, self.max_translation, self.max_rotation, self.tolerance]
        return np.array([*numbers, self.least_translation, self.initial_damping], np.float64)


@dataclass(frozen=True)
class Registration:
    """Outcome for B guesses.

    Parameters
    ----------
    poses : ndarray, shape (B, 3) or (B, 4, 4)
        Registered poses ``T_map_body``.
    costs : ndarray, shape (B,)
        Scan cost plus prior at the last level.
    hessians : ndarray, shape (B, 3, 3) or (B, 6, 6)
        Second derivatives of the *scan's* cost there, in the tangent space of the body.
    iterations : ndarray of int, shape (B,)
        Cost evaluations over all levels.
    converged : ndarray of bool, shape (B,)
        Whether the last level met its tolerance.
    """

    poses: Array
    costs: Array
    hessians: Array
    iterations: Index
    converged: npt.NDArray[np.bool_]

    @property
    def best(self) -> int:
        """Row of the lowest cost."""
        return int(np.argmin(self.costs))


def register_many(
    term: GridScanTerm | SpatialScanTerm,
    guesses: npt.ArrayLike,
    scan_of_guess: npt.ArrayLike | None = None,
    *,
    levels: Sequence[int] | None = None,
    prior: PosePrior | None = None,
    settings: RegistrationSettings | None = None,
) -> Registration:
    """Minimize the cost of scans from guesses, through the levels of the map.

    Levenberg and Marquardt's method with damping scaled by the Hessian's diagonal and a step cap; guesses are dealt to
    threads.

    Parameters
    ----------
    term : GridScanTerm or SpatialScanTerm
        Measurement model of one or more scans.
    guesses : array_like, shape (B, 3) or (B, 4, 4)
        Start poses ``T_map_body``.
    scan_of_guess : array_like of int, shape (B,), optional
        Scan of each guess; scan 0 for all by default.
    levels : sequence of int, optional
        Levels of the map to go through; all by default.
    prior : PosePrior, optional
        Belief added to the cost of every guess.
    settings : RegistrationSettings, optional
        Steps and tolerances.

    Raises
    ------
    GeometryError
        If a guess is not a finite pose of the map's dimension, or names a scan or level that does not exist.
    """
    settings = settings or RegistrationSettings()
    spatial = isinstance(term, SpatialScanTerm)
    poses = group_of(3 if spatial else 2).as_poses(guesses, "guesses")
    if poses.ndim != (3 if spatial else 2):
        raise GeometryError(f"guesses: shape {poses.shape}; expected rows, one pose each")
    n = len(poses)
    scan = np.zeros(n, np.int64) if scan_of_guess is None else np.ascontiguousarray(scan_of_guess, np.int64)
    if scan.shape != (n,) or (n and not 0 <= scan.min() <= scan.max() < term.scans):
        raise GeometryError(f"scan_of_guess: expected {n} indices below {term.scans}")
    count = len(term.blurs)
    through = np.arange(count) if levels is None else np.array(levels, np.int64)
    if len(through) == 0 or not -count <= through.min() <= through.max() < count:
        raise GeometryError(f"levels: {through.tolist()}; expected at least one, the map has {count}")
    through %= count
    freedom = 6 if spatial else 3
    costs, hessians = np.empty(n), np.empty((n, freedom, freedom))
    trials, converged = np.empty(n, np.int64), np.empty(n, np.bool_)
    blurs, rays = np.array(term.blurs), term.rays
    block = (rays.origins, rays.directions, rays.ranges, rays.offsets)

    def descend(first: int, last: int) -> None:
        part = slice(first, last)
        written = (settings.limits, costs[part], hessians[part], trials[part], converged[part])
        if isinstance(term, SpatialScanTerm):
            tables = term.tables
            register_spatial_batch(
                poses[part], scan[part], *block, tables.low, tables.directory, tables.primary, tables.secondary,
                tables.tertiary, tables.numbers, blurs, through, term.information, *_spatial(prior), *written,
            )  # fmt: skip
        else:
            register_batch(
                term.model, poses[part], scan[part], *block, term.primary, term.secondary, term.tertiary, term.numbers,
                blurs, through, *term.layout, term.information, *_in_world(prior), *written,
            )  # fmt: skip

    in_threads(descend, n)
    return Registration(poses, costs, hessians, trials, converged)


def register(
    scan: Scan,
    prepared: PreparedMap,
    guess: npt.ArrayLike | PosePrior,
    *,
    settings: RegistrationSettings | None = None,
) -> Result:
    """Bring one scan into a map.

    Parameters
    ----------
    scan : Scan
        Planar or spatial, as the map.
    prepared : PreparedMap
        The map.
    guess : array_like, shape (3,) or (4, 4), or PosePrior
        About where the body is, ``T_map_body``; a prior also holds the pose there.
    settings : RegistrationSettings, optional
        Steps and tolerances.

    Returns
    -------
    Result
        One pose with its covariance; the cost is that of the last level.

    Raises
    ------
    MapError
        If scan and map differ in dimension.
    GeometryError
        If the guess is not one pose, or the scan holds no return.
    OptimizationError
        If the scan does not determine the pose.
    """
    began = time.perf_counter()
    term = prepared.term([scan])
    if len(term.rays.ranges) == 0:
        raise GeometryError("scan: no ray has a return; there is nothing to register")
    prior = guess if isinstance(guess, PosePrior) else None
    start = np.asarray(guess.pose if isinstance(guess, PosePrior) else guess, np.float64)
    levels = prepared.quick_levels
    found = register_many(term, start[None], levels=levels, prior=prior, settings=settings)
    information = found.hessians[0] + (0.0 if prior is None else prior.information)
    try:
        covariance = np.linalg.inv(np.linalg.cholesky(information))
    except np.linalg.LinAlgError as error:
        raise OptimizationError("scan: it does not determine the pose here; give a prior as guess") from error
    covariance = covariance.T @ covariance + prepared.floor
    stop = StopReason.CONVERGED if found.converged[0] else StopReason.MAX_ITERATIONS
    trajectory = Trajectory(np.array([scan.stamp]), found.poses, covariance[None], world=prepared.grid.frame)
    history = (Iteration(term.blurs[-1], float(found.costs[0]), 0.0, int(found.iterations[0])),)
    return Result(
        trajectory,
        float(found.costs[0]),
        history,
        stop,
        {"scan": found.costs.copy()},
        {"rays without return or left out": len(scan) - len(term.rays.ranges)},
        time.perf_counter() - began,
    )


def _in_world(prior: PosePrior | None) -> tuple[Array, Array]:
    """Mean of a planar prior, and its information by the world's coordinates: in them it is quadratic everywhere."""
    if prior is None:
        return np.zeros(3), np.zeros((3, 3))
    turn = np.eye(3)
    turn[:2, :2] = se2.rotation(prior.pose[2])
    return prior.pose, np.asarray(turn @ prior.information @ turn.T)


def _spatial(prior: PosePrior | None) -> tuple[Array, Array]:
    """Mean and information of a prior in space."""
    return (np.eye(4), np.zeros((6, 6))) if prior is None else (prior.pose, prior.information)
