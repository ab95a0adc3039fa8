"""Registration: one scan, or many guesses of it at once, brought into a map from coarse to fine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc._jit import in_threads
from factorloc.config import Block
from factorloc.errors import GeometryError
from factorloc.factors.grid_scan_term import GridScanTerm
from factorloc.factors.prior import PosePrior
from factorloc.geometry import se2
from factorloc.localization._registration_kernels import register_batch

__all__ = ["Registration", "RegistrationSettings", "register"]

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
        A level ends when an accepted step lowers the cost by less.
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
    poses : ndarray, shape (B, 3)
        Registered poses ``T_map_body``.
    costs : ndarray, shape (B,)
        Scan cost plus prior at the last level.
    hessians : ndarray, shape (B, 3, 3)
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


def register(
    term: GridScanTerm,
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
    term : GridScanTerm
        Measurement model of one or more scans.
    guesses : array_like, shape (B, 3)
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
        If a guess is not a finite planar pose, or names a scan or level that does not exist.
    """
    settings = settings or RegistrationSettings()
    poses = se2.as_poses(guesses, "guesses")
    if poses.ndim != 2:
        raise GeometryError(f"guesses: shape {poses.shape}; expected rows [x, y, theta]")
    n = len(poses)
    scan = np.zeros(n, np.int64) if scan_of_guess is None else np.ascontiguousarray(scan_of_guess, np.int64)
    if scan.shape != (n,) or (n and not 0 <= scan.min() <= scan.max() < term.scans):
        raise GeometryError(f"scan_of_guess: expected {n} indices below {term.scans}")
    count = len(term.blurs)
    through = np.arange(count) if levels is None else np.array(levels, np.int64)
    if len(through) == 0 or not -count <= through.min() <= through.max() < count:
        raise GeometryError(f"levels: {through.tolist()}; expected at least one, the map has {count}")
    through %= count
    mean, world = (np.zeros(3), np.zeros((3, 3))) if prior is None else (prior.pose, _in_world(prior))
    costs, hessians = np.empty(n), np.empty((n, 3, 3))
    trials, converged = np.empty(n, np.int64), np.empty(n, np.bool_)
    rays = term.rays
    blurs, limits = np.array(term.blurs), settings.limits

    def descend(first: int, last: int) -> None:
        part = slice(first, last)
        register_batch(
            term.model, poses[part], scan[part], rays.origins, rays.directions, rays.ranges, rays.offsets,
            term.primary, term.secondary, term.numbers, blurs, through, *term.layout, term.information, mean, world,
            limits, costs[part], hessians[part], trials[part], converged[part],
        )  # fmt: skip

    in_threads(descend, n)
    return Registration(poses, costs, hessians, trials, converged)


def _in_world(prior: PosePrior) -> Array:
    """Information of a prior by the world's coordinates: in them the prior is quadratic everywhere."""
    turn = np.eye(3)
    turn[:2, :2] = se2.rotation(prior.pose[2])
    return np.asarray(turn @ prior.information @ turn.T)
