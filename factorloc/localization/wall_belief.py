"""Wall belief: a pose and the errors of the map around it, known together.

The errors of a building and of its walls are the same for every scan. Estimated anew with each, they would count as
often as they were seen, and ten scans of one wall would be trusted like ten walls; so a drive carries them along with
its pose.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from factorloc.factors.prior import PosePrior
from factorloc.geometry import se2, wrap
from factorloc.result import Bounds

__all__ = ["WallBelief"]

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class WallBelief:
    """Gaussian belief in the coordinates of the map.

    Parameters
    ----------
    pose : ndarray, shape (3,)
        ``T_map_body``.
    buildings : ndarray of int, shape (B,)
        Whose shifts are known too, ascending.
    facades : ndarray of int, shape (F,)
        Whose offsets and turns are, ascending.
    errors : ndarray, shape (2 B + 2 F,)
        Of the map: shifts from it to the truth, building by building, offsets along the normals of facades (m), and
        their turns (rad).
    covariance : ndarray, shape (3 + 2 B + 2 F,) * 2
        Of x, y, theta and these.
    """

    pose: Array
    buildings: Rows
    facades: Rows
    errors: Array
    covariance: Array

    @classmethod
    def from_prior(cls, prior: PosePrior) -> WallBelief:
        """Belief of a pose alone."""
        turn = np.eye(3)
        turn[:2, :2] = se2.rotation(prior.pose[2])
        return cls.of_pose(prior.pose, turn @ prior.covariance @ turn.T)

    @classmethod
    def of_pose(cls, pose: Array, covariance: Array) -> WallBelief:
        """Belief of a pose alone, with its covariance in the coordinates of the map."""
        none = np.empty(0, np.int64)
        return cls(pose, none, none, np.empty(0), covariance)

    @classmethod
    def within_bounds(cls, bounds: Bounds, pose: npt.ArrayLike) -> WallBelief:
        """A pose of which no more is known than that it is within some bounds."""
        sizes = np.array([*np.ptp(np.concatenate(bounds.polygons), axis=0), np.ptp(bounds.orientation)])
        # Of what is uniform between limits.
        return cls.of_pose(np.asarray(pose, np.float64), np.diag(np.maximum(sizes / math.sqrt(12.0), 1e-6) ** 2))

    @property
    def pose_covariance(self) -> Array:
        """Of the pose, in the tangent space of the body, shape (3, 3)."""
        turn = np.eye(3)
        turn[:2, :2] = se2.rotation(self.pose[2])
        own = turn.T @ self.covariance[:3, :3] @ turn
        return np.asarray(0.5 * (own + own.T))

    def moved(self, motion: npt.ArrayLike, sigmas: npt.ArrayLike) -> WallBelief:
        """After a motion ``T_before_after`` with independent errors of x, y (m) and theta (rad)."""
        move, noise = np.asarray(motion, np.float64), np.asarray(sigmas, np.float64) ** 2
        R = se2.rotation(self.pose[2])
        way = R @ move[:2]
        J = np.eye(len(self.covariance))
        J[0, 2], J[1, 2] = -way[1], way[0]
        covariance = J @ self.covariance @ J.T
        covariance[:2, :2] += R @ np.diag(noise[:2]) @ R.T
        covariance[2, 2] += noise[2]
        return replace(self, pose=se2.compose(self.pose, move), covariance=covariance)

    def at(self, pose: npt.ArrayLike) -> WallBelief:
        """Held at another pose, as bounds ask for: uncertain by what it was off, too."""
        place, away = np.asarray(pose, np.float64), self._offset_to(pose)
        covariance = self.covariance.copy()
        covariance[:3, :3] += np.outer(away, away)
        return replace(self, pose=place, covariance=covariance)

    def sigmas_to(self, pose: npt.ArrayLike) -> float:
        """How many standard deviations of the pose another one is away."""
        away = self._offset_to(pose)
        # Rounding may leave a square just below zero.
        return math.sqrt(max(float(away @ np.linalg.solve(self.covariance[:3, :3], away)), 0.0))

    def _offset_to(self, pose: npt.ArrayLike) -> Array:
        away = np.asarray(pose, np.float64) - self.pose
        away[2] = wrap(away[2])
        return away

    def limited_to(self, buildings: Rows, facades: Rows) -> WallBelief:
        """Of some buildings and facades only; what is known of the pose and of them stays."""
        some, parts = np.isin(self.buildings, buildings), np.isin(self.facades, facades)
        rows = np.concatenate([np.repeat(some, 2), parts, parts])
        kept = np.concatenate([np.ones(3, np.bool_), rows])
        return WallBelief(
            self.pose, self.buildings[some], self.facades[parts], self.errors[rows], self.covariance[np.ix_(kept, kept)]
        )
