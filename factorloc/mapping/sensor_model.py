"""Sensor models: what every model of a lidar in a map can be asked, whatever it is made of."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from factorloc.mapping.grid import Grid
from factorloc.scan import Scan

__all__ = ["SensorModel"]

Array = npt.NDArray[np.float64]


@runtime_checkable
class SensorModel(Protocol):
    """Likelihood of lidar rays in a map.

    Returns have a density over the measured range (1/m), rays out of range an absolute probability (thesis, eq. 7.15).
    Of a model that is :attr:`normalized` the three outcomes of a ray add up to one:

        P(below minimum) + integral of p(r) from the minimum to the maximum + P(no return) = 1.
    """

    @property
    def grid(self) -> Grid:
        """Where the cells lie."""
        ...

    @property
    def normalized(self) -> bool:
        """Whether the outcomes of every ray add up to one, so that likelihoods of models may be compared."""
        ...

    def log_likelihood(self, scan: Scan, T_map_body: npt.ArrayLike) -> Array:
        """Log-likelihood of each ray of a scan at one pose.

        Parameters
        ----------
        scan : Scan
            Of the map's dimension.
        T_map_body : array_like, shape (3,) or (4, 4)
            Pose of the body.

        Returns
        -------
        ndarray, shape (N,)
            Log densities (1/m) of returns, log probabilities of rays out of range; -inf where the model excludes them.

        Raises
        ------
        MapError
            If scan and map differ in dimension.
        """
        ...

    def scan_log_likelihoods(self, scan: Scan, poses: npt.ArrayLike) -> Array:
        """Log-likelihood of a scan at each of many poses: the sum over its rays, as a particle filter weighs them.

        Parameters
        ----------
        scan : Scan
            Of the map's dimension.
        poses : array_like, shape (P, 3) or (P, 4, 4)
            Poses ``T_map_body``.

        Returns
        -------
        ndarray, shape (P,)
            Sums of :meth:`log_likelihood`.

        Raises
        ------
        MapError
            If scan, poses and map differ in dimension.
        """
        ...
