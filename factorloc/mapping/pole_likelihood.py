"""Pole likelihood: how well poles that were detected at a pose fit a map of poles, as a sensor model (chapter 12)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from factorloc import _jit
from factorloc.errors import MapError
from factorloc.geometry import se2
from factorloc.mapping._pole_likelihood_kernels import nearest_distances, nearest_pole_sums, pole_field_sums
from factorloc.mapping.body_rays import checked_poses, require_dimension
from factorloc.mapping.grid import Grid, require_memory
from factorloc.mapping.point_cells import PointCells
from factorloc.mapping.poles import Poles
from factorloc.scan import RayStatus, Scan

__all__ = ["PoleLikelihood", "clutter_density", "pole_scan"]

Array = npt.NDArray[np.float64]

_PARALLEL_POLES = 50_000  # fewer are weighed faster than threads are woken
_AROUND = 500.0  # m around the map where a vehicle may be that sees no pole


@dataclass(frozen=True)
class PoleLikelihood:
    """Likelihood of detected poles, independent of each other (thesis, section 12.4.3).

    Each detection scores ``log(N(d; 0, sigma^2) + epsilon)`` with its distance d to the nearest pole of the map; from
    the gate on, a detection says nothing of where it is. A set of detections is a planar scan (:func:`pole_scan`), so
    that all of Monte Carlo localization works with poles as it does with rays.

    Parameters
    ----------
    positions : array_like, shape (L, 2)
        Poles of the map, m.
    sigma : float
        Standard deviation of the poles of the map, m.
    epsilon : float
        Density of detections that are not in the map, 1/m (:func:`clutter_density`).
    gate : float
        Distances end here, m.
    resolution : float, optional
        Distance of the nodes of a table of the likelihood, m, which is interpolated in. Without, the nearest pole is
        looked for, exactly.
    frame : str
        Name of the map's frame.

    Raises
    ------
    MapError
        If there is no pole, a position is not finite, a number is not positive, or poles lie too far apart to be of one
        map.
    """

    positions: Array
    sigma: float = 1.0
    epsilon: float = 0.1
    gate: float = 2.7
    resolution: float | None = 0.25
    frame: str = "map"
    grid: Grid = field(init=False)
    _cells: PointCells = field(init=False, repr=False)
    _table: tuple[npt.NDArray[np.float32], tuple[int, int], Array] | None = field(init=False, repr=False)

    def __post_init__(self) -> None:
        positions = np.asarray(self.positions, np.float64)
        if positions.ndim != 2 or positions.shape[1:] != (2,) or len(positions) == 0:
            raise MapError(f"poles: positions of shape {positions.shape}; a map needs at least one row [x, y]")
        if not np.isfinite(positions).all():
            raise MapError("poles: a position is not finite; leave it out")
        for name in ("sigma", "epsilon", "gate", "resolution"):
            number = getattr(self, name)
            if number is not None and not 0 < number < np.inf:
                raise MapError(f"{name}: {number}; expected a positive number")
        object.__setattr__(self, "positions", np.ascontiguousarray(positions))
        object.__setattr__(self, "_cells", PointCells.of(positions, self.gate))
        object.__setattr__(self, "grid", Grid.around(positions, self.resolution or 0.25, _AROUND, self.frame))
        object.__setattr__(self, "_table", None if self.resolution is None else self._tabulated(self.resolution))

    @property
    def normalized(self) -> bool:
        """False: densities of distances are no densities of the plane."""
        return False

    @property
    def peak(self) -> float:
        """Largest density of the Gaussian part, 1/m."""
        return float(1.0 / (self.sigma * np.sqrt(2 * np.pi)))

    def log_score(self, distances: npt.ArrayLike) -> Array:
        """Log score of detections at distances (...) from their nearest poles, m."""
        d = np.minimum(np.asarray(distances, np.float64), self.gate) / self.sigma
        return np.asarray(np.log(self.peak * np.exp(-0.5 * d * d) + self.epsilon))

    def log_likelihood(self, scan: Scan, T_map_body: npt.ArrayLike) -> Array:
        """Log score of each detection, exactly; 0 for rays out of range (SensorModel)."""
        require_dimension(scan, self.grid)
        pose = checked_poses(np.asarray(T_map_body, np.float64)[None], self.grid)
        out, ends = np.zeros(len(scan)), se2.transform(scan.T_body_sensor, scan.points())
        for row, (x, y) in zip(np.flatnonzero(scan.is_return), ends, strict=True):
            self._exact(pose, np.array([x]), np.array([y]), out[row : row + 1])
        return out

    def scan_log_likelihoods(self, scan: Scan, poses: npt.ArrayLike) -> Array:
        """Sum of the log scores of all detections at each of many poses (SensorModel), in threads."""
        require_dimension(scan, self.grid)
        placed, out = checked_poses(poses, self.grid), np.zeros(len(np.asarray(poses)))
        x, y = np.ascontiguousarray(se2.transform(scan.T_body_sensor, scan.points()).T)
        if len(x) == 0:
            return out

        def weigh(first: int, last: int) -> None:
            if self._table is None:
                self._exact(placed[first:last], x, y, out[first:last])
            else:
                table, shape, low = self._table
                assert self.resolution is not None
                pole_field_sums(table, shape, low, self.resolution, placed[first:last], x, y, out[first:last])

        if len(out) * len(x) > _PARALLEL_POLES:
            _jit.in_threads(weigh, len(out))
        else:
            weigh(0, len(out))
        return out

    def _exact(self, poses: Array, x: Array, y: Array, out: Array) -> None:
        cells = self._cells
        nearest_pole_sums(
            cells.starts, cells.points, cells.shape, cells.low, cells.cell, poses, x, y, self.gate, self.sigma**2,
            self.peak, self.epsilon, out,
        )  # fmt: skip

    def _tabulated(self, resolution: float) -> tuple[npt.NDArray[np.float32], tuple[int, int], Array]:
        # Two nodes beyond the gate on every side: the rim of the table says that nothing is near.
        low = self.positions.min(0) - self.gate - 2 * resolution
        nodes = np.ceil((self.positions.max(0) + self.gate - low) / resolution).astype(np.int64) + 3
        what = f"poles: a table of {nodes[0]} x {nodes[1]} nodes"
        require_memory(int(nodes.prod()) * 12, f"{what} (resolution None needs none)")
        distances = np.full(tuple(nodes.tolist()), self.gate, np.float32)
        nearest_distances(self.positions, low, resolution, self.gate, distances)
        return self.log_score(distances).astype(np.float32).ravel(), (int(nodes[0]), int(nodes[1])), low


def pole_scan(poles: Poles | npt.ArrayLike, stamp: float = 0.0) -> Scan:
    """Write the poles of a local map as a planar scan of its body.

    Parameters
    ----------
    poles : Poles, or array_like, shape (K, 2)
        In the frame of the body, m; none make a scan without information.
    stamp : float
        Time, s.
    """
    points = poles.positions if isinstance(poles, Poles) else np.asarray(poles, np.float64).reshape(-1, 2)
    ranges = np.hypot(points[:, 0], points[:, 1])
    ahead = np.tile([1.0, 0.0], (len(points), 1))
    directions = np.divide(points, ranges[:, None], out=ahead, where=ranges[:, None] > 0)
    return Scan(directions, ranges, np.full(len(points), RayStatus.RETURN, np.uint8), (0.0, np.inf), stamp=stamp)


def clutter_density(matched: float, unmatched: float, gate: float) -> float:
    """Density of detections that are not in the map, as a filter adds it to the Gaussian of those that are.

    A share u of the detections of a second drive has no pole within the gate. Taken as spread evenly over distances up
    to there, the mixture ``(1 - u) N(d) + u / gate`` is ``N(d) + u / ((1 - u) gate)`` but for a factor, which weights
    do not know.

    Parameters
    ----------
    matched, unmatched : float
        Numbers of detections with and without a pole of the map within the gate.
    gate : float
        m.

    Returns
    -------
    float
        1/m; a detection of either kind is added to those counted, so that neither is impossible.

    Raises
    ------
    MapError
        If a count is negative or the gate not positive.
    """
    if min(matched, unmatched) < 0 or gate <= 0:
        raise MapError(f"clutter: {matched} matched, {unmatched} unmatched, gate {gate} m; counts and a length")
    return float((unmatched + 1) / ((matched + 1) * gate))
