"""Wall problem: distances of points from their walls as a sum of squares, with the errors of the map as unknowns."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from factorloc.geometry import wrap
from factorloc.localization.wall_belief import WallBelief
from factorloc.localization.wall_lines import WallLines

__all__ = ["WallProblem"]

Array = npt.NDArray[np.float64]

_LEAST = 1e-6  # information of what nothing determines, 1/m^2


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
    start : ndarray, shape (3,)
        Where the search begins. How far along its facade a point is, is taken from there and kept: if it followed the
        pose, wrong turns of walls would seem to tell where along them the body is, a little more with every scan.
    prior : WallBelief, optional
        What else is known, of the pose and of buildings; their shifts are unknowns even if no point is on them.
    point_sigma : float
        Standard deviation of a point's distance from its wall, m.
    robust : float
        Threshold of the Cauchy loss, in standard deviations.
    weight : float
        Of a point.
    map_sigmas : (float, float)
        Standard deviations of shifts and of vertex errors, as parts of their greatest values.
    surface : float
        What walls seen by a lidar are off at their ends besides, m: they are not flat.
    """

    def __init__(
        self,
        points: Array,
        rows: npt.NDArray[np.int64],
        walls: WallLines,
        start: Array,
        prior: WallBelief | None,
        *,
        point_sigma: float,
        robust: float,
        weight: float,
        map_sigmas: tuple[float, float],
        surface: float,
    ) -> None:
        self.points = points
        none = np.empty(0, np.int64)
        known = (none, none) if prior is None else (prior.buildings, prior.facades)
        self.facades, of = np.unique(np.concatenate([rows, known[1]]), return_inverse=True)
        self.of = of[: len(rows)]
        facades = self.facades
        self.names, owner = np.unique(np.concatenate([walls.facades.buildings[facades], known[0]]), return_inverse=True)
        owner = owner[: len(facades)]
        self.normals, self.centres = walls.normals[facades], walls.centres[facades]
        self.ways = _ways(points, self.of, walls.along[facades], self.centres, start)
        self.count, self.buildings = len(facades), len(self.names)
        self.unknowns = 2 * self.buildings + 2 * self.count
        self.sigma, self.robust, self.weight = point_sigma, robust, weight
        shifts = np.zeros(self.buildings)
        shifts[owner] = walls.facades.shifts[facades]
        vertex = np.hypot(map_sigmas[1] * walls.facades.vertex_errors[facades], surface)
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
        self.mean, self.information = np.zeros(3 + self.unknowns), np.zeros((3 + self.unknowns,) * 2)
        if prior is not None:
            first = 2 * np.searchsorted(self.names, known[0])
            offset = 2 * self.buildings + np.searchsorted(self.facades, known[1])
            at = np.concatenate([np.stack([first, first + 1], -1).ravel(), offset, offset + self.count])
            self.confidence[at] = 0.0
            at = np.concatenate([np.arange(3), 3 + at]).astype(np.int64)
            self.mean[at] = np.concatenate([prior.pose, prior.errors])
            self.information[np.ix_(at, at)] = np.linalg.inv(prior.covariance)

    def residuals(self, pose: Array, nuisance: Array) -> tuple[Array, Array]:
        """Distances, and their derivatives by the heading."""
        c, s = math.cos(pose[2]), math.sin(pose[2])
        x, y = c * self.points[:, 0] - s * self.points[:, 1], s * self.points[:, 0] + c * self.points[:, 1]
        n, of = self.normals, self.of
        shift = pose[:2] - self.centres
        shifts = nuisance[: 2 * self.buildings].reshape(-1, 2)[self.owner]
        offset = (n * (shift - shifts)).sum(1) - nuisance[2 * self.buildings : 2 * self.buildings + self.count]
        turns = nuisance[2 * self.buildings + self.count :]
        nx, ny = n[of, 0], n[of, 1]
        r = nx * x + ny * y + offset[of] - turns[of] * self.ways
        return r, ny * x - nx * y

    def cost(self, pose: Array, nuisance: Array) -> float:
        """Robust half sum of squares, priors included."""
        r = self.residuals(pose, nuisance)[0] / self.sigma
        c2 = self.robust**2
        away = self._from_prior(pose, nuisance)
        return float(
            0.5 * self.weight * c2 * np.log1p(r * r / c2).sum()
            + 0.5 * (self.confidence * nuisance**2).sum()
            + 0.5 * away @ self.information @ away
        )

    def linearize(self, pose: Array, nuisance: Array) -> tuple[Array, Array]:
        """Normal matrix and gradient of the cost."""
        r, turn = self.residuals(pose, nuisance)
        z = r / self.sigma
        w = self.weight / (self.sigma**2 * (1.0 + z * z / self.robust**2))
        basis = (np.ones_like(r), turn, self.ways)
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
        H += self.information
        g += self.information @ self._from_prior(pose, nuisance)
        return H, g

    def start(self) -> Array:
        """What is known of the errors of the map before."""
        return self.mean[3:].copy()

    def belief(self, pose: Array, nuisance: Array, H: Array) -> WallBelief:
        """What is known of pose and map afterwards, by the normal matrix there."""
        # A pose that nothing determines has a variance that is large, not infinite.
        covariance = np.linalg.inv(0.5 * (H + H.T) + _LEAST * np.eye(len(H)))
        return WallBelief(pose, self.names, self.facades, nuisance, 0.5 * (covariance + covariance.T))

    def _from_prior(self, pose: Array, nuisance: Array) -> Array:
        away = np.concatenate([pose, nuisance]) - self.mean
        away[2] = wrap(away[2])
        return np.asarray(away)


def _ways(points: Array, of: npt.NDArray[np.int64], along: Array, centres: Array, pose: Array) -> Array:
    """How far points are along their facades, from the middle, seen from a pose; shape (M,)."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x, y = c * points[:, 0] - s * points[:, 1], s * points[:, 0] + c * points[:, 1]
    return np.asarray(along[of, 0] * x + along[of, 1] * y + (along * (pose[:2] - centres)).sum(1)[of])
