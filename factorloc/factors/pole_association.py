"""Association: which landmark each pole of a local map is, as policies that are passed in."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree
from scipy.stats import chi2

from factorloc.factors.pole_detections import PoleDetections, PoleLandmarks, PoleMixture
from factorloc.factors.pole_term import PoleTerm
from factorloc.geometry import se2
from factorloc.mapping.poles import Poles

__all__ = ["JointCompatibility", "MaxMixture", "NearestNeighbour", "PoleAssociation"]

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]


class PoleAssociation(Protocol):
    """Names the landmark of each detection at a pose."""

    def associate(self, detections: Poles, landmarks: PoleLandmarks, T_map_body: Array) -> Index:
        """Associate.

        Parameters
        ----------
        detections : Poles
            In the frame of the body, K of them.
        landmarks : PoleLandmarks
            The map.
        T_map_body : ndarray, shape (3,)
            Pose.

        Returns
        -------
        ndarray of int64, shape (K,)
            Rows of landmarks; -1 for detections that are in no map.
        """
        ...


@dataclass(frozen=True)
class NearestNeighbour:
    """The nearest landmark within a gate; two detections may share it, as in the thesis (section 12.4.3).

    Parameters
    ----------
    gate : float
        m.
    """

    gate: float = 1.0

    def associate(self, detections: Poles, landmarks: PoleLandmarks, T_map_body: Array) -> Index:
        """Associate; see :class:`PoleAssociation`."""
        if len(detections) == 0 or len(landmarks) == 0:
            return np.full(len(detections), -1, np.int64)
        places = se2.transform(T_map_body, detections.positions)
        distances, rows = cKDTree(landmarks.poles.positions).query(places, distance_upper_bound=self.gate)
        return np.where(np.isfinite(distances), rows, -1).astype(np.int64)


@dataclass(frozen=True)
class MaxMixture:
    """The likeliest of all landmarks and of none, by position, width, height, score and trust.

    Parameters
    ----------
    mixture : PoleMixture
        The model.
    """

    mixture: PoleMixture = field(default_factory=PoleMixture)

    def associate(self, detections: Poles, landmarks: PoleLandmarks, T_map_body: Array) -> Index:
        """Associate; see :class:`PoleAssociation`."""
        if len(detections) == 0 or len(landmarks) == 0:
            return np.full(len(detections), -1, np.int64)
        term = PoleTerm(PoleDetections.of([detections]), landmarks, self.mixture, blurs=(0.0,))
        return term.matches(T_map_body[None])[0]


@dataclass(frozen=True)
class JointCompatibility:
    """The most pairs that are compatible all together (Neira and Tardos 2001), by branch and bound.

    A wrong pose moves all detections of a local map alike. Pairs are judged jointly, with the covariance that they
    share by the pose: where each of them alone fits some landmark, together only one set fits. No landmark is given
    twice.

    Parameters
    ----------
    covariance : ndarray, shape (3, 3)
        Of the pose, in the tangent space of the body.
    sigma : float
        Standard deviation of a detection against its landmark, m.
    confidence : float
        Probability with which right pairs pass.
    most_nodes : int
        Pairings that are tried at most; the best of them counts.
    """

    covariance: Array
    sigma: float = 0.15
    confidence: float = 0.99
    most_nodes: int = 20_000

    def associate(self, detections: Poles, landmarks: PoleLandmarks, T_map_body: Array) -> Index:
        """Associate; see :class:`PoleAssociation`."""
        found = np.full(len(detections), -1, np.int64)
        if len(detections) == 0 or len(landmarks) == 0:
            return found
        pose, z = se2.as_poses(T_map_body), detections.positions
        turned = np.stack([-z[:, 1], z[:, 0]], -1)
        R = se2.rotation(pose[2])
        jacobians = np.zeros((len(z), 2, 3))
        jacobians[:, :, :2], jacobians[:, :, 2] = R, turned @ R.T
        places = se2.transform(pose, z)
        alone = jacobians @ self.covariance @ np.swapaxes(jacobians, 1, 2) + self.sigma**2 * np.eye(2)
        gate = float(chi2.ppf(self.confidence, 2))
        reach = np.sqrt(gate * np.linalg.eigvalsh(alone)[:, -1])
        near = cKDTree(landmarks.poles.positions).query_ball_point(places, reach)
        choices: list[list[tuple[int, Array]]] = []
        for k, rows in enumerate(near):
            offsets = {row: landmarks.poles.positions[row] - places[k] for row in rows}
            whitened = np.linalg.inv(alone[k])
            costs = {row: float(d @ whitened @ d) for row, d in offsets.items()}
            choices.append([(row, offsets[row]) for row in sorted(costs, key=costs.__getitem__) if costs[row] <= gate])
        search = _Search(choices, jacobians, self.covariance, self.sigma, self.confidence, self.most_nodes)
        search.descend(0, [], [])
        for k, row in search.best:
            found[k] = row
        return found


class _Search:
    """Depth first, the nearest landmark first; a branch that cannot beat the best is left."""

    def __init__(
        self,
        choices: list[list[tuple[int, Array]]],
        jacobians: Array,
        covariance: Array,
        sigma: float,
        confidence: float,
        most_nodes: int,
    ) -> None:
        self.choices, self.jacobians, self.covariance, self.sigma = choices, jacobians, covariance, sigma
        self.gates = np.atleast_1d(chi2.ppf(confidence, 2 * np.arange(1, len(choices) + 1)))
        self.left = most_nodes
        self.best: list[tuple[int, int]] = []
        self.best_distance = np.inf

    def descend(self, k: int, pairs: list[tuple[int, int]], offsets: list[Array]) -> None:
        """Pair detection k and all after it."""
        if k == len(self.choices):
            distance = self._distance(pairs, offsets)
            if len(pairs) > len(self.best) or (len(pairs) == len(self.best) and distance < self.best_distance):
                self.best, self.best_distance = list(pairs), distance
            return
        taken = {row for _, row in pairs}
        for row, offset in self.choices[k]:
            if self.left <= 0:
                break
            if row in taken:
                continue
            self.left -= 1
            now, their = [*pairs, (k, row)], [*offsets, offset]
            if self._distance(now, their) <= self.gates[len(now) - 1]:
                self.descend(k + 1, now, their)
        if len(pairs) + len(self.choices) - k - 1 >= len(self.best):
            self.descend(k + 1, pairs, offsets)

    def _distance(self, pairs: list[tuple[int, int]], offsets: list[Array]) -> float:
        """Squared Mahalanobis distance of all pairs together."""
        if not pairs:
            return 0.0
        J = self.jacobians[[k for k, _ in pairs]].reshape(-1, 3)
        S = J @ self.covariance @ J.T + self.sigma**2 * np.eye(len(J))
        e = np.concatenate(offsets)
        return float(e @ np.linalg.solve(S, e))
