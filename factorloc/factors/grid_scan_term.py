"""Scan terms that look up rays in tables over a grid, and the decay-rate models as two of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from factorloc._jit import in_threads
from factorloc.errors import GeometryError, MapError
from factorloc.factors._scan_kernels import DECAY_RATE, POSTERIOR, scan_batch
from factorloc.factors.scan_term import ScanCosts
from factorloc.mapping.grid import Grid
from factorloc.mapping.posterior_pyramid import PosteriorPyramid
from factorloc.mapping.pyramid import BlurPyramid
from factorloc.rays import Rays, pack
from factorloc.scan import Scan

__all__ = ["DecayRateTerm", "GridScanTerm", "PosteriorTerm"]

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]

_PARALLEL_RAYS = 10_000


def _checked(poses: npt.ArrayLike, scan_of_pose: npt.ArrayLike | None, scans: int) -> tuple[Array, Index]:
    array = np.ascontiguousarray(poses, np.float64)
    if array.ndim != 2 or array.shape[1] != 3 or not np.isfinite(array).all():
        raise GeometryError(f"poses: shape {array.shape}; expected finite rows [x, y, theta]")
    if scan_of_pose is None:
        if len(array) != scans:
            raise GeometryError(f"poses: {len(array)} for {scans} scans; give one each, or scan_of_pose")
        return array, np.arange(scans, dtype=np.int64)
    index = np.ascontiguousarray(scan_of_pose, np.int64)
    if index.shape != (len(array),) or (len(index) and not 0 <= index.min() <= index.max() < scans):
        raise GeometryError(f"scan_of_pose: expected {len(array)} indices below {scans}")
    return array, index


def _returns(scans: Sequence[Scan] | Rays, dimension: int) -> Rays:
    rays = (scans if isinstance(scans, Rays) else pack(scans)).returns()
    if rays.dimension != dimension:
        raise MapError(f"scans: of {rays.dimension} dimensions, the map has {dimension}; use a map made for them")
    return rays


class GridScanTerm:
    """A model that looks up end points and rays in tables over a planar grid, one set of tables a level.

    Parameters
    ----------
    model : int
        Which cost the kernels compute.
    grid : Grid
        Where the cells lie.
    blurs : sequence of float
        Blur of each level, m.
    primary, secondary : ndarray, shape (L, cells with rim)
        Tables of each level.
    numbers : ndarray, shape (L, 3) or (L, 4)
        Numbers of each level.
    scans : sequence of Scan, or Rays
        One scan a pose; rays without return do not take part.
    information : float
        Factor of all costs.
    tertiary : ndarray, shape (L, cells with rim), optional
        A third table of each level.

    Raises
    ------
    MapError
        If scans and map differ in dimension.
    """

    def __init__(
        self,
        model: int,
        grid: Grid,
        blurs: Sequence[float],
        primary: Array,
        secondary: Array,
        numbers: Array,
        scans: Sequence[Scan] | Rays,
        information: float,
        tertiary: Array | None = None,
    ) -> None:
        self.model, self.grid, self.information = model, grid, information
        self.primary, self.secondary, self.tertiary, self.numbers = primary, secondary, tertiary, numbers
        self.rays = _returns(scans, grid.dimension)
        self._blurs = tuple(float(blur) for blur in blurs)

    @property
    def scans(self) -> int:
        """Number of scans the term was made for."""
        return len(self.rays)

    @property
    def blurs(self) -> tuple[float, ...]:
        """Blur of each level, m."""
        return self._blurs

    @property
    def layout(self) -> tuple[tuple[int, int], Array, float]:
        """Shape, lowest corner and resolution of the grid, as kernels take them."""
        return (self.grid.shape[0], self.grid.shape[1]), np.array(self.grid.origin), self.grid.resolution

    def batch(self, poses: npt.ArrayLike, level: int = -1, scan_of_pose: npt.ArrayLike | None = None) -> ScanCosts:
        """Cost, gradient and Hessian of scans at poses.

        Parameters
        ----------
        poses : array_like, shape (N, 3)
            Poses ``T_map_body``.
        level : int
            Level of the map.
        scan_of_pose : array_like of int, shape (N,), optional
            Scan of each pose; its own row by default.

        Raises
        ------
        GeometryError
            If poses are not finite planar rows or do not fit the scans.
        """
        return self._evaluate(poses, level, scan_of_pose, True)

    def cost(self, poses: npt.ArrayLike, level: int = -1, scan_of_pose: npt.ArrayLike | None = None) -> Array:
        """Cost alone, shape (N,); arguments as :meth:`batch`."""
        return self._evaluate(poses, level, scan_of_pose, False).cost

    def least_cost(self, level: int = -1) -> Array:
        """Lower bound of the cost of each scan, shape (S,)."""
        return np.zeros(self.scans)

    def _evaluate(
        self, poses: npt.ArrayLike, level: int, scan_of_pose: npt.ArrayLike | None, want_gradient: bool
    ) -> ScanCosts:
        array, index = _checked(poses, scan_of_pose, self.scans)
        n = len(array)
        cost, gradient, hessian = np.empty(n), np.empty((n, 3)), np.empty((n, 3, 3))
        rays = self.rays
        tertiary = None if self.tertiary is None else self.tertiary[level]

        def evaluate(first: int, last: int) -> None:
            part = slice(first, last)
            scan_batch(
                self.model, array[part], index[part], rays.origins, rays.directions, rays.ranges, rays.offsets,
                self.primary[level], self.secondary[level], tertiary, self.numbers[level], *self.layout,
                self.information, want_gradient, cost[part], gradient[part], hessian[part],
            )  # fmt: skip

        if n * len(rays.ranges) > _PARALLEL_RAYS * len(rays):
            in_threads(evaluate, n)
        else:  # waking threads for less than a millisecond of work costs more than it saves
            evaluate(0, n)
        return ScanCosts(cost, gradient, hessian)


class DecayRateTerm(GridScanTerm):
    """Hybrid negative log-likelihood of scans in a decay-rate map.

    Per ray with a return: the exact integral of the piecewise constant rates along the ray, minus the *interpolated*
    logarithm of the rate at its end. The integral alone repels a ray from what it crossed, and the logarithm of the
    rate at its end is flat almost everywhere; interpolated, it attracts. This is no density (it does not integrate to
    one); the densities are in :mod:`factorloc.mapping.decay_rate`. Rays without return do not take part: on real logs
    they come from glass and dark surfaces at least as often as from free space.

    The residual of a ray is ``sqrt(2 (nll - least nll))``, and Gauss-Newton on it gives ``H = sum g g' / (2 (nll -
    least nll))``: positive by construction, with little weight for rays the map does not explain.

    Parameters
    ----------
    pyramid : BlurPyramid
        The map at several blurs.
    scans : sequence of Scan, or Rays
        One scan a pose.
    information : float
        Factor of all costs, at most 1.

    Raises
    ------
    MapError
        If scans and map differ in dimension.
    """

    def __init__(self, pyramid: BlurPyramid, scans: Sequence[Scan] | Rays, information: float = 1.0) -> None:
        levels = pyramid.levels
        super().__init__(
            DECAY_RATE,
            pyramid.grid,
            pyramid.blurs,
            np.stack([level.rates for level in levels]),
            np.stack([level.log_rates for level in levels]),
            np.array([[level.outside, level.least_nll, 0.0] for level in levels]),
            scans,
            information,
        )

    def least_cost(self, level: int = -1) -> Array:
        """Lower bound of the cost of each scan, shape (S,)."""
        return np.asarray(self.information * self.numbers[level, 1] * np.diff(self.rays.offsets))


class PosteriorTerm(GridScanTerm):
    """Hybrid negative log-likelihood of scans under the full posterior of the decay rates (thesis, section 8.4.5).

    Per ray with a return: ``sum a_i log1p(r_i / b_i)`` over the cells it crosses, exactly, minus the interpolated
    logarithm of the effective rate ``a / (b + h / 2)`` at its end, with ``a = H + alpha``, ``b = R + beta`` and cells
    of edge ``h``. Cells few rays have met say less than in :class:`DecayRateTerm`, where their rate is taken for known.

    The density has ``a / (b + r)`` at the end, which jumps from cell to cell by the path ``r`` of the ray in the last;
    half a cell is the path of a ray that ends anywhere in it. The posterior mean ``a / b`` will not do: a prior learned
    from a map is often as good as no path, so that its mean is high, and a scan would be likeliest in space nobody
    has seen, which it passes for next to nothing. What holds of :class:`DecayRateTerm` otherwise holds here: the
    residual, rays without return, and that this is no density
    (:class:`~factorloc.mapping.decay_rate.DecayRatePosterior` is).

    Parameters
    ----------
    pyramid : PosteriorPyramid
        The map at several blurs.
    scans : sequence of Scan, or Rays
        One scan a pose.
    information : float
        Factor of all costs, at most 1.

    Raises
    ------
    MapError
        If scans and map differ in dimension.
    """

    def __init__(self, pyramid: PosteriorPyramid, scans: Sequence[Scan] | Rays, information: float = 1.0) -> None:
        levels, prior = pyramid.levels, pyramid.prior
        super().__init__(
            POSTERIOR,
            pyramid.grid,
            pyramid.blurs,
            np.stack([level.shapes for level in levels]),
            np.stack([level.paths for level in levels]),
            np.array([[prior.shape, level.least_nll, prior.path] for level in levels]),
            scans,
            information,
            np.stack([level.log_rates for level in levels]),
        )

    def least_cost(self, level: int = -1) -> Array:
        """Lower bound of the cost of each scan, shape (S,)."""
        return np.asarray(self.information * self.numbers[level, 1] * np.diff(self.rays.offsets))
