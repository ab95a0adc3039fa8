"""Integrals of piecewise constant decay rates along planar rays, with and without their gradient.

The walk runs along the dominant axis of a ray, one column of cells a step. In a column a ray meets at most two cells,
``rate_0`` where it enters and ``rate_1`` where it leaves; the piece in the second is ``(y - line) / v_b`` long, with
``y`` the minor coordinate at the exit and ``line`` the grid line in between. The column's integral is then

    rate_0 * column length + (rate_1 - rate_0) * (y - line) / v_b,

true also where no line is crossed, as both rates are one. So the loop has no branch to mispredict, and four sums over
the columns carry the integral and its whole gradient.

Rates lie in arrays with a rim of one cell that holds the rate outside the grid, so that rounding at the border stays
inside the array. Walks work in cells of the rimmed array: ``p`` is a position with the array's corner at 0 (the grid
begins at 1), ``v`` a direction divided by the resolution, so that the ray parameter ``t`` is in metres.
"""

import math

import numpy as np

from factorloc._jit import kernel
from factorloc.mapping._traversal_kernels import clip_ray

_STEEPEST = 1.0 - 2.0**-36  # cells/column; a ray at 45 degrees, from corner to corner, skips no cell by rounding
_PARALLEL_TO_AXIS = 1e-9  # cells/m; a ray this close to an axis crosses no line it does not lie on


@kernel(allocates=False, inline=True)
def walk_columns(rates, stride, p_x, p_y, v_x, v_y, t_in, t_out):
    """Integral of the decay rate between two ray parameters inside the grid, and its jumps at the lines crossed.

    Moving a ray shifts its crossings: a line across axis ``a`` met at ``t`` moves by ``dt = -e_a . (do + t dv) / v_a``.
    The integral changes by ``sum (rate after - rate before) e_a . (do + t dv) / v_a`` (both ends fixed in ``t``).

    Parameters
    ----------
    rates : (cells with rim,) float
        Decay rates, 1/m.
    stride : int
        Cells with rim along y.
    p_x, p_y, v_x, v_y : float
        Ray in cells of the rimmed array.
    t_in, t_out : float
        Part to integrate over, m; within the rimmed array.

    Returns
    -------
    total : float
        The integral, without unit.
    jump_x, jump_y : float
        Sum of rate changes at lines across x and y, 1/m.
    moment_x, moment_y : float
        Sum of rate changes times ray parameter.
    """
    along_x = abs(v_x) >= abs(v_y)
    p_a, v_a, s_a = (p_x, v_x, stride) if along_x else (p_y, v_y, 1)
    p_b, v_b, s_b = (p_y, v_y, 1) if along_x else (p_x, v_x, stride)
    first = math.floor(p_a + v_a * t_in)
    columns = abs(math.floor(p_a + v_a * t_out) - first)  # without the last
    i_a = 1.0 / v_a
    i_b = 1.0 / v_b if abs(v_b) > _PARALLEL_TO_AXIS else 0.0
    pace = abs(i_a)
    slope = min(max(v_b * pace, -_STEEPEST), _STEEPEST)
    next_column = s_a if v_a > 0.0 else -s_a

    # The first column is walked from its own line, which lies before t_in; what is too much is taken off at the end.
    t_first = ((first if v_a > 0.0 else first + 1.0) - p_a) * i_a
    y = p_b + v_b * t_first
    below = np.floor(y + slope)
    line = min(max(np.floor(p_b + v_b * t_in), below - 1.0), below + 1.0)
    column = first * s_a
    cell = column + int(line) * s_b
    # An unsigned index need not be asked whether it counts from the end.
    rate_in = rates[np.uint64(cell)]
    # Sums of rates, and of rate changes plain, times (y - line) and times the number of the column's exit.
    sum_rate = 0.0
    sum_change = 0.0
    sum_piece = 0.0
    sum_number = 0.0
    for k in range(1, columns + 1):
        y += slope
        below = np.floor(y)
        rate = rates[np.uint64(cell)]
        cell = column + int(y) * s_b
        change = rates[np.uint64(cell)] - rate
        sum_rate += rate
        sum_change += change
        sum_piece += change * (y - max(line, below))
        sum_number += change * k
        column += next_column
        cell += next_column
        line = below

    # Last column, from its line to t_out.
    t_last = t_first + columns * pace
    y = p_b + v_b * t_out
    below = min(max(np.floor(y), line - 1.0), line + 1.0)
    rate = rates[np.uint64(cell)]
    rate_out = rates[np.uint64(column + int(below) * s_b)]
    change = rate_out - rate
    pieces = (sum_piece + change * (y - max(line, below))) * i_b
    total = sum_rate * pace + rate * (t_out - t_last) - rate_in * (t_in - t_first) + pieces

    # All lines together: the changes add up to rate_out - rate_in, and by parts, with the changes times t, the integral
    # is rate_out t_out - rate_in t_in less their sum. What is not across b is across a.
    jump_b = sum_change + change
    moment_b = sum_change * t_first + sum_number * pace + change * t_out - pieces
    jump_a = rate_out - rate_in - jump_b
    moment_a = rate_out * t_out - rate_in * t_in - total - moment_b
    if along_x:
        return total, jump_a, jump_b, moment_a, moment_b
    return total, jump_b, jump_a, moment_b, moment_a


