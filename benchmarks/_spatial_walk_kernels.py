"""The package's layer walk applied to many rays, through a dense grid or through bricks."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from factorloc._jit import kernel
from factorloc.mapping._spatial_forward_kernels import walk_layers

Array = npt.NDArray[np.float64]
Directory = npt.NDArray[np.int32] | None
Rates = npt.NDArray[np.float32]
Strides = tuple[int, int, int]


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
        walked = walk_layers(directory, rates, strides, p_x, p_y, p_z, v_x, v_y, v_z, 0.0, lengths[k])
        out[k] = math.log(np.float32(walked[1])) - walked[0]  # the rate has no more digits


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
        integral, rate, jump_x, jump_y, jump_z, moment_x, moment_y, moment_z = walk_layers(
            directory, rates, strides, p_x, p_y, p_z, v_x, v_y, v_z, 0.0, lengths[k]
        )
        out[k] = math.log(np.float32(rate)) - integral
        jumps[k, 0] = jump_x
        jumps[k, 1] = jump_y
        jumps[k, 2] = jump_z
        jumps[k, 3] = moment_x
        jumps[k, 4] = moment_y
        jumps[k, 5] = moment_z
