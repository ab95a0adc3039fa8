"""What every scan-to-map term offers: what a whole batch of scans says about its poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

__all__ = ["ScanCosts", "ScanTerm"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class ScanCosts:
    """Costs of N poses, with derivatives in the tangent space of the body.

    Parameters
    ----------
    cost : ndarray, shape (N,)
        Negative log-likelihoods; they may be negative.
    gradient : ndarray, shape (N, 3), or (N, 6) in space
        First derivatives.
    hessian : ndarray, shape (N, 3, 3), or (N, 6, 6) in space
        Gauss-Newton approximation of the second derivatives, positive semi-definite.
    """

    cost: Array
    gradient: Array
    hessian: Array


@runtime_checkable
class ScanTerm(Protocol):
    """A measurement model of scans in a map, evaluated for many poses at once.

    ``information`` scales all costs: the rays of one scan are not independent, so their likelihoods count less than
    the product says.
    """

    information: float

    @property
    def scans(self) -> int:
        """Number of scans the term was made for."""
        ...

    @property
    def blurs(self) -> tuple[float, ...]:
        """Blur of each level of the map, m, coarse to fine."""
        ...

    def batch(self, poses: npt.ArrayLike, level: int = -1, scan_of_pose: npt.ArrayLike | None = None) -> ScanCosts:
        """Cost, gradient and Hessian at poses ``T_map_body``; pose ``n`` is of scan ``n`` unless told otherwise."""
        ...

    def cost(self, poses: npt.ArrayLike, level: int = -1, scan_of_pose: npt.ArrayLike | None = None) -> Array:
        """Cost alone."""
        ...

    def least_cost(self, level: int = -1) -> Array:
        """A lower bound of the cost of each scan."""
        ...
