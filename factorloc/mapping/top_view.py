"""Top view: a map from above, as pictures show it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.decay_rate import DecayRateMap
from factorloc.mapping.ray_statistics import RayStatistics

__all__ = ["top_view"]

Array = npt.NDArray[np.float64]

_REFLECTING = 0.5  # reflections per cell edge
_SCALE = 3.0  # cells above each other that come to 63 percent


def top_view(statistics: RayStatistics | BrickStatistics) -> Array:
    """Return what a map looks like from above, shape ``(n_x, n_y)``, 0 to 1; NaN where no ray has been.

    A planar map shows the probability that a ray along a cell edge is reflected. A spatial one shows how much stands
    in each column: ``1 - exp(-n / 3)`` for ``n`` reflecting cells above the lowest, so that ground is empty and a wall
    is not. For the eye; nothing is computed from it.
    """
    if statistics.grid.dimension == 2 and isinstance(statistics, RayStatistics):
        image = DecayRateMap.from_statistics(statistics).reflection_probability()
        image[statistics.path_fixed == 0] = np.nan
        return image
    bricks = statistics if isinstance(statistics, BrickStatistics) else BrickStatistics.from_dense(statistics)
    grid = bricks.grid
    shape = grid.shape[:2]
    cells = bricks.layout.cells(bricks.keys)
    column = np.ravel_multi_index((cells[:, 0], cells[:, 1]), shape)
    seen = np.bincount(column, minlength=shape[0] * shape[1]) > 0
    # Far from any reflection a cell of a single ray proves little: its path is counted as one edge at least.
    path = np.maximum(bricks.path_lengths, grid.resolution)
    reflecting = bricks.hits * grid.resolution > _REFLECTING * path
    count = np.bincount(column[reflecting], minlength=seen.size)
    view = np.where(seen, -np.expm1(-np.maximum(count - 1, 0) / _SCALE), np.nan)
    return np.asarray(view.reshape(shape))
