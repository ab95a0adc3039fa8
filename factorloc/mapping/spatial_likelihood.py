"""Likelihood of rays in spatial maps, dense and sparse, behind one call each."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from factorloc.mapping._spatial_likelihood_kernels import (
    spatial_decay_log_likelihoods,
    spatial_posterior_log_likelihoods,
)
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.bricks import BRICK
from factorloc.mapping.cell_table import CellTable
from factorloc.mapping.ray_statistics import RayStatistics
from factorloc.scan import Scan

__all__ = ["decay_log_likelihood", "posterior_log_likelihood"]

Array = npt.NDArray[np.float64]


def decay_log_likelihood(
    statistics: RayStatistics | BrickStatistics, rates: Array, outside: float, scan: Scan, origins: Array,
    directions: Array,
) -> Array:  # fmt: skip
    """Log-likelihood of each ray under decay rates of the cells (1/m; of the visited ones in a sparse map)."""
    directory, strides, table = _laid_out(statistics, rates, outside)
    with np.errstate(divide="ignore"):
        log_table, log_outside = np.log(table), float(np.log(outside))
    out = np.empty(len(scan))
    spatial_decay_log_likelihoods(
        directory, table, log_table, strides, 1.0 if directory is None else float(BRICK), statistics.grid.shape,
        outside, log_outside, np.array(statistics.grid.origin), statistics.grid.resolution, origins, directions,
        scan.ranges, scan.status, np.array(scan.range_limits), out,
    )  # fmt: skip
    return out


def posterior_log_likelihood(
    statistics: RayStatistics | BrickStatistics, shapes: Array, paths: Array, prior: tuple[float, float], scan: Scan,
    origins: Array, directions: Array,
) -> Array:  # fmt: skip
    """Log-likelihood of each ray under Gamma posteriors of the cells; ``prior`` is that of all others."""
    directory, strides, shape_table = _laid_out(statistics, shapes, prior[0])
    _, _, path_table = _laid_out(statistics, paths, prior[1])
    out = np.empty(len(scan))
    spatial_posterior_log_likelihoods(
        directory, shape_table, path_table, strides, statistics.grid.shape, *prior, np.array(statistics.grid.origin),
        statistics.grid.resolution, origins, directions, scan.ranges, scan.status, np.array(scan.range_limits), out,
    )  # fmt: skip
    return out


def _laid_out(
    statistics: RayStatistics | BrickStatistics, values: Array, outside: float
) -> tuple[npt.NDArray[np.int32] | None, tuple[int, int, int], npt.NDArray[np.floating]]:
    if isinstance(statistics, BrickStatistics):
        table = CellTable.from_cells(statistics, values, outside)
        return table.layout.directory, table.layout.strides, table.pool.ravel()
    _, n_y, n_z = statistics.grid.shape
    flat = np.pad(values, 1, constant_values=outside).ravel()
    return None, ((n_y + 2) * (n_z + 2), n_z + 2, 1), flat
