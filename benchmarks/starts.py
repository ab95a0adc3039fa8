"""Starts: poses beside those that are to be found."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from factorloc.geometry import se3

__all__ = ["displaced", "random_starts"]

Array = npt.NDArray[np.float64]


def displaced(poses: npt.ArrayLike, offset: npt.ArrayLike, turn: npt.ArrayLike) -> Array:
    """Move and turn poses in their own frames.

    Parameters
    ----------
    poses : array_like, shape (..., 4, 4)
        ``T_map_body``.
    offset, turn : array_like, shape (..., 3)
        Translation, m, and rotation vector, rad.
    """
    vectors = np.asarray(turn, np.float64)
    motion = se3.exp(np.concatenate([vectors, np.zeros_like(vectors)], -1))
    motion[..., :3, 3] = offset
    return se3.compose(poses, motion)


def random_starts(poses: Array, position: float, angle: float, tilt: float, rng: np.random.Generator) -> Array:
    """Move each pose in a random horizontal direction, and turn it to a random side.

    Parameters
    ----------
    poses : ndarray, shape (Q, 4, 4)
        ``T_map_body``.
    position, angle : float
        Horizontal offset, m, and yaw, rad.
    tilt : float
        Vertical offset as a share of the horizontal one, roll and pitch as shares of the yaw, each to a random side.
    rng : numpy.random.Generator
        Source of the directions.
    """
    n = len(poses)
    bearing, side = rng.uniform(-np.pi, np.pi, n), rng.choice([-1.0, 1.0], (n, 4))
    offset = position * np.stack([np.cos(bearing), np.sin(bearing), tilt * side[:, 0]], -1)
    return displaced(poses, offset, angle * side[:, 1:] * [tilt, tilt, 1.0])
