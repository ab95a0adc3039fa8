"""The end-point model as a scan term: the likelihood field with its own mixture, planar and spatial."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from factorloc.errors import MapError
from factorloc.factors._scan_kernels import END_POINT
from factorloc.factors.end_point_levels import EndPointLevels
from factorloc.factors.grid_scan_term import GridScanTerm
from factorloc.factors.spatial_scan_term import SpatialScanTerm
from factorloc.rays import Rays
from factorloc.scan import Scan

__all__ = ["EndPointTerm", "SpatialEndPointTerm", "maximum_range_of"]

Array = npt.NDArray[np.float64]


class EndPointTerm(GridScanTerm):
    """Negative log-score of scans in an end-point model: ``-log(hit N(d; 0, sigma) + random / maximum range)``.

    As :class:`~factorloc.mapping.end_point.EndPointModel` scores returns, with the distance ``d`` *interpolated*
    between the centres of cells, so that it has a gradient; rays without return do not take part. Where
    :class:`~factorloc.factors.DistanceFieldTerm` has Huber's loss, which never lets go of a ray, the mixture does: it
    is a robust loss as well, ``-log(exp(-r^2 / 2) + floor)`` with ``r = d / sigma``, whose Hessian is Gauss and
    Newton's with weight ``exp(-r^2 / 2) / (exp(-r^2 / 2) + floor)``.

    Parameters
    ----------
    levels : EndPointLevels
        The map at several standard deviations.
    scans : sequence of Scan, or Rays
        One scan a pose.
    information : float
        Factor of all costs, at most 1.
    maximum_range : float, optional
        Of the sensor, m; by default the largest of the scans.

    Raises
    ------
    MapError
        If scans and map differ in dimension, or the maximum range is not known.
    """

    def __init__(
        self,
        levels: EndPointLevels,
        scans: Sequence[Scan] | Rays,
        information: float = 1.0,
        maximum_range: float | None = None,
    ) -> None:
        most = maximum_range_of(scans) if maximum_range is None else maximum_range
        numbers = np.empty((len(levels.blurs), 4))
        numbers[:, 0] = levels.model.distances.farthest
        numbers[:, 1:] = levels.numbers(most)
        fields = levels.fields
        super().__init__(END_POINT, levels.grid, levels.blurs, fields, fields, numbers, scans, information)
        self.least_costs = levels.least_costs(most)

    def least_cost(self, level: int = -1) -> Array:
        """Lower bound of the cost of each scan, shape (S,)."""
        return np.asarray(self.information * self.least_costs[level] * np.diff(self.rays.offsets))


class SpatialEndPointTerm(SpatialScanTerm):
    """:class:`EndPointTerm` in space; parameters and errors are the same."""

    def __init__(
        self,
        levels: EndPointLevels,
        scans: Sequence[Scan] | Rays,
        information: float = 1.0,
        maximum_range: float | None = None,
    ) -> None:
        most = maximum_range_of(scans) if maximum_range is None else maximum_range
        super().__init__(levels.tables(most), scans, information)


def maximum_range_of(scans: Sequence[Scan] | Rays) -> float:
    """Largest maximum range of scans, m.

    Raises
    ------
    MapError
        If they are rays, which do not know it.
    """
    if isinstance(scans, Rays):
        raise MapError("scans: rays do not know the sensor's maximum range; give maximum_range")
    return max((scan.range_limits[1] for scan in scans), default=np.inf)
