"""Passing rays under Gamma posteriors of the rates, planar, with the gradient by the poses of their origins.

A cell with posterior ``Gamma(a, b)`` lets a path ``r`` pass with probability ``(b / (b + r))^a`` (thesis, l_dec of
section 8.4.5), so a ray pays

    S = sum a_i log1p(r_i / b_i),        r_i = t_(i + 1) - t_i.

Its derivative by a path is the *effective rate* ``e_i = a_i / (b_i + r_i)``: the posterior mean of the rate once the
ray itself has passed. With the crossings moving as in :mod:`factorloc.mapping._forward_kernels`, the gradient is

    dS = sum (e after - e before) e_a . (do + t dv) / v_a,

that of the integral of rates with effective rates in place of rates; exact where no crossing meets a corner. All that
lies outside the grid is one cell, which a ray may pass before and behind the grid.
"""

import math

from factorloc._jit import kernel
from factorloc.mapping._traversal_kernels import clip_ray

_SHORT = 0.125  # paths, relative to that of the cell, for which five terms of the series are exact to 1e-13


@kernel(allocates=False)
def pass_cell(a, b, r):
    """Cost ``a log1p(r / b)`` of a path through a cell, and the effective rate ``a / (b + r)``."""
    whole = b + r
    both = whole + b
    inverse = 1.0 / (whole * both)
    rate = a * both * inverse
    if r < _SHORT * b:
        # log1p(r / b) = 2 artanh(u), u = r / (2 b + r)
        u = r * whole * inverse
        s = u * u
        return 2.0 * a * u * (1.0 + s * (1.0 / 3.0 + s * (0.2 + s * (1.0 / 7.0 + s * (1.0 / 9.0))))), rate
    return a * math.log1p(r / b), rate


@kernel(allocates=False)
def posterior_pass(shapes, paths, shape, prior_shape, prior_path, p_x, p_y, v_x, v_y, length):
    """Cost of passing all cells of a ray, and the jumps of effective rates at the lines crossed.

    Parameters
    ----------
    shapes, paths : (cells with rim,) float
        a and b (m) of every cell.
    shape : (int, int)
        Cells without rim.
    prior_shape, prior_path : float
        a and b of the outside.
    p_x, p_y, v_x, v_y : float
        Ray in cells of the grid.
    length : float
        m.

    Returns
    -------
    total : float
    jump_x, jump_y, moment_x, moment_y : float
        As :func:`factorloc.mapping._forward_kernels.walk_columns`.
    """
    n_x, n_y = shape
    jump_x = 0.0
    jump_y = 0.0
    moment_x = 0.0
    moment_y = 0.0
    t_in, t_out = clip_ray(p_x, p_y, v_x, v_y, length, n_x, n_y)
    if not t_in < t_out:
        return pass_cell(prior_shape, prior_path, length)[0], jump_x, jump_y, moment_x, moment_y
    total = 0.0
    # Which axis the last line was across: neither at the origin of a ray.
    x_in = 0.0
    y_in = 0.0
    x_out = 0.0
    y_out = 0.0
    i_x = 1.0 / v_x
    i_y = 1.0 / v_y
    if t_in > 0.0 or t_out < length:
        total, rate = pass_cell(prior_shape, prior_path, length - (t_out - t_in))
        if t_in > 0.0:
            enter_x = ((0.0 if v_x > 0.0 else n_x) - p_x) * i_x if v_x != 0.0 else -math.inf
            enter_y = ((0.0 if v_y > 0.0 else n_y) - p_y) * i_y if v_y != 0.0 else -math.inf
            x_in = 1.0 if enter_x > enter_y else 0.0
            y_in = 1.0 - x_in
        if t_out < length:
            leave_x = ((n_x if v_x > 0.0 else 0.0) - p_x) * i_x if v_x != 0.0 else math.inf
            leave_y = ((n_y if v_y > 0.0 else 0.0) - p_y) * i_y if v_y != 0.0 else math.inf
            x_out = 1.0 if leave_x < leave_y else 0.0
            y_out = 1.0 - x_out
        jump_x = rate * (x_out - x_in)
        jump_y = rate * (y_out - y_in)
        moment_x = rate * (x_out * t_out - x_in * t_in)
        moment_y = rate * (y_out * t_out - y_in * t_in)
    c_x = min(max(math.floor(p_x + v_x * t_in), 0), n_x - 1)
    c_y = min(max(math.floor(p_y + v_y * t_in), 0), n_y - 1)
    e_x = min(max(math.floor(p_x + v_x * t_out), 0), n_x - 1)
    e_y = min(max(math.floor(p_y + v_y * t_out), 0), n_y - 1)
    step_x = 1 if v_x > 0.0 else -1
    step_y = 1 if v_y > 0.0 else -1
    far_x = max(step_x, 0) - p_x
    far_y = max(step_y, 0) - p_y
    t = t_in
    for _ in range(abs(e_x - c_x) + abs(e_y - c_y)):
        # A ray along a line may cross it by its direction and not by its end, which is rounded; the end decides.
        t_x = (c_x + far_x) * i_x if c_x != e_x else math.inf
        t_y = (c_y + far_y) * i_y if c_y != e_y else math.inf
        across_x = t_x < t_y
        cell = (c_x + 1) * (n_y + 2) + c_y + 1
        t_next = max(min(min(t_x, t_y), t_out), t)
        cost, rate = pass_cell(shapes[cell], paths[cell], t_next - t)
        total += cost
        x_next = 1.0 if across_x else 0.0
        y_next = 1.0 - x_next
        jump_x += rate * (x_in - x_next)
        jump_y += rate * (y_in - y_next)
        moment_x += rate * (x_in * t - x_next * t_next)
        moment_y += rate * (y_in * t - y_next * t_next)
        c_x += step_x if across_x else 0
        c_y += 0 if across_x else step_y
        x_in = x_next
        y_in = y_next
        t = t_next
    cell = (e_x + 1) * (n_y + 2) + e_y + 1
    cost, rate = pass_cell(shapes[cell], paths[cell], max(t_out - t, 0.0))
    jump_x += rate * (x_in - x_out)
    jump_y += rate * (y_in - y_out)
    moment_x += rate * (x_in * t - x_out * t_out)
    moment_y += rate * (y_in * t - y_out * t_out)
    return total + cost, jump_x, jump_y, moment_x, moment_y
