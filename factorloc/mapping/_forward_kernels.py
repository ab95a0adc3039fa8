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
