"""Plain walks through dense spatial grids, compiled like the package's own: what those are measured against.

The walks of the plain planar kernels, with one axis more: the nearest of the next three planes is crossed, and the
parameter of the following one is found by adding up. Rays lie inside the grid; nothing is clipped. Arrays have a rim of
one cell, so that the grids are those of the package.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from factorloc._jit import kernel

Array = npt.NDArray[np.float64]
Rates = npt.NDArray[np.float32]


@kernel
def start_axis(p: float, v: float, length: float) -> tuple[float, ...]:
    """First cell along an axis, number of planes crossed, parameter of the first, and distance to the next."""
    i = math.floor(p)
    planes = abs(math.floor(p + v * length) - i)
    d = 1.0 / abs(v)
    # A ray along a plane may cross it by its direction and not by its end, which is rounded; the end decides.
    t = (i + 1.0 - p if v > 0.0 else p - i) * d if planes > 0 else math.inf
    return i, planes, t, d


@kernel
def plain_accumulate(
    origins: Array,
    directions: Array,
    lengths: Array,
    low: Array,
    resolution: float,
    stride_x: int,
    stride_y: int,
    path: npt.NDArray[np.float32],
    hits: npt.NDArray[np.uint32],
) -> int:
    """Add the path length of each ray to the cells it crosses and a hit to its last; returns the cells visited.

    Parameters
    ----------
    origins, directions : (M, 3) float64
        Rays in the frame of the grid, m and unit vectors.
    lengths : (M,) float64
        m.
    low : (3,) float64
        Lowest corner of the grid without rim, m.
    resolution : float
        Edge length of a cell, m.
    stride_x, stride_y : int
        Strides of the cells along x and y, with rim.
    path : (cells with rim,) float32
        Path lengths, m; added to.
    hits : (cells with rim,) uint32
        Added to.
    """
    inverse = 1.0 / resolution
    visited = 0
    for k in range(lengths.shape[0]):
        v_x = directions[k, 0] * inverse
        v_y = directions[k, 1] * inverse
        v_z = directions[k, 2] * inverse
        i_x, planes_x, t_x, d_x = start_axis((origins[k, 0] - low[0]) * inverse + 1.0, v_x, lengths[k])
        i_y, planes_y, t_y, d_y = start_axis((origins[k, 1] - low[1]) * inverse + 1.0, v_y, lengths[k])
        i_z, planes_z, t_z, d_z = start_axis((origins[k, 2] - low[2]) * inverse + 1.0, v_z, lengths[k])
        step_x = stride_x if v_x > 0.0 else -stride_x
        step_y = stride_y if v_y > 0.0 else -stride_y
        step_z = 1 if v_z > 0.0 else -1
        cell = i_x * stride_x + i_y * stride_y + i_z
        crossings = planes_x + planes_y + planes_z
        t = 0.0
        for _ in range(crossings):
            if t_x < t_y and t_x < t_z:
                path[cell] += t_x - t
                t = t_x
                t_x += d_x
                cell += step_x
            elif t_y < t_z:
                path[cell] += t_y - t
                t = t_y
                t_y += d_y
                cell += step_y
            else:
                path[cell] += t_z - t
                t = t_z
                t_z += d_z
                cell += step_z
        path[cell] += lengths[k] - t
        hits[cell] += 1
        visited += crossings + 1
    return visited


@kernel
def plain_forward(
    origins: Array,
    directions: Array,
    lengths: Array,
    low: Array,
    resolution: float,
    stride_x: int,
    stride_y: int,
    rates: Rates,
    out: Array,
) -> None:
    """Log-likelihood of each return, ``log rate(end) - integral of the rate``; written to ``out`` (M,).

    ``rates`` (1/m) is flat with rim; the other arguments are those of :func:`plain_accumulate`.
    """
    inverse = 1.0 / resolution
    for k in range(lengths.shape[0]):
        v_x = directions[k, 0] * inverse
        v_y = directions[k, 1] * inverse
        v_z = directions[k, 2] * inverse
        i_x, planes_x, t_x, d_x = start_axis((origins[k, 0] - low[0]) * inverse + 1.0, v_x, lengths[k])
        i_y, planes_y, t_y, d_y = start_axis((origins[k, 1] - low[1]) * inverse + 1.0, v_y, lengths[k])
        i_z, planes_z, t_z, d_z = start_axis((origins[k, 2] - low[2]) * inverse + 1.0, v_z, lengths[k])
        step_x = stride_x if v_x > 0.0 else -stride_x
        step_y = stride_y if v_y > 0.0 else -stride_y
        step_z = 1 if v_z > 0.0 else -1
        cell = i_x * stride_x + i_y * stride_y + i_z
        t = 0.0
        integral = 0.0
        for _ in range(planes_x + planes_y + planes_z):
            if t_x < t_y and t_x < t_z:
                integral += rates[cell] * (t_x - t)
                t = t_x
                t_x += d_x
                cell += step_x
            elif t_y < t_z:
                integral += rates[cell] * (t_y - t)
                t = t_y
                t_y += d_y
                cell += step_y
            else:
                integral += rates[cell] * (t_z - t)
                t = t_z
                t_z += d_z
                cell += step_z
        rate = np.float64(rates[cell])
        out[k] = math.log(rate) - integral - rate * (lengths[k] - t)


@kernel
def plain_gradient(
    origins: Array,
    directions: Array,
    lengths: Array,
    low: Array,
    resolution: float,
    stride_x: int,
    stride_y: int,
    rates: Rates,
    out: Array,
    jumps: Array,
) -> None:
    """Log-likelihoods as :func:`plain_forward`, and what their gradient is made of.

    ``jumps`` (M, 6) is written: sums over the planes crossed along x, y and z of the change of the rate, and of the
    change times the ray parameter, in the order of :func:`factorloc.mapping._spatial_forward_kernels.walk_layers`.
    """
    inverse = 1.0 / resolution
    for k in range(lengths.shape[0]):
        v_x = directions[k, 0] * inverse
        v_y = directions[k, 1] * inverse
        v_z = directions[k, 2] * inverse
        i_x, planes_x, t_x, d_x = start_axis((origins[k, 0] - low[0]) * inverse + 1.0, v_x, lengths[k])
        i_y, planes_y, t_y, d_y = start_axis((origins[k, 1] - low[1]) * inverse + 1.0, v_y, lengths[k])
        i_z, planes_z, t_z, d_z = start_axis((origins[k, 2] - low[2]) * inverse + 1.0, v_z, lengths[k])
        step_x = stride_x if v_x > 0.0 else -stride_x
        step_y = stride_y if v_y > 0.0 else -stride_y
        step_z = 1 if v_z > 0.0 else -1
        cell = i_x * stride_x + i_y * stride_y + i_z
        t = 0.0
        integral = 0.0
        jump_x = 0.0
        jump_y = 0.0
        jump_z = 0.0
        moment_x = 0.0
        moment_y = 0.0
        moment_z = 0.0
        rate = np.float64(rates[cell])
        for _ in range(planes_x + planes_y + planes_z):
            if t_x < t_y and t_x < t_z:
                integral += rate * (t_x - t)
                t = t_x
                t_x += d_x
                cell += step_x
                change = rates[cell] - rate
                jump_x += change
                moment_x += change * t
            elif t_y < t_z:
                integral += rate * (t_y - t)
                t = t_y
                t_y += d_y
                cell += step_y
                change = rates[cell] - rate
                jump_y += change
                moment_y += change * t
            else:
                integral += rate * (t_z - t)
                t = t_z
                t_z += d_z
                cell += step_z
                change = rates[cell] - rate
                jump_z += change
                moment_z += change * t
            rate += change
        out[k] = math.log(rate) - integral - rate * (lengths[k] - t)
        jumps[k, 0] = jump_x
        jumps[k, 1] = jump_y
        jumps[k, 2] = jump_z
        jumps[k, 3] = moment_x
        jumps[k, 4] = moment_y
        jumps[k, 5] = moment_z
