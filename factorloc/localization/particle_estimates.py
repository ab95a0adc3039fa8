"""Estimates: one pose for many particles, and how sure it is."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from factorloc.geometry import wrap
from factorloc.localization.kld import PoseBins
from factorloc.localization.particles import Particles

__all__ = ["ParticleEstimates", "PoseEstimate", "mean_pose"]

Array = npt.NDArray[np.float64]

_HEAVIEST = 32  # bins that may be the middle of the densest cluster
_MEAN_STEPS = 30
_MEAN_TOLERANCE = 1e-12  # rad


@dataclass(frozen=True)
class PoseEstimate:
    """Mean pose of some particles.

    Parameters
    ----------
    pose : ndarray, shape (3,) or (4, 4)
        ``T_map_body``.
    covariance : ndarray, shape (3, 3) or (6, 6)
        Second moments of the particles about the pose, in the tangent space of its body; zero for a single one.
    mass : float
        Weight of those particles among all, 0 to 1.
    """

    pose: Array
    covariance: Array
    mass: float

    @classmethod
    def of(cls, particles: Particles, mass: float = 1.0) -> PoseEstimate:
        """Make it of all particles."""
        pose = mean_pose(particles.poses, particles.weights)
        tangents = particles.group.log(particles.group.between(pose, particles.poses))
        covariance = (tangents * particles.weights[:, None]).T @ tangents
        return cls(pose, (covariance + covariance.T) / 2, mass)


@dataclass(frozen=True)
class ParticleEstimates:
    """What particles say of the pose, made when it is asked for.

    Parameters
    ----------
    particles : Particles
        After reweighting.
    bins : PoseBins
        What a cluster is made of.
    """

    particles: Particles
    bins: PoseBins

    @classmethod
    def of(cls, particles: Particles, bins: PoseBins) -> ParticleEstimates:
        """Make it; the same as calling the class."""
        return cls(particles, bins)

    @cached_property
    def mean(self) -> PoseEstimate:
        """Weighted mean of all: best where the belief has one peak."""
        return PoseEstimate.of(self.particles)

    @cached_property
    def best(self) -> PoseEstimate:
        """Weighted mean of the tenth of the particles with the most weight."""
        heavy = np.argsort(-self.particles.log_weights, kind="stable")[: -(-len(self.particles) // 10)]
        return _of_some(self.particles, heavy)

    @cached_property
    def mode(self) -> PoseEstimate:
        """Weighted mean of the densest cluster: of the heaviest bin, counted with the bins around it.

        Its mass says how much of the belief is there.
        """
        return _of_some(self.particles, _densest(self.particles, self.bins))

    @property
    def effective_size(self) -> float:
        """Effective number of the particles."""
        return self.particles.effective_size


def mean_pose(poses: npt.ArrayLike, weights: npt.ArrayLike) -> Array:
    """Weighted mean of poses.

    Positions have their mean. Headings have the direction of their mean unit vector (that of the heaviest pose where
    they cancel); rotations the Frechet mean of SO(3), iterated from the mean that minimizes squared chords. Together
    that is the Frechet mean of the metric that adds squared distances and squared angles; SE(3) has no metric that both
    sides leave alone.

    Parameters
    ----------
    poses : array_like, shape (P, 3) or (P, 4, 4)
        Poses.
    weights : array_like, shape (P,)
        Weights that add up to one.

    Returns
    -------
    ndarray, shape (3,) or (4, 4)
    """
    array, w = np.asarray(poses, np.float64), np.asarray(weights, np.float64)
    if array.ndim == 2:
        c, s = w @ np.cos(array[:, 2]), w @ np.sin(array[:, 2])
        heading = np.arctan2(s, c) if np.hypot(c, s) > 1e-12 else array[int(np.argmax(w)), 2]
        return np.array([*(w @ array[:, :2]), float(wrap(heading))])
    used = w > 0
    rotations, w = Rotation.from_matrix(array[used, :3, :3]), w[used]
    mean = rotations.mean(w)
    for _ in range(_MEAN_STEPS):
        step = w @ (mean.inv() * rotations).as_rotvec()
        mean = mean * Rotation.from_rotvec(step)
        if np.linalg.norm(step) < _MEAN_TOLERANCE:
            break
    pose = np.eye(4)
    pose[:3, :3] = mean.as_matrix()
    pose[:3, 3] = w @ array[used, :3, 3]
    return pose


def _of_some(particles: Particles, rows: npt.NDArray[np.int64]) -> PoseEstimate:
    some = Particles(particles.poses[rows], particles.log_weights[rows])
    return PoseEstimate.of(some, min(float(particles.weights[rows].sum()), 1.0))


def _densest(particles: Particles, bins: PoseBins) -> npt.NDArray[np.int64]:
    """Particles of the heaviest neighbourhood of bins."""
    index = bins.index(particles.poses)
    _, first, inverse = np.unique(bins.number(particles.poses), return_index=True, return_inverse=True)
    mass = np.bincount(inverse.ravel(), particles.weights)
    places = index[first]
    heaviest = np.argsort(-mass, kind="stable")[:_HEAVIEST]
    around = np.array([mass[_adjoining(places, places[b], bins.headings)].sum() for b in heaviest])
    return np.flatnonzero(_adjoining(index, places[heaviest[int(np.argmax(around))]], bins.headings))


def _adjoining(index: npt.NDArray[np.int64], middle: npt.NDArray[np.int64], headings: int) -> npt.NDArray[np.bool_]:
    """Which bins touch one, itself among them; headings go round."""
    apart = np.abs(index - middle)
    apart[:, -1] = np.minimum(apart[:, -1], headings - apart[:, -1])
    return np.asarray((apart <= 1).all(1))