@kernel(allocates=False)
def integrate(rates, stride, p_x, p_y, v_x, v_y, t_in, t_out):
    """Integral of :func:`walk_columns` alone; the compiler drops the rest."""
    return walk_columns(rates, stride, p_x, p_y, v_x, v_y, t_in, t_out)[0]


@kernel(allocates=False)
def decay_log_likelihoods(
    rates, log_rates, shape, outside, log_outside, low, resolution, origins, directions, lengths, status, limits, out
):
    """Log-likelihood of each ray under constant decay rates (thesis, eq. 7.13 to 7.16).

    A return has the density ``log rate(end) - integral``, 1/m; a ray without return the probability
    ``exp(-integral to the maximum)``, one below the minimum ``1 - exp(-integral to the minimum)``. Integrals stop
    exactly at the limits, inside a cell, so that the three add up to one.

    Parameters
    ----------
    rates, log_rates : (cells with rim,) float64
        Decay rates and their logarithms.
    shape : (int, int)
        Cells without rim.
    outside, log_outside : float
        Rate outside the grid.
    low : (2,) float64
    resolution : float
    origins, directions : (M, 2) float64
        Rays in the frame of the map.
    lengths : (M,) float64
    status : (M,) uint8
        0 return, 1 below minimum, 2 no return.
    limits : (2,) float64
        Minimum and maximum range, m.
    out : (M,) float64
        Written.
    """
    n_x, n_y = shape
    inverse = 1.0 / resolution
    for k in range(lengths.shape[0]):
        p_x = (origins[k, 0] - low[0]) * inverse
        p_y = (origins[k, 1] - low[1]) * inverse
        v_x = directions[k, 0] * inverse
        v_y = directions[k, 1] * inverse
        length = lengths[k]
        if status[k] == 1:
            length = limits[0]
        elif status[k] == 2:
            length = limits[1]
        t_in, t_out = clip_ray(p_x, p_y, v_x, v_y, length, n_x, n_y)
        if t_in < t_out:
            integral = integrate(rates, n_y + 2, p_x + 1.0, p_y + 1.0, v_x, v_y, t_in, t_out)
            integral += outside * (length - (t_out - t_in))
        else:
            integral = outside * length
        if status[k] == 2:
            out[k] = -integral
        elif status[k] == 1:
            out[k] = math.log(-math.expm1(-integral)) if integral > 0.0 else -math.inf
        else:
            i_x = math.floor(p_x + v_x * length)
            i_y = math.floor(p_y + v_y * length)
            log_rate = log_outside
            if 0 <= i_x < n_x and 0 <= i_y < n_y:
                log_rate = log_rates[(i_x + 1) * (n_y + 2) + i_y + 1]
            out[k] = log_rate - integral


