"""Integrals of piecewise constant decay rates along rays in space, with and without their gradient.

The walk of the planar kernels, in three dimensions: it runs along the dominant axis ``a`` of a ray, one layer of cells
a step. In a layer the ray crosses at most one plane across the second axis ``b``, and rarely one across the least axis
``c``. Without the latter it meets at most two cells, and no branch has to be foretold. A plane across ``c``, met
``rest_c`` before the layer's exit, adds ``d_at * rest_c``, with ``d_at`` the rate behind it less the rate before it.

Rates lie in a dense array with a rim of one cell, or in bricks of 16 x 16 x 16 that a directory with a rim of one brick
finds; brick 0 stands for all that are not there. Walks work in cells, with the rim's corner at 0; ``v`` is a direction
divided by the resolution, so that the ray parameter ``t`` is in metres.
"""

import math

import numpy as np

from factorloc._jit import kernel

_STEEPEST = 1.0 - 2.0**-36  # cells/layer; a ray along a diagonal skips no cell by rounding
_PARALLEL_TO_AXIS = 1e-9  # cells/m; a ray this close to a plane crosses no line it does not lie on


@kernel(allocates=False, inline=True)
def cell_of(directory, row, local, b, stride_b, pitch_b):
    """Address of the cell ``b`` of a row along the second axis."""
    # An unsigned index need not be asked whether it counts from the end.
    if directory is None:
        return np.uint64(local + b * stride_b)
    brick = np.int64(directory[np.uint64(row + (b >> 4) * stride_b)])
    return np.uint64((brick << 12) + local + (b & 15) * pitch_b)


@kernel(allocates=False, inline=True)
def row_of(directory, row_0, local_0, i, c, stride_a, stride_c, pitch_a, pitch_c):
    """Where a row begins: in the directory, and in the array or a brick; counted from where the cells begin."""
    if directory is None:
        return row_0, local_0 + i * stride_a + c * stride_c
    return row_0 + (i >> 4) * stride_a + (c >> 4) * stride_c, local_0 + (i & 15) * pitch_a + (c & 15) * pitch_c


