"""Wall problem: distances of points from their walls as a sum of squares, with the errors of the map as unknowns."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from factorloc.factors.prior import PosePrior
from factorloc.geometry import se2, wrap
from factorloc.localization.wall_lines import WallLines

__all__ = ["WallProblem"]

Array = npt.NDArray[np.float64]


class WallProblem:
    """Unknowns: the pose in the world's coordinates, a shift of each building, offset and turn of each facade.

    Parameters
    ----------
    points : ndarray, shape (M, 2)
        In the frame of the body, m.
    rows : ndarray of int, shape (M,)
        Facade of each.
    walls : WallLines
        The map.
    prior : PosePrior, optional
        What else is known.
    point_sigma : float
        Standard deviation of a point's distance from its wall, m.
    robust : float
        Threshold of the Cauchy loss, in standard deviations.
    weight : float
        Of a point.
    map_sigmas : (float, float)
        Standard deviations of shifts and of vertex errors, as parts of their greatest values.
    """

    def __init__(
        self,
        points: Array,
        rows: npt.NDArray[np.int64],
        walls: WallLines,
        prior: PosePrior | None,
        *,
        point_sigma: float,
        robust: float,
        weight: float,
        map_sigmas: tuple[float, float],
    ) -> None:
        self.points = points
        facades, self.of = np.unique(rows, return_inverse=True)
        buildings, owner = np.unique(walls.facades.buildings[facades], return_inverse=True)
        self.normals, self.along, self.centres = walls.normals[facades], walls.along[facades], walls.centres[facades]
        self.count, self.buildings = len(facades), len(buildings)
        self.unknowns = 2 * self.buildings + 2 * self.count
        self.sigma, self.robust, self.weight = point_sigma, robust, weight
        shifts = np.zeros(self.buildings)
        shifts[owner] = walls.facades.shifts[facades]
        vertex = map_sigmas[1] * walls.facades.vertex_errors[facades]
        sigmas = np.concatenate([
            np.repeat(map_sigmas[0] * shifts, 2),
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
        """Robust half sum of squares, priors included."""
        r = self.residuals(pose, nuisance)[0] / self.sigma
        c2 = self.robust**2
        away = self._from_prior(pose)
        return float(
            0.5 * self.weight * c2 * np.log1p(r * r / c2).sum()
            + 0.5 * (self.confidence * nuisance**2).sum()
            + 0.5 * away @ self.information @ away
        )

    def linearize(self, pose: Array, nuisance: Array) -> tuple[Array, Array]:
        """Normal matrix and gradient of the cost."""
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
