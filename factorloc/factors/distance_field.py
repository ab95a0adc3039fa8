"""The likelihood field (end-point model) as a scan term."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.ndimage import distance_transform_edt, gaussian_filter

from factorloc.errors import MapError
from factorloc.factors._scan_kernels import DISTANCE_FIELD
from factorloc.factors.grid_scan_term import GridScanTerm
from factorloc.mapping.beam_model import rimmed
from factorloc.mapping.pyramid import DEFAULT_BLURS
from factorloc.mapping.ray_statistics import RayStatistics
from factorloc.rays import Rays
from factorloc.scan import Scan

__all__ = ["DistanceFieldTerm"]

Array = npt.NDArray[np.float64]


class DistanceFieldTerm(GridScanTerm):
    """Likelihood field: robust distance from each end point to the nearest reflecting cell.

    The model most localizers use, with the same coarse-to-fine treatment as
    :class:`~factorloc.factors.DecayRateTerm`: the distance field is blurred, and its scale widened, by the blur of each
    level.

    Parameters
    ----------
    statistics : RayStatistics
        The map.
    scans : sequence of Scan, or Rays
        One scan a pose.
    information : float
        Factor of all costs.
    sigma : float
        Scale of the distance at blur 0, m.
    huber : float
        Threshold of the Huber loss, in sigmas.
    least_rate : float
        A cell counts as reflecting from this decay rate on, 1/m.
    farthest : float
        Distances end here, m.
    blurs : sequence of float
        Blur of the levels, m.

    Raises
    ------
    MapError
        If no cell reflects, the blurs do not decrease, or scans and map differ in dimension.
    """

    def __init__(
        self,
        statistics: RayStatistics,
        scans: Sequence[Scan] | Rays,
        information: float = 1.0,
        *,
        sigma: float = 0.05,
        huber: float = 2.0,
        least_rate: float = 2.0,
        farthest: float = 1.5,
        blurs: Sequence[float] = DEFAULT_BLURS,
    ) -> None:
        if not blurs or min(blurs) < 0 or any(a <= b for a, b in itertools.pairwise(blurs)):
            raise MapError(f"blurs: {tuple(blurs)} m; expected decreasing lengths, 0 at the end for the map itself")
        grid = statistics.grid
        occupied = statistics.hits > least_rate * statistics.path_lengths
        if not occupied.any():
            raise MapError(f"map: no cell has a decay rate above {least_rate} 1/m; lower least_rate")
        distance = np.minimum(distance_transform_edt(~occupied) * grid.resolution, farthest)
        fields = np.stack([rimmed(_blurred(distance, b / grid.resolution), farthest).ravel() for b in blurs])
        numbers = np.array([[farthest, float(np.hypot(sigma, blur)), huber] for blur in blurs])
        super().__init__(DISTANCE_FIELD, grid, blurs, fields, fields, numbers, scans, information)


def _blurred(distance: Array, sigma: float) -> Array:
    return distance if sigma == 0 else np.asarray(gaussian_filter(distance, sigma, mode="nearest", truncate=3.0))
