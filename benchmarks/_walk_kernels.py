"""The package's column walk applied to many rays, as its likelihoods and scan costs apply it."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from factorloc._jit import kernel
from factorloc.mapping._forward_kernels import integrate, walk_columns

Array = npt.NDArray[np.float64]


@kernel(allocates=False)
def forward(
    rates: Array,
    log_rates: Array,
    stride: int,
    low: Array,
    resolution: float,
    origins: Array,
    directions: Array,
    lengths: Array,
    first: int,
    last: int,
    out: Array,
) -> None:
    """Log-likelihoods of the returns ``first:last``; arguments as :func:`benchmarks._plain_kernels.plain_forward`."""
    inverse = 1.0 / resolution
    for k in range(first, last):
        p_x = (origins[k, 0] - low[0]) * inverse + 1.0
        p_y = (origins[k, 1] - low[1]) * inverse + 1.0
        v_x = directions[k, 0] * inverse
        v_y = directions[k, 1] * inverse
        length = lengths[k]
        cell = math.floor(p_x + v_x * length) * stride + math.floor(p_y + v_y * length)
        out[k] = log_rates[cell] - integrate(rates, stride, p_x, p_y, v_x, v_y, 0.0, length)


@kernel(allocates=False)
def gradient(
    rates: Array,
    log_rates: Array,
    stride: int,
    low: Array,
    resolution: float,
    origins: Array,
    directions: Array,
    lengths: Array,
    first: int,
    last: int,
    out: Array,
    jumps: Array,
) -> None:
    """Log-likelihoods and jumps of the returns ``first:last``; see :func:`benchmarks._plain_kernels.plain_gradient`."""
    inverse = 1.0 / resolution
    for k in range(first, last):
        p_x = (origins[k, 0] - low[0]) * inverse + 1.0
        p_y = (origins[k, 1] - low[1]) * inverse + 1.0
        v_x = directions[k, 0] * inverse
        v_y = directions[k, 1] * inverse
        length = lengths[k]
        cell = math.floor(p_x + v_x * length) * stride + math.floor(p_y + v_y * length)
        integral, jump_x, jump_y, moment_x, moment_y = walk_columns(rates, stride, p_x, p_y, v_x, v_y, 0.0, length)
        out[k] = log_rates[cell] - integral
        jumps[k, 0] = jump_x
        jumps[k, 1] = jump_y
        jumps[k, 2] = moment_x
        jumps[k, 3] = moment_y
