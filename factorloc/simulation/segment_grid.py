"""SegmentGrid: segments sorted into the cells of a uniform grid, ready for ray casting."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.simulation import _ray_kernels

__all__ = ["SegmentGrid"]

Array = npt.NDArray[np.float64]

_CELLS_PER_SEGMENT = 4.0
"""Twice or half as many cast rays through a building about as fast."""

_MARGIN = 0.01
"""Empty space around the outermost segments, as a fraction of a cell: none lies on the border of the grid."""


@dataclass(frozen=True)
class SegmentGrid:
    """A uniform grid over segments of the plane; each cell lists those that cross it.

    Parameters
    ----------
    corner : ndarray, shape (2,)
        Lowest x and y of the grid, m.
    cell : float
        Width of a cell, m.
    shape : (int, int)
        Columns and rows.
    starts : ndarray of int64, shape (columns * rows + 1,)
        Cell ``row * columns + column`` owns the entries ``starts[c]:starts[c + 1]`` of the arrays below, in which a
        segment appears once for each cell it crosses.
    segments : ndarray, shape (K, 4)
        End points ``[x_a, y_a, x_b, y_b]``, m.
    depths : ndarray, shape (K,)
        Optical depth of crossing the segment; infinite if opaque.
    rates : ndarray, shape (K,)
        Decay rate that begins on the left of the segment, 1/m.
    edges : ndarray, shape (F, 4)
        The segments that bound a region, each once.
    edge_rates : ndarray, shape (F,)
        Their decay rates, 1/m.
    """

    corner: Array
    cell: float
    shape: tuple[int, int]
    starts: npt.NDArray[np.int64]
    segments: Array
    depths: Array
    rates: Array
    edges: Array
    edge_rates: Array

    @classmethod
    def build(cls, segments: Array, depths: Array, rates: Array) -> SegmentGrid:
        """Sort segments (S, 4) with their optical depths (S,) and decay rates (S,) into a grid of fitting width."""
        ends = segments.reshape(-1, 2)
        low, size = ends.min(0), np.ptp(ends, axis=0)
        # A plan that is a single line has no area; its length bounds the number of cells then.
        cell = float(max(np.sqrt(size.prod() / (_CELLS_PER_SEGMENT * len(segments))), size.max() / 1024))
        columns, rows = (int(n) for n in np.ceil(size / cell + 2 * _MARGIN))
        corner = low - _MARGIN * cell
        starts, members = _ray_kernels.sort_into_cells(segments, corner, cell, (columns, rows))
        bounding = rates > 0
        return cls(
            corner, cell, (columns, rows), starts,
            segments[members], depths[members], rates[members], segments[bounding], rates[bounding],
        )  # fmt: skip

    def rates_at(self, points: Array) -> Array:
        """Decay rate at points (N, 2), the sum over the regions that hold them, 1/m, shape (N,)."""
        return np.asarray(_ray_kernels.rates_at(points, self.edges, self.edge_rates))

    def cast(
        self, origins: Array, directions: Array, origin_rates: Array, draws: Array
    ) -> tuple[Array, npt.NDArray[np.uint8]]:
        """Send rays until their optical depth reaches their draws.

        Parameters
        ----------
        origins, directions : ndarray, shape (N, 2)
            Start points (m) and unit vectors.
        origin_rates : ndarray, shape (N,)
            Decay rate at the origins, 1/m.
        draws : ndarray, shape (N,)
            Unit exponential draws; infinity passes everything but opaque segments.

        Returns
        -------
        ranges : ndarray, shape (N,)
            m; infinite where nothing reflects.
        surfaces : ndarray of uint8, shape (N,)
            Codes of :class:`~factorloc.simulation.world.Surface`.
        """
        grid = (self.corner, self.cell, self.shape, self.starts, self.segments, self.depths, self.rates)
        ranges, surfaces = _ray_kernels.cast_rays(origins, directions, origin_rates, draws, *grid)
        return ranges, surfaces
