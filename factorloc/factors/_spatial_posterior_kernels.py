"""Passing rays in space under Gamma posteriors of the rates: the planar walk with a third axis, over bricks."""

import math

import numpy as np

from factorloc._jit import kernel
from factorloc.factors._posterior_kernels import pass_cell
from factorloc.mapping._spatial_traversal_kernels import address, clip_axis


@kernel(allocates=False)
def border(p, v, inverse, n, enters):
    """Ray parameter at which one coordinate enters, or leaves, [0, n]; infinitely early, or late, if it never moves."""
    if v == 0.0:
        return -math.inf if enters else math.inf
    return ((0.0 if enters == (v > 0.0) else n) - p) * inverse


@kernel(allocates=False)
def spatial_posterior_pass(
    directory, shapes, paths, stride_x, stride_y, shape, prior_shape, prior_path, p_x, p_y, p_z, v_x, v_y, v_z, length
):
    """Cost of passing all cells of a ray, and the jumps of effective rates at the planes crossed.

    Parameters
    ----------
    directory : int32, flat
        Brick of every place.
    shapes, paths : float32, flat
        a and b (m) of every cell of the pool.
    stride_x, stride_y : int
        Of the directory.
    shape : (int, int, int)
        Cells.
    prior_shape, prior_path : float
        a and b of the outside.
    p_x, p_y, p_z, v_x, v_y, v_z : float
        Ray in cells of the grid.
    length : float
        m.

    Returns
    -------
    total : float
    jump_x, jump_y, jump_z, moment_x, moment_y, moment_z : float
        As :func:`factorloc.mapping._spatial_forward_kernels.walk_layers`.
    """
    n_x, n_y, n_z = shape
    jump_x = 0.0
    jump_y = 0.0
    jump_z = 0.0
    moment_x = 0.0
    moment_y = 0.0
    moment_z = 0.0
    t_in, t_out = clip_axis(p_x, v_x, float(n_x), 0.0, length)
    t_in, t_out = clip_axis(p_y, v_y, float(n_y), t_in, t_out)
    t_in, t_out = clip_axis(p_z, v_z, float(n_z), t_in, t_out)
    if not t_in < t_out:
        return pass_cell(prior_shape, prior_path, length)[0], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    i_x = 1.0 / v_x
    i_y = 1.0 / v_y
    i_z = 1.0 / v_z
    # Which axis the last plane was across (3: none, at the origin of a ray), and which one the ray leaves across.
    axis = 3
    last_axis = 3
    total = 0.0
    if t_in > 0.0 or t_out < length:
        total, rate = pass_cell(prior_shape, prior_path, length - (t_out - t_in))
        enters = t_in > 0.0
        if enters:
            b_x = border(p_x, v_x, i_x, float(n_x), enters)
            b_y = border(p_y, v_y, i_y, float(n_y), enters)
            b_z = border(p_z, v_z, i_z, float(n_z), enters)
            axis = 0 if b_x > b_y and b_x > b_z else (1 if b_y > b_z else 2)
            jump_x -= rate if axis == 0 else 0.0
            jump_y -= rate if axis == 1 else 0.0
            jump_z -= rate if axis == 2 else 0.0
            moment_x -= rate * t_in if axis == 0 else 0.0
            moment_y -= rate * t_in if axis == 1 else 0.0
            moment_z -= rate * t_in if axis == 2 else 0.0
        leaves = t_out < length
        if leaves:
            b_x = border(p_x, v_x, i_x, float(n_x), not leaves)
            b_y = border(p_y, v_y, i_y, float(n_y), not leaves)
            b_z = border(p_z, v_z, i_z, float(n_z), not leaves)
            last_axis = 0 if b_x < b_y and b_x < b_z else (1 if b_y < b_z else 2)
            jump_x += rate if last_axis == 0 else 0.0
            jump_y += rate if last_axis == 1 else 0.0
            jump_z += rate if last_axis == 2 else 0.0
            moment_x += rate * t_out if last_axis == 0 else 0.0
            moment_y += rate * t_out if last_axis == 1 else 0.0
            moment_z += rate * t_out if last_axis == 2 else 0.0
    c_x = min(max(math.floor(p_x + v_x * t_in), 0), n_x - 1)
    c_y = min(max(math.floor(p_y + v_y * t_in), 0), n_y - 1)
    c_z = min(max(math.floor(p_z + v_z * t_in), 0), n_z - 1)
    e_x = min(max(math.floor(p_x + v_x * t_out), 0), n_x - 1)
    e_y = min(max(math.floor(p_y + v_y * t_out), 0), n_y - 1)
    e_z = min(max(math.floor(p_z + v_z * t_out), 0), n_z - 1)
    step_x = 1 if v_x > 0.0 else -1
    step_y = 1 if v_y > 0.0 else -1
    step_z = 1 if v_z > 0.0 else -1
    # A ray along a plane may cross it by its direction and not by its end, which is rounded; the end decides.
    t_x = (c_x + (1 if v_x > 0.0 else 0) - p_x) * i_x if c_x != e_x else math.inf
    t_y = (c_y + (1 if v_y > 0.0 else 0) - p_y) * i_y if c_y != e_y else math.inf
    t_z = (c_z + (1 if v_z > 0.0 else 0) - p_z) * i_z if c_z != e_z else math.inf
    t = t_in
    steps = abs(e_x - c_x) + abs(e_y - c_y) + abs(e_z - c_z)
    for k in range(steps + 1):
        if k == steps:
            next_axis = last_axis
            t_next = max(t_out, t)
            c_x = e_x
            c_y = e_y
            c_z = e_z
        else:
            next_axis = 0 if t_x < t_y and t_x < t_z else (1 if t_y < t_z else 2)
            t_next = max(min(min(min(t_x, t_y), t_z), t_out), t)
        cell = np.uint64(address(c_x, c_y, c_z, stride_x, stride_y, directory))
        cost, rate = pass_cell(np.float64(shapes[cell]), np.float64(paths[cell]), t_next - t)
        total += cost
        # A cell adds its rate where it is entered and takes it off where it is left.
        enter = rate * t
        leave = rate * t_next
        jump_x += (rate if axis == 0 else 0.0) - (rate if next_axis == 0 else 0.0)
        jump_y += (rate if axis == 1 else 0.0) - (rate if next_axis == 1 else 0.0)
        jump_z += (rate if axis == 2 else 0.0) - (rate if next_axis == 2 else 0.0)
        moment_x += (enter if axis == 0 else 0.0) - (leave if next_axis == 0 else 0.0)
        moment_y += (enter if axis == 1 else 0.0) - (leave if next_axis == 1 else 0.0)
        moment_z += (enter if axis == 2 else 0.0) - (leave if next_axis == 2 else 0.0)
        if next_axis == 0:
            c_x += step_x
            t_x = (c_x + (1 if v_x > 0.0 else 0) - p_x) * i_x if c_x != e_x else math.inf
        elif next_axis == 1:
            c_y += step_y
            t_y = (c_y + (1 if v_y > 0.0 else 0) - p_y) * i_y if c_y != e_y else math.inf
        else:
            c_z += step_z
            t_z = (c_z + (1 if v_z > 0.0 else 0) - p_z) * i_z if c_z != e_z else math.inf
        axis = next_axis
        t = t_next
    return total, jump_x, jump_y, jump_z, moment_x, moment_y, moment_z
