"""A street with poles on both sides, and what a vehicle sees of them."""

from dataclasses import dataclass

import numpy as np

from factorloc.factors import PoleLandmarks
from factorloc.geometry import se2
from factorloc.localization.pole_search import dead_reckoned
from factorloc.mapping.poles import Poles

SIGMAS = np.array([0.01, 0.005, 0.003])
"""Of a motion of one metre: m, m, rad."""


@dataclass(frozen=True)
class PoleStreet:
    """Landmarks of the map, where they truly are, and a drive along them."""

    mapped: np.ndarray
    there: np.ndarray
    truth: np.ndarray
    motions: np.ndarray
    covariances: np.ndarray
    local_maps: list[Poles]

    @property
    def landmarks(self) -> PoleLandmarks:
        return PoleLandmarks(poles_at(self.mapped))


def poles_at(positions: np.ndarray) -> Poles:
    n = len(positions)
    return Poles(positions, np.full(n, 0.2), np.tile([0.0, 3.0], (n, 1)), np.full(n, 0.8))


def make_street(
    *, length: int = 300, bare: tuple[float, float] | None = None, row_shift: float | None = None, seed: int = 0,
    scale: float = 1.0, every: int = 2,
) -> PoleStreet:  # fmt: skip
    """Poles every 8 m or so on both sides, none within ``bare``; there, a row that was moved sideways, if asked."""
    rng = np.random.default_rng(seed)
    turns = 0.02 * np.sin(np.arange(length) / 25.0)
    truth = dead_reckoned(np.zeros(3), np.column_stack([np.ones(length), np.zeros(length), turns]))
    places, moved = [], []
    for side in (6.0, -7.0):
        for s in np.arange(3.0, length, 8.0) + rng.uniform(-2.5, 2.5, len(np.arange(3.0, length, 8.0))):
            k = int(np.clip(s, 0, length))
            if bare is None or not bare[0] <= s <= bare[1]:
                places.append(se2.transform(truth[k], [s - k, side + rng.uniform(-1, 1)]))
                moved.append(np.zeros(2))
    if bare is not None and row_shift is not None:
        across = se2.rotate(truth[int(np.mean(bare)), 2], [0.0, 1.0])
        for s in np.arange(bare[0] + 2, bare[1] - 1, 3.0):
            k = int(s)
            places.append(se2.transform(truth[k], [s - k, -5.0]))
            moved.append(row_shift * across)
    there = np.array(places) + np.array(moved)
    mapped = np.array(places) + rng.normal(0, 0.04, (len(places), 2))
    motions = se2.between(truth[:-1], truth[1:])
    noisy = se2.compose(motions, se2.exp(rng.normal(0, 1, motions.shape) * SIGMAS))
    noisy[:, :2] *= scale
    covariances = np.tile(np.diag(SIGMAS**2), (length, 1, 1))
    local_maps = []
    for k, pose in enumerate(truth):
        seen = se2.transform(se2.inverse(pose), there)
        seen = seen[(np.abs(seen) < 14).all(1) & (rng.random(len(seen)) < 0.7)]
        seen = seen + rng.normal(0, 0.06, seen.shape)
        clutter = rng.uniform(-14, 14, (rng.poisson(1.0), 2))
        local_maps.append(poles_at(np.concatenate([seen, clutter])) if k % every == 0 else Poles.none())
    return PoleStreet(mapped, there, truth, noisy, covariances, local_maps)


def position_errors(poses: np.ndarray, truth: np.ndarray) -> np.ndarray:
    return np.hypot(*(poses[:, :2] - truth[:, :2]).T)
