"""Plain walks through planar grids, compiled like the package's own: what those are measured against.

One ray after the other is walked as Amanatides and Woo (1987) describe it: the nearer of the next two grid lines is
crossed, and the parameter of the following line is found by adding up. Rays lie inside the grid; nothing is clipped.
Arrays have a rim of one cell, so that the grids are those of the package.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from factorloc._jit import kernel

Array = npt.NDArray[np.float64]


@kernel
def start(stride: int, p_x: float, p_y: float, v_x: float, v_y: float, length: float) -> tuple[float, ...]:
    """First cell, number of crossings, and for each axis: first crossing, distance to the next, and step of the cell.

    Positions are in cells of the rimmed array, ``v`` is a direction divided by the resolution.
    """
    i_x = math.floor(p_x)
    i_y = math.floor(p_y)
    lines_x = abs(math.floor(p_x + v_x * length) - i_x)
    lines_y = abs(math.floor(p_y + v_y * length) - i_y)
    d_x = 1.0 / abs(v_x)
    d_y = 1.0 / abs(v_y)
    # A ray along a line may cross it by its direction and not by its end, which is rounded; the end decides.
    t_x = (i_x + 1.0 - p_x if v_x > 0.0 else p_x - i_x) * d_x if lines_x > 0 else math.inf
    t_y = (i_y + 1.0 - p_y if v_y > 0.0 else p_y - i_y) * d_y if lines_y > 0 else math.inf
    step_x = stride if v_x > 0.0 else -stride
    step_y = 1 if v_y > 0.0 else -1
    return i_x * stride + i_y, lines_x + lines_y, t_x, t_y, d_x, d_y, step_x, step_y


@kernel
def plain_accumulate(
    origins: Array,
    directions: Array,
    lengths: Array,
    low: Array,
    resolution: float,
    stride: int,
    path: npt.NDArray[np.float32],
    hits: npt.NDArray[np.uint32],
) -> int:
    """Add the path length of each ray to the cells it crosses and a hit to its last; returns the cells visited.

    Parameters
    ----------
    origins, directions : (M, 2) float64
        Rays in the frame of the grid, m and unit vectors.
    lengths : (M,) float64
        m.
    low : (2,) float64
        Lowest corner of the grid without rim, m.
    resolution : float
        Edge length of a cell, m.
    stride : int
        Cells along y, with rim.
    path : (cells with rim,) float32
        Path lengths, m; added to.
    hits : (cells with rim,) uint32
        Added to.
    """
    inverse = 1.0 / resolution
    visited = 0
    for k in range(lengths.shape[0]):
        p_x = (origins[k, 0] - low[0]) * inverse + 1.0
        p_y = (origins[k, 1] - low[1]) * inverse + 1.0
        v_x = directions[k, 0] * inverse
        v_y = directions[k, 1] * inverse
        cell, crossings, t_x, t_y, d_x, d_y, step_x, step_y = start(stride, p_x, p_y, v_x, v_y, lengths[k])
        t = 0.0
        for _ in range(crossings):
            if t_x < t_y:
                path[cell] += t_x - t
                t = t_x
                t_x += d_x
                cell += step_x
            else:
                path[cell] += t_y - t
                t = t_y
                t_y += d_y
                cell += step_y
        path[cell] += lengths[k] - t
        hits[cell] += 1
        visited += crossings + 1
    return visited


@kernel
def plain_forward(
    rates: Array,
    log_rates: Array,
    stride: int,
    low: Array,
    resolution: float,
    origins: Array,
    directions: Array,
    lengths: Array,
    out: Array,
) -> None:
    """Log-likelihood of each return, ``log rate(end) - integral of the rate``; written to ``out`` (M,).

    ``rates`` (1/m) and ``log_rates`` are flat with rim; the other arguments are those of :func:`plain_accumulate`.
    """
    inverse = 1.0 / resolution
    for k in range(lengths.shape[0]):
        p_x = (origins[k, 0] - low[0]) * inverse + 1.0
        p_y = (origins[k, 1] - low[1]) * inverse + 1.0
        v_x = directions[k, 0] * inverse
        v_y = directions[k, 1] * inverse
        cell, crossings, t_x, t_y, d_x, d_y, step_x, step_y = start(stride, p_x, p_y, v_x, v_y, lengths[k])
        t = 0.0
        integral = 0.0
        for _ in range(crossings):
            if t_x < t_y:
                integral += rates[cell] * (t_x - t)
                t = t_x
                t_x += d_x
                cell += step_x
            else:
                integral += rates[cell] * (t_y - t)
                t = t_y
                t_y += d_y
                cell += step_y
        out[k] = log_rates[cell] - integral - rates[cell] * (lengths[k] - t)


@kernel
def plain_gradient(
    rates: Array,
    log_rates: Array,
    stride: int,
    low: Array,
    resolution: float,
    origins: Array,
    directions: Array,
    lengths: Array,
    out: Array,
    jumps: Array,
) -> None:
    """Log-likelihoods as :func:`plain_forward`, and what their gradient is made of.

    ``jumps`` (M, 4) is written: sums over the lines crossed along x and along y of the change of the rate, and of the
    change times the ray parameter, in the order of :func:`factorloc.mapping._forward_kernels.walk_columns`.
    """
    inverse = 1.0 / resolution
    for k in range(lengths.shape[0]):
        p_x = (origins[k, 0] - low[0]) * inverse + 1.0
        p_y = (origins[k, 1] - low[1]) * inverse + 1.0
        v_x = directions[k, 0] * inverse
        v_y = directions[k, 1] * inverse
        cell, crossings, t_x, t_y, d_x, d_y, step_x, step_y = start(stride, p_x, p_y, v_x, v_y, lengths[k])
        t = 0.0
        integral = 0.0
        jump_x = 0.0
        jump_y = 0.0
        moment_x = 0.0
        moment_y = 0.0
        rate = rates[cell]
        for _ in range(crossings):
            if t_x < t_y:
                integral += rate * (t_x - t)
                t = t_x
                t_x += d_x
                cell += step_x
                change = rates[cell] - rate
                jump_x += change
                moment_x += change * t
            else:
                integral += rate * (t_y - t)
                t = t_y
                t_y += d_y
                cell += step_y
                change = rates[cell] - rate
                jump_y += change
                moment_y += change * t
            rate += change
        out[k] = log_rates[cell] - integral - rate * (lengths[k] - t)
        jumps[k, 0] = jump_x
        jumps[k, 1] = jump_y
        jumps[k, 2] = moment_x
        jumps[k, 3] = moment_y