@kernel(allocates=False, inline=True)
def walk_layers(directory, rates, strides, p_x, p_y, p_z, v_x, v_y, v_z, t_in, t_out):
    """Integral of the decay rate between two ray parameters inside the grid, and its jumps at the planes crossed.

    Parameters
    ----------
    directory : None or int32, flat
        None for a dense array; else the brick of every place.
    rates : float, flat
        Decay rates, 1/m: a dense array, or a pool of bricks.
    strides : (int, int, int)
        Of the dense array, or of the directory.
    p_x, p_y, p_z, v_x, v_y, v_z : float
        Ray in cells, with the rim's corner at 0.
    t_in, t_out : float
        Part to integrate over, m.

    Returns
    -------
    total : float
        The integral, without unit.
    rate_out : float
        The rate at the end, 1/m.
    jump_x, jump_y, jump_z : float
        Sum of rate changes at planes across each axis, 1/m.
    moment_x, moment_y, moment_z : float
        Sum of rate changes times ray parameter.
    """
    s_x, s_y, s_z = strides
    f_x = abs(v_x)
    f_y = abs(v_y)
    f_z = abs(v_z)
    if f_x >= f_y and f_x >= f_z:
        axis = 0
        p_a, v_a, s_a, h_a = p_x, v_x, s_x, 256
        p_b, v_b, s_b, h_b = p_y, v_y, s_y, 16
        p_c, v_c, s_c, h_c = p_z, v_z, s_z, 1
    elif f_y >= f_z:
        axis = 1
        p_a, v_a, s_a, h_a = p_y, v_y, s_y, 16
        p_b, v_b, s_b, h_b = p_x, v_x, s_x, 256
        p_c, v_c, s_c, h_c = p_z, v_z, s_z, 1
    else:
        axis = 2
        p_a, v_a, s_a, h_a = p_z, v_z, s_z, 1
        p_b, v_b, s_b, h_b = p_x, v_x, s_x, 256
        p_c, v_c, s_c, h_c = p_y, v_y, s_y, 16
    swapped = abs(v_c) > abs(v_b)
    if swapped:
        p_b, v_b, s_b, h_b, p_c, v_c, s_c, h_c = p_c, v_c, s_c, h_c, p_b, v_b, s_b, h_b

    # The cells across b at both ends; the walk may differ from them by rounding, and then they are right.
    b = int(p_b + v_b * t_in)
    b_out = int(p_b + v_b * t_out)
    row_0 = 0
    local_0 = 0
    if v_b < 0.0:
        # A ray that falls along b rises in a mirror, which stands between two bricks.
        mirror = (b | 15) + 17
        p_b, v_b, b, b_out = mirror - p_b, -v_b, mirror - 1 - b, mirror - 1 - b_out
        if directory is None:
            local_0 = (mirror - 1) * s_b
        else:
            row_0 = ((mirror >> 4) - 1) * s_b
            local_0 = 15 * h_b
        s_b, h_b = -s_b, -h_b

    i = int(p_a + v_a * t_in)
    layers = abs(int(p_a + v_a * t_out) - i)  # without the last
    i_a = 1.0 / v_a
    i_b = 1.0 / v_b if v_b > _PARALLEL_TO_AXIS else 0.0
    pace = abs(i_a)
    slope = min(v_b * pace, _STEEPEST)
    step = 1 if v_a > 0.0 else -1

    # The first layer is walked from its own plane, which lies before t_in; what is too much is taken off at the end.
    t_first = ((i if v_a > 0.0 else i + 1.0) - p_a) * i_a
    y = p_b + v_b * t_first
    b_exit = int(y + slope)
    b = min(max(b, b_exit - 1), b_exit)
    # Where the next plane across c is met, and in which layer: a whole number, so that the branch is foretold or seen
    # to be wrong before the sums are due.
    c = int(p_c + v_c * t_in)
    step_c = 1 if v_c > 0.0 else -1
    i_c = 0.0
    t_c = math.inf
    if abs(v_c) > _PARALLEL_TO_AXIS:
        i_c = 1.0 / v_c
        t_c = ((c + 1.0 if v_c > 0.0 else float(c)) - p_c) * i_c
        i_c = abs(i_c)
    f_a = abs(v_a)
    t_far = t_out + 2.0 * pace  # in no layer that is walked
    k_c = int((min(t_c, t_far) - t_first) * f_a)
    row, local = row_of(directory, row_0, local_0, i, c, s_a, s_c, h_a, h_c)
    step_local = step * s_a if directory is None else step * h_a
    edge = 0 if directory is None else (15 - (i & 15) if step > 0 else i & 15)
    cell = cell_of(directory, row, local, b, s_b, h_b)
    rate = np.float64(rates[cell])
    rate_in = rate
    # Sums of rates, of rate changes across b: plain, times way left in the layer, times its number; and across c.
    sum_rate = 0.0
    change_b = 0.0
    piece_b = 0.0
    number_b = 0.0
    change_c = 0.0
    piece_c = 0.0
    moment_c = 0.0
    for k in range(layers):
        y += slope
        b_exit = int(y)
        if directory is None or (b_exit ^ b) > 15:
            out = cell_of(directory, row, local, b_exit, s_b, h_b)
        else:
            out = np.uint64(np.int64(cell) + (b_exit - b) * h_b)
        rate_b = np.float64(rates[out])
        change = rate_b - rate
        rest = y - np.floor(y)  # behind the plane across b; without one there is no change to count
        if k == k_c:
            rest_c = t_first + (k + 1) * pace - t_c
            if directory is None:
                local += step_c * s_c
            else:
                row, local = row_of(directory, row_0, local_0, i, c + step_c, s_a, s_c, h_a, h_c)
            out = cell_of(directory, row, local, b_exit, s_b, h_b)
            d_out = np.float64(rates[out]) - rate_b
            d_in = rates[cell_of(directory, row, local, b, s_b, h_b)] - rate
            d_at = d_out if rest * i_b > rest_c else d_in
            change += d_out - d_at
            change_c += d_at
            piece_c += d_at * rest_c
            moment_c += d_at * t_c
            c += step_c
            t_c += i_c
            k_c = max(int((min(t_c, t_far) - t_first) * f_a), k + 1)
        sum_rate += rate
        change_b += change
        piece_b += change * rest
        number_b += change * k
        b = b_exit
        i += step
        if directory is None:
            local += step_local
            cell = np.uint64(np.int64(out) + step_local)
        elif k == edge:
            edge += 16
            row, local = row_of(directory, row_0, local_0, i, c, s_a, s_c, h_a, h_c)
            cell = cell_of(directory, row, local, b, s_b, h_b)
        else:
            local += step_local
            cell = np.uint64(np.int64(out) + step_local)
        rate = np.float64(rates[cell])

    # Last layer, from its plane to t_out.
    t_last = t_first + layers * pace
    b_out = min(max(b_out, b), b + 1)
    rate_out = np.float64(rates[cell_of(directory, row, local, b_out, s_b, h_b)])
    change = rate_out - rate
    rest = (p_b + v_b * t_out - b_out) * i_b
    if t_c < t_out:
        row, local = row_of(directory, row_0, local_0, i, c + step_c, s_a, s_c, h_a, h_c)
        rest_c = t_out - t_c
        rate_b = rate_out
        rate_out = np.float64(rates[cell_of(directory, row, local, b_out, s_b, h_b)])
        d_out = rate_out - rate_b
        d_in = rates[cell_of(directory, row, local, b, s_b, h_b)] - rate
        d_at = d_out if rest > rest_c else d_in
        change += d_out - d_at
        change_c += d_at
        piece_c += d_at * rest_c
        moment_c += d_at * t_c
    pieces_b = piece_b * i_b
    last_b = change * rest
    total = sum_rate * pace + rate * (t_out - t_last) - rate_in * (t_in - t_first) + pieces_b + piece_c + last_b

    # A crossing of b lies at its layer's exit less the way left. All planes together: the changes add up to
    # rate_out - rate_in, and by parts, with the changes times t, the integral is rate_out t_out - rate_in t_in less
    # their sum. What is not across b or c is across a.
    jump_b = change_b + change
    moment_b = change_b * (t_first + pace) + number_b * pace - pieces_b + change * t_out - last_b
    jump_a = rate_out - rate_in - jump_b - change_c
    moment_a = rate_out * t_out - rate_in * t_in - total - moment_b - moment_c
    jump_c = np.float64(change_c)
    if swapped:
        jump_b, jump_c, moment_b, moment_c = jump_c, jump_b, moment_c, moment_b
    if axis == 0:
        return total, rate_out, jump_a, jump_b, jump_c, moment_a, moment_b, moment_c
    if axis == 1:
        return total, rate_out, jump_b, jump_a, jump_c, moment_b, moment_a, moment_c
    return total, rate_out, jump_b, jump_c, jump_a, moment_b, moment_c, moment_a


@kernel(allocates=False)
def integrate_spatial(directory, rates, strides, p_x, p_y, p_z, v_x, v_y, v_z, t_in, t_out):
    """Integral of :func:`walk_layers` alone; the compiler drops the rest."""
    return walk_layers(directory, rates, strides, p_x, p_y, p_z, v_x, v_y, v_z, t_in, t_out)[0]