@kernel(allocates=False)
def posterior_log_likelihoods(
    shapes, paths, shape, prior_shape, prior_path, low, resolution, origins, directions, lengths, status, limits, out
):
    """Log-likelihood of each ray under Gamma posteriors of the rates (thesis, l_dec of section 8.4.5).

    A cell with posterior ``Gamma(a, b)`` lets a path ``r`` pass with probability ``(b / (b + r))^a`` and ends it with
    density ``a / (b + r)`` besides. Arguments as :func:`decay_log_likelihoods`, with ``shapes`` (a = H + alpha) and
    ``paths`` (b = R + beta) instead of rates; what lies outside the grid is one cell with the prior.
    """
    n_x, n_y = shape
    width = n_y + 2
    inverse = 1.0 / resolution
    for k in range(lengths.shape[0]):
        p_x = (origins[k, 0] - low[0]) * inverse
        p_y = (origins[k, 1] - low[1]) * inverse
        v_x = directions[k, 0] * inverse
        v_y = directions[k, 1] * inverse
        length = lengths[k]
        if status[k] == 1:
            length = limits[0]
        elif status[k] == 2:
            length = limits[1]
        t_in, t_out = clip_ray(p_x, p_y, v_x, v_y, length, n_x, n_y)
        through = t_in <= t_out
        passed_outside = length - (t_out - t_in) if through else length
        log_pass = -prior_shape * math.log1p(passed_outside / prior_path)
        end_shape = prior_shape
        end_path = prior_path + passed_outside
        if through:
            i_x = min(max(math.floor(p_x + v_x * t_in), 0), n_x - 1)
            i_y = min(max(math.floor(p_y + v_y * t_in), 0), n_y - 1)
            e_x = min(max(math.floor(p_x + v_x * t_out), 0), n_x - 1)
            e_y = min(max(math.floor(p_y + v_y * t_out), 0), n_y - 1)
            line_x = i_x + 1.0 if v_x > 0.0 else float(i_x)
            line_y = i_y + 1.0 if v_y > 0.0 else float(i_y)
            step_x = 1 if v_x > 0.0 else -1
            step_y = 1 if v_y > 0.0 else -1
            # A ray along a line may cross it by its direction and not by its end, which is rounded; the end decides.
            t_x = (line_x - p_x) / v_x if i_x != e_x else math.inf
            t_y = (line_y - p_y) / v_y if i_y != e_y else math.inf
            cell = (i_x + 1) * width + i_y + 1
            t = t_in
            for _ in range(abs(e_x - i_x) + abs(e_y - i_y)):
                t_next = max(min(min(t_x, t_y), t_out), t)
                log_pass -= shapes[cell] * math.log1p((t_next - t) / paths[cell])
                t = t_next
                if t_x < t_y:
                    cell += step_x * width
                    line_x += step_x
                    t_x = (line_x - p_x) / v_x
                else:
                    cell += step_y
                    line_y += step_y
                    t_y = (line_y - p_y) / v_y
            cell = (e_x + 1) * width + e_y + 1
            last = max(t_out - t, 0.0)
            log_pass -= shapes[cell] * math.log1p(last / paths[cell])
            end_x = math.floor(p_x + v_x * length)
            end_y = math.floor(p_y + v_y * length)
            if 0 <= end_x < n_x and 0 <= end_y < n_y:
                end_shape = shapes[cell]
                end_path = paths[cell] + last
        if status[k] == 2:
            out[k] = log_pass
        elif status[k] == 1:
            out[k] = math.log(-math.expm1(log_pass)) if log_pass < 0.0 else -math.inf
        else:
            out[k] = math.log(end_shape / end_path) + log_pass
