"""PoseGroup: what SE(2) and SE(3) have in common, for code that does not care which of them it moves in."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from factorloc.geometry import se2, se3

__all__ = ["PoseGroup", "group_of", "position_heading"]

Array = npt.NDArray[np.float64]


class PoseGroup(Protocol):
    """The functions of :mod:`factorloc.geometry.se2` and :mod:`factorloc.geometry.se3`."""

    def as_poses(self, poses: npt.ArrayLike, name: str = "poses") -> Array:
        """Check and convert poses."""
        ...

    def compose(self, T_a_b: npt.ArrayLike, T_b_c: npt.ArrayLike) -> Array:
        """Chain poses."""
        ...

    def inverse(self, T_a_b: npt.ArrayLike) -> Array:
        """Turn poses around."""
        ...

    def between(self, T_a_b: npt.ArrayLike, T_a_c: npt.ArrayLike) -> Array:
        """Relative poses."""
        ...

    def exp(self, xi: npt.ArrayLike) -> Array:
        """Poses of tangent vectors."""
        ...

    def log(self, T_a_b: npt.ArrayLike) -> Array:
        """Tangent vectors of poses."""
        ...

    def adjoint(self, T_a_b: npt.ArrayLike) -> Array:
        """Matrices that carry tangent vectors from b to a."""
        ...


def group_of(dimension: int) -> PoseGroup:
    """Return SE(2) for two dimensions, SE(3) for three."""
    return se2 if dimension == 2 else se3


def position_heading(dimension: int, position: float, heading: float) -> Array:
    """Return equal values for all axes of a tangent vector: of position (m), and of heading or rotation (rad).

    Returns
    -------
    ndarray, shape (3,) or (6,)
        In the order of the group's tangent vectors.
    """
    return np.array([position] * 2 + [heading] if dimension == 2 else [heading] * 3 + [position] * 3)
