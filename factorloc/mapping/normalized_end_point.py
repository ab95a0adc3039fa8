"""Normalized end-point model: the scores of the likelihood field made a probability along every ray."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from factorloc.mapping._end_point_kernels import normalized_end_point_log_likelihoods
from factorloc.mapping.body_rays import BodyRays, RayKernel
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.cell_layout import CellLayout
from factorloc.mapping.end_point import EndPointModel, finite_maximum, laid_out
from factorloc.mapping.grid import Grid
from factorloc.mapping.ray_statistics import RayStatistics
from factorloc.scan import Scan

__all__ = ["NormalizedEndPointModel"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class NormalizedEndPointModel:
    """End-point model made a probability (thesis, section 7.6.2), to be compared with models of the ray's path.

    The score of a ray, constant in each cell, is divided by its exact integral from the minimum to the maximum range,
    and shares what the out-of-range prior leaves:

        p(r) = (1 - P) score(cell of r) / sum over cells of score * path length in the cell.

    Parameters
    ----------
    scores : EndPointModel
        The model whose scores are normalized.
    """

    scores: EndPointModel
    _layouts: dict[float, CellLayout] = field(default_factory=dict, init=False, repr=False, compare=False)

    @classmethod
    def from_statistics(
        cls, statistics: RayStatistics | BrickStatistics, sigma: float = 0.1, **settings: Any
    ) -> NormalizedEndPointModel:
        """Make the model of a map; arguments as :meth:`EndPointModel.from_statistics`."""
        return cls(EndPointModel.from_statistics(statistics, sigma, **settings))

    @property
    def grid(self) -> Grid:
        """Where the cells lie."""
        return self.scores.grid

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

    def _kernel(self, scan: Scan) -> RayKernel:
        maximum = finite_maximum(scan)
        if maximum not in self._layouts:
            model = self.scores
            self._layouts[maximum] = laid_out(model.distances, lambda d: np.exp(model.log_score(d, maximum)))
        layout, shares = self._layouts[maximum], self.scores.log_shares

        def write(pose: Array, rays: BodyRays, out: Array) -> None:
            normalized_end_point_log_likelihoods(
                layout.directory, layout.values, layout.strides, layout.rim, layout.shape, layout.outside, layout.low,
                layout.resolution, pose, rays.origins, rays.directions, rays.lengths, rays.status, rays.limits, shares,
                out,
            )  # fmt: skip

        return write
