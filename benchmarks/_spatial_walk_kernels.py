"""The package's layer walk applied to many rays, through a dense grid or through bricks."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from factorloc._jit import kernel
from factorloc.mapping._spatial_forward_kernels import cell_of, integrate_spatial, row_of, walk_layers

Array = npt.NDArray[np.float64]
Directory = npt.NDArray[np.int32] | None
Rates = npt.NDArray[np.float32]
Strides = tuple[int, int, int]


@kernel(allocates=False)
def log_rate(directory: Directory, rates: Rates, strides: Strides, x: float, y: float, z: float) -> float:
    """Logarithm of the rate at a place, given in cells with the rim's corner at 0."""
    row, local = row_of(directory, int(x), int(y), strides[0], strides[1], 8, 4)
    return math.log(np.float64(rates[cell_of(directory, row, local, int(z), strides[2], 0)]))


@kernel(allocates=False)
def forward(
    origins: Array,
    directions: Array,
    lengths: Array,
    low: Array,
    resolution: float,
    directory: Directory,
    rates: Rates,
    strides: Strides,
    rim: float,
    first: int,
    last: int,
    out: Array,
) -> None:
    """Log-likelihoods of the returns ``first:last``; written to ``out`` (M,).

    Parameters
    ----------
    origins, directions, lengths, low, resolution
        As :func:`benchmarks._spatial_plain_kernels.plain_accumulate`.
    directory, rates, strides
        As :func:`factorloc.mapping._spatial_forward_kernels.walk_layers`.
    rim : float
        Width of the rim, in cells.
    """
    inverse = 1.0 / resolution
    for k in range(first, last):
        p_x = (origins[k, 0] - low[0]) * inverse + rim
        p_y = (origins[k, 1] - low[1]) * inverse + rim
        p_z = (origins[k, 2] - low[2]) * inverse + rim
        v_x = directions[k, 0] * inverse
        v_y = directions[k, 1] * inverse
        v_z = directions[k, 2] * inverse
        length = lengths[k]
        end = log_rate(directory, rates, strides, p_x + v_x * length, p_y + v_y * length, p_z + v_z * length)
        out[k] = end - integrate_spatial(directory, rates, strides, p_x, p_y, p_z, v_x, v_y, v_z, 0.0, length)


@kernel(allocates=False)
def gradient(
    origins: Array,
    directions: Array,
    lengths: Array,
    low: Array,
    resolution: float,
    directory: Directory,
    rates: Rates,
    strides: Strides,
    rim: float,
    first: int,
    last: int,
    out: Array,
    jumps: Array,
) -> None:
    """Log-likelihoods as :func:`forward`, and jumps: see :func:`benchmarks._spatial_plain_kernels.plain_gradient`."""
    inverse = 1.0 / resolution
    for k in range(first, last):
        p_x = (origins[k, 0] - low[0]) * inverse + rim
        p_y = (origins[k, 1] - low[1]) * inverse + rim
        p_z = (origins[k, 2] - low[2]) * inverse + rim
        v_x = directions[k, 0] * inverse
        v_y = directions[k, 1] * inverse
        v_z = directions[k, 2] * inverse
        length = lengths[k]
        end = log_rate(directory, rates, strides, p_x + v_x * length, p_y + v_y * length, p_z + v_z * length)
        integral, jump_x, jump_y, jump_z, moment_x, moment_y, moment_z = walk_layers(
            directory, rates, strides, p_x, p_y, p_z, v_x, v_y, v_z, 0.0, length
        )
        out[k] = end - integral
        jumps[k, 0] = jump_x
        jumps[k, 1] = jump_y
        jumps[k, 2] = jump_z
        jumps[k, 3] = moment_x
        jumps[k, 4] = moment_y
        jumps[k, 5] = moment_z
