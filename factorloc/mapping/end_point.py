"""End-point model: the likelihood field of a map, looked up where rays end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from factorloc import _jit
from factorloc.errors import MapError
from factorloc.geometry import se2, se3
from factorloc.mapping._end_point_kernels import end_point_sums, spatial_end_point_sums
from factorloc.mapping.body_rays import checked_poses, require_dimension
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.cell_layout import CellLayout
from factorloc.mapping.cell_table import CellTable
from factorloc.mapping.distance_transform import DistanceField
from factorloc.mapping.grid import Grid
from factorloc.mapping.out_of_range import OutOfRangePrior
from factorloc.mapping.ray_statistics import RayStatistics
from factorloc.scan import RayStatus, Scan

__all__ = ["EndPointModel", "finite_maximum", "laid_out"]

Array = npt.NDArray[np.float64]

_PARALLEL_ENDS = 50_000  # fewer are looked up faster than threads are woken


@dataclass(frozen=True)
class EndPointModel:
    """Likelihood field: a ray is the likelier, the nearer its end is to an occupied cell, whatever lies before.

    A return scores ``log(hit * N(d; 0, sigma) + random / maximum range)``, with d the distance of the cell it ends in
    (Thrun's end-point model, thesis, section 7.3.2). These scores are no probabilities: they do not add up to one along
    a ray. Rays out of range have the probabilities of the prior.

    Parameters
    ----------
    distances : DistanceField
        The field.
    sigma : float
        Standard deviation of an end's distance, m.
    hit, random : float
        Weights of the two parts, positive.
    out_of_range : OutOfRangePrior
        Probabilities of rays out of range.

    Raises
    ------
    MapError
        If a number is not positive.
    """

    distances: DistanceField
    sigma: float = 0.1
    hit: float = 0.95
    random: float = 0.05
    out_of_range: OutOfRangePrior = field(default_factory=OutOfRangePrior)
    _layouts: dict[float, CellLayout] = field(default_factory=dict, init=False, repr=False, compare=False)
    _tables: dict[float, npt.NDArray[np.float32]] = field(default_factory=dict, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        numbers = {"sigma": self.sigma, "hit": self.hit, "random": self.random}
        for name, number in numbers.items():
            if not (np.isfinite(number) and number > 0):
                raise MapError(f"{name}: {number}; expected a positive number")

    @classmethod
    def from_statistics(
        cls,
        statistics: RayStatistics | BrickStatistics,
        sigma: float = 0.1,
        *,
        hit: float = 0.95,
        random: float = 0.05,
        farthest: float = 2.0,
        least_hits: int = 1,
        least_reflection: float = 0.1,
        out_of_range: OutOfRangePrior | None = None,
    ) -> EndPointModel:
        """Make the field of a map.

        Parameters
        ----------
        statistics : RayStatistics or BrickStatistics
            The map, planar or spatial.
        sigma, hit, random : float
            See above.
        farthest : float
            Distances end here, m; so does everything outside the map.
        least_hits, least_reflection : int, float
            What makes a cell occupied (:func:`~factorloc.mapping.distance_transform.end_cells`).
        out_of_range : OutOfRangePrior, optional
            By default learned from what the map left out.

        Raises
        ------
        MapError
            If no cell is occupied.
        """
        distances = DistanceField.from_statistics(
            statistics, farthest, least_hits=least_hits, least_reflection=least_reflection
        )
        return cls(distances, sigma, hit, random, out_of_range or OutOfRangePrior.from_statistics(statistics))

    @property
    def grid(self) -> Grid:
        """Where the cells lie."""
        return self.distances.grid

    @property
    def normalized(self) -> bool:
        """False: scores are no probabilities; NormalizedEndPointModel makes them."""
        return False

    def log_score(self, distances: npt.ArrayLike, maximum_range: float) -> Array:
        """Log score of ends at distances (...) from what is occupied, m."""
        d = np.asarray(distances, np.float64) / self.sigma
        peak = np.log(self.hit / (self.sigma * np.sqrt(2 * np.pi)))
        return np.asarray(np.logaddexp(peak - 0.5 * d * d, np.log(self.random / maximum_range)))

    def log_likelihood(self, scan: Scan, T_map_body: npt.ArrayLike) -> Array:
        """Log score of each return, log-probability of each ray out of range (SensorModel)."""
        require_dimension(scan, self.grid)
        pose = checked_poses(np.asarray(T_map_body, np.float64)[None], self.grid)[0]
        group = se2 if scan.dimension == 2 else se3
        ends = group.transform(pose, group.transform(scan.T_body_sensor, scan.points()))
        out = self.log_shares[scan.status]
        out[scan.is_return] = self.log_score(self.distances.at(ends), finite_maximum(scan))
        return np.asarray(out)

    def scan_log_likelihoods(self, scan: Scan, poses: npt.ArrayLike) -> Array:
        """Sum of the log scores of a scan at each of many poses (SensorModel), in threads.

        Scores are looked up in single precision, and added up in double: a ray's is wrong by less than 1e-6.
        """
        require_dimension(scan, self.grid)
        placed = checked_poses(poses, self.grid)
        resolution = self.grid.resolution
        ends = scan.points()
        out = np.empty(len(placed))
        if self.grid.dimension == 2:
            table = self._table(finite_maximum(scan))
            x, y = np.ascontiguousarray(se2.transform(scan.T_body_sensor, ends).T) / resolution
            low, shape = np.array(self.grid.origin), (self.grid.shape[0], self.grid.shape[1])

            def look_up(first: int, last: int) -> None:
                scratch = np.empty(len(x), np.int32)
                end_point_sums(table, shape, low, resolution, placed[first:last], x, y, scratch, out[first:last])
        else:
            layout = self._layout(finite_maximum(scan))
            ends = se3.transform(scan.T_body_sensor, ends) / resolution
            moves = placed[:, :3].copy()
            moves[:, :, 3] = (moves[:, :, 3] - self.grid.origin) / resolution + 1.0

            def look_up(first: int, last: int) -> None:
                spatial_end_point_sums(
                    layout.directory, layout.values, layout.strides, layout.shape, moves[first:last], ends,
                    out[first:last],
                )  # fmt: skip

        if len(out) * len(ends) > _PARALLEL_ENDS:
            _jit.in_threads(look_up, len(out))
        else:
            look_up(0, len(out))
        return out + float(self.log_shares[scan.status[~scan.is_return]].sum())

    @property
    def log_shares(self) -> Array:
        """Log-probabilities of a return, of a ray below the minimum and of one without return, shape (3,)."""
        shares = np.zeros(3)
        shares[RayStatus.RETURN] = self.out_of_range.within
        shares[RayStatus.BELOW_MINIMUM] = self.out_of_range.below
        shares[RayStatus.NO_RETURN] = self.out_of_range.none
        return np.log(shares)

    def _table(self, maximum_range: float) -> npt.NDArray[np.float32]:
        """Log scores of a planar map with a rim, flat; one for each maximum range that was met."""
        if maximum_range not in self._tables:
            if (self.grid.shape[0] + 2) * (self.grid.shape[1] + 2) >= 2**31:
                raise MapError(f"map: {self.grid.shape} cells are too many for one table; use a smaller region")
            distances = np.pad(np.asarray(self.distances.values), 1, constant_values=self.distances.farthest)
            self._tables[maximum_range] = self.log_score(distances, maximum_range).astype(np.float32).ravel()
        return self._tables[maximum_range]

    def _layout(self, maximum_range: float) -> CellLayout:
        """Log scores of a spatial map as kernels want them."""
        if maximum_range not in self._layouts:
            self._layouts[maximum_range] = laid_out(self.distances, lambda d: self.log_score(d, maximum_range))
        return self._layouts[maximum_range]


def laid_out(distances: DistanceField, function: Callable[[npt.ArrayLike], Array]) -> CellLayout:
    """Lay out a function of the distance of every cell."""
    if isinstance(distances.values, CellTable):
        return CellLayout.bricks(distances.values.map(function))
    return CellLayout.dense(distances.grid, function(distances.values), float(function(distances.farthest)))


def finite_maximum(scan: Scan) -> float:
    """Maximum range of a scan, m.

    Raises
    ------
    MapError
        If it is infinite.
    """
    maximum = scan.range_limits[1]
    if not np.isfinite(maximum):
        raise MapError("range_limits: infinite; an end-point model needs the sensor's maximum range")
    return maximum
