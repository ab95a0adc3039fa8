"""Noisy decay-rate maps: the decay-rate model with range noise and false detections."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from factorloc.errors import MapError
from factorloc.mapping._noisy_decay_rate_kernels import noisy_log_likelihoods
from factorloc.mapping.body_rays import BodyRays, RayKernel
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.cell_layout import CellLayout
from factorloc.mapping.cell_table import CellTable
from factorloc.mapping.decay_rate import DecayRateMap, DecayRatePosterior
from factorloc.mapping.grid import Grid
from factorloc.mapping.ray_statistics import RayStatistics
from factorloc.scan import Scan

__all__ = ["NoisyDecayRateMap"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class NoisyDecayRateMap:
    """Decay-rate model of a sensor that errs: what the thesis leaves for later (section 7.7), in closed form.

    A true measurement is ``z = r + noise``: r by the decay rates, the noise normal and cut off at 8 sigma. A share of
    the rays measures nothing of the world; it is uniform over the measured range. A true z beyond a limit is a ray out
    of range, so that the outcomes add up to one:

        p(z) = (1 - false_rate) (density of r + noise)(z) + false_rate / (maximum - minimum),
        P(below) = (1 - false_rate) P(z < minimum),    P(no return) = (1 - false_rate) P(z > maximum).

    With ``sigma`` to 0 and no false detections these are the likelihoods of
    :class:`~factorloc.mapping.DecayRateMap`. A map made of noisy ranges has their noise in its rates: a wall is as
    thick as its ends are spread. ``sigma`` is what cells do not show, the noise beyond that.

    Parameters
    ----------
    statistics : RayStatistics or BrickStatistics
        The map the rates belong to.
    rates : ndarray, shape ``grid.shape``
        Decay rates, 1/m; of a sparse map those of the visited cells, shape (V,).
    outside : float
        Decay rate of all other space, 1/m.
    sigma : float
        Standard deviation of a range, m.
    false_rate : float
        Share of false detections, in [0, 1).

    Raises
    ------
    MapError
        If shapes disagree, a rate is negative or not finite, or sigma or the share is out of bounds.
    """

    statistics: RayStatistics | BrickStatistics
    rates: Array
    outside: float
    sigma: float = 0.03
    false_rate: float = 0.01

    def __post_init__(self) -> None:
        rates = np.asarray(self.rates, np.float64)
        if rates.shape != self.statistics.path_fixed.shape:
            raise MapError(f"rates: shape {rates.shape}; the map has {self.statistics.path_fixed.shape}")
        if not (np.isfinite(rates).all() and rates.min(initial=self.outside) >= 0 and np.isfinite(self.outside)):
            raise MapError("rates: negative or not finite; a decay rate is 0 or more")
        if not (np.isfinite(self.sigma) and self.sigma > 0):
            raise MapError(f"sigma: {self.sigma} m; expected a positive length (use DecayRateMap without noise)")
        if not 0 <= self.false_rate < 1:
            raise MapError(f"false_rate: {self.false_rate}; expected a share in [0, 1)")
        object.__setattr__(self, "rates", rates)

    @classmethod
    def from_map(cls, rates: DecayRateMap, sigma: float = 0.03, false_rate: float = 0.01) -> NoisyDecayRateMap:
        """Take the most likely rates of a map, outside of it the prior's mean."""
        return cls(rates.statistics, rates.rates, rates.prior.mean, sigma, false_rate)

    @classmethod
    def from_posterior(
        cls, posterior: DecayRatePosterior, sigma: float = 0.03, false_rate: float = 0.01
    ) -> NoisyDecayRateMap:
        """Take the expected rates of a posterior, outside of it the prior's mean."""
        return cls(posterior.statistics, posterior.mean, posterior.prior.mean, sigma, false_rate)

    @property
    def grid(self) -> Grid:
        """Where the cells lie."""
        return self.statistics.grid

    @property
    def normalized(self) -> bool:
        """True: the outcomes of every ray add up to one."""
        return True

    def log_likelihood(self, scan: Scan, T_map_body: npt.ArrayLike) -> Array:
        """Log-likelihood of each ray (SensorModel)."""
        return BodyRays.of(scan, self.grid).each(self._kernel(scan), T_map_body)

    def scan_log_likelihoods(self, scan: Scan, poses: npt.ArrayLike) -> Array:
        """Log-likelihood of a scan at each of many poses (SensorModel), in threads."""
        return BodyRays.of(scan, self.grid).sums(self._kernel(scan), poses)

    @cached_property
    def _layout(self) -> CellLayout:
        if isinstance(self.statistics, BrickStatistics):
            return CellLayout.bricks(CellTable.from_cells(self.statistics, self.rates, self.outside))
        return CellLayout.dense(self.grid, self.rates, self.outside)

    def _kernel(self, scan: Scan) -> RayKernel:
        extent = scan.range_limits[1] - scan.range_limits[0]
        if self.false_rate > 0 and not np.isfinite(extent):
            raise MapError("range_limits: infinite; false detections need a maximum range to spread over")
        layout = self._layout
        noise = (self.sigma, float(np.log1p(-self.false_rate)), self.false_rate / extent)

        def write(pose: Array, rays: BodyRays, out: Array) -> None:
            noisy_log_likelihoods(
                layout.directory, layout.values, layout.strides, layout.rim, layout.shape, layout.outside, layout.low,
                layout.resolution, pose, rays.origins, rays.directions, rays.lengths, rays.status, rays.limits, *noise,
                out,
            )  # fmt: skip

        return write
