"""Scan-to-map costs of spatial scans with gradient and Gauss-Newton Hessian, for poses in SE(3).

All levels of a map lie in one pool of bricks, found through one directory. A level is a row of numbers, whose columns
are named below; its bricks have a primary and a secondary number for every cell:

====================  ===========  ============  ================================
model                 primary      secondary     parameters
====================  ===========  ============  ================================
``DECAY_RATE``        rates, 1/m   log rates     least NLL
``DISTANCE_FIELD``    distance, m  distance, m   sigma (m), Huber (sigma)
``POSTERIOR``         shapes       paths, m      least NLL, prior path (m)
``END_POINT``         distance, m  distance, m   sigma (m), floor, log of the peak
====================  ===========  ============  ================================

A pool with posteriors has a tertiary number for every cell, the log effective rate, and no decay rates; in others it is
None, and the walk of posteriors is not compiled for them.

Poses are 4 x 4 matrices, derivatives in the tangent space of the body, rotation first.
"""

import math

import numpy as np

from factorloc._jit import kernel
from factorloc.factors._scan_kernels import (
    DECAY_RATE,
    END_POINT,
    LEAST_MARGIN,
    POSTERIOR,
    huber_loss,
    mixture_loss,
)
from factorloc.factors._spatial_posterior_kernels import spatial_posterior_pass
from factorloc.factors._trilinear_kernels import trilinear
from factorloc.mapping._spatial_forward_kernels import integrate_spatial, walk_layers
from factorloc.mapping._spatial_traversal_kernels import clip_axis

# Columns of a level. The bricks of its directory begin at START and have strides STRIDE_X, STRIDE_Y and 1.
MODEL, START, STRIDE_X, STRIDE_Y, SIZE_X, SIZE_Y, SIZE_Z, RESOLUTION, OUTSIDE = range(9)
PARAMETER_A, PARAMETER_B, PARAMETER_C = range(9, 12)
COLUMNS = 12


@kernel(allocates=False)
def extended(directory, values, level, outside, e_x, e_y, e_z):
    """Interpolate a table at a point in cells of its grid; beyond the centres of the rim it is constant."""
    if -0.5 <= e_x < level[SIZE_X] + 0.5 and -0.5 <= e_y < level[SIZE_Y] + 0.5 and -0.5 <= e_z < level[SIZE_Z] + 0.5:
        return trilinear(
            directory, values, int(level[STRIDE_X]), int(level[STRIDE_Y]), e_x + 15.5, e_y + 15.5, e_z + 15.5
        )
    return outside, 0.0, 0.0, 0.0


@kernel(allocates=False)
def decay_ray(directory, primary, secondary, level, p_x, p_y, p_z, d_x, d_y, d_z, length, want_gradient):
    """Hybrid negative log-likelihood of one ray: exact integral minus interpolated log rate at the end.

    ``p`` is in cells of the grid, ``d`` a unit vector.

    Returns
    -------
    value : float
    g_x, g_y, g_z : float
        Derivative by the ray origin, 1/m.
    m_x, m_y, m_z : float
        Derivative by the ray direction.
    weight : float
        Of the outer product of the ray's gradient.
    """
    resolution = level[RESOLUTION]
    inverse = 1.0 / resolution
    outside = level[OUTSIDE]
    stride_x = int(level[STRIDE_X])
    stride_y = int(level[STRIDE_Y])
    strides = (stride_x, stride_y, 1)
    n_x = level[SIZE_X]
    n_y = level[SIZE_Y]
    n_z = level[SIZE_Z]
    v_x = d_x * inverse
    v_y = d_y * inverse
    v_z = d_z * inverse
    e_x = p_x + v_x * length
    e_y = p_y + v_y * length
    e_z = p_z + v_z * length
    t_in = 0.0
    t_out = length
    inside = 0.0 <= p_x < n_x and 0.0 <= p_y < n_y and 0.0 <= p_z < n_z
    if not (inside and 0.0 <= e_x < n_x and 0.0 <= e_y < n_y and 0.0 <= e_z < n_z):
        # Clip in the rim, whose rate is the one outside: every jump at the border is then walked across.
        t_in, t_out = clip_axis(p_x + 0.5, v_x, n_x + 1.0, t_in, t_out)
        t_in, t_out = clip_axis(p_y + 0.5, v_y, n_y + 1.0, t_in, t_out)
        t_in, t_out = clip_axis(p_z + 0.5, v_z, n_z + 1.0, t_in, t_out)
    g_x = 0.0
    g_y = 0.0
    g_z = 0.0
    m_x = 0.0
    m_y = 0.0
    m_z = 0.0
    if t_in < t_out:
        if want_gradient:
            value, _, jump_x, jump_y, jump_z, moment_x, moment_y, moment_z = walk_layers(
                directory, primary, strides, p_x + 16.0, p_y + 16.0, p_z + 16.0, v_x, v_y, v_z, t_in, t_out
            )
            if d_x != 0.0:
                g_x = jump_x / d_x
                m_x = moment_x / d_x
            if d_y != 0.0:
                g_y = jump_y / d_y
                m_y = moment_y / d_y
            if d_z != 0.0:
                g_z = jump_z / d_z
                m_z = moment_z / d_z
        else:
            value = integrate_spatial(
                directory, primary, strides, p_x + 16.0, p_y + 16.0, p_z + 16.0, v_x, v_y, v_z, t_in, t_out
            )
        value += outside * (length - (t_out - t_in))
    else:
        value = outside * length
    log_rate, f_x, f_y, f_z = extended(directory, secondary, level, math.log(outside), e_x, e_y, e_z)
    value -= log_rate
    f_x *= inverse
    f_y *= inverse
    f_z *= inverse
    g_x -= f_x
    g_y -= f_y
    g_z -= f_z
    m_x -= length * f_x
    m_y -= length * f_y
    m_z -= length * f_z
    return value, g_x, g_y, g_z, m_x, m_y, m_z, 0.5 / max(value - level[PARAMETER_A], LEAST_MARGIN)


@kernel(allocates=False)
def posterior_ray(directory, shapes, paths, log_rates, level, p_x, p_y, p_z, d_x, d_y, d_z, length):
    """Hybrid NLL of one ray under Gamma posteriors of the rates; arguments and returns as :func:`decay_ray`."""
    inverse = 1.0 / level[RESOLUTION]
    stride_x = int(level[STRIDE_X])
    stride_y = int(level[STRIDE_Y])
    shape = int(level[SIZE_X]), int(level[SIZE_Y]), int(level[SIZE_Z])
    v_x = d_x * inverse
    v_y = d_y * inverse
    v_z = d_z * inverse
    value, jump_x, jump_y, jump_z, moment_x, moment_y, moment_z = spatial_posterior_pass(
        directory, shapes, paths, stride_x, stride_y, shape, level[OUTSIDE], level[PARAMETER_B],
        p_x, p_y, p_z, v_x, v_y, v_z, length,
    )  # fmt: skip
    log_outside = math.log(level[OUTSIDE] / (level[PARAMETER_B] + 0.5 * level[RESOLUTION]))
    log_rate, f_x, f_y, f_z = extended(
        directory, log_rates, level, log_outside, p_x + v_x * length, p_y + v_y * length, p_z + v_z * length
    )
    value -= log_rate
    g_x = -f_x * inverse
    g_y = -f_y * inverse
    g_z = -f_z * inverse
    m_x = length * g_x
    m_y = length * g_y
    m_z = length * g_z
    if d_x != 0.0:
        g_x += jump_x / d_x
        m_x += moment_x / d_x
    if d_y != 0.0:
        g_y += jump_y / d_y
        m_y += moment_y / d_y
    if d_z != 0.0:
        g_z += jump_z / d_z
        m_z += moment_z / d_z
    return value, g_x, g_y, g_z, m_x, m_y, m_z, 0.5 / max(value - level[PARAMETER_A], LEAST_MARGIN)


@kernel(allocates=False)
def field_ray(model, directory, primary, level, p_x, p_y, p_z, d_x, d_y, d_z, length):
    """Robust cost of one end point's distance; arguments and returns as :func:`decay_ray`."""
    inverse = 1.0 / level[RESOLUTION]
    sigma = level[PARAMETER_A]
    e_x = p_x + d_x * inverse * length
    e_y = p_y + d_y * inverse * length
    e_z = p_z + d_z * inverse * length
    distance, f_x, f_y, f_z = extended(directory, primary, level, level[OUTSIDE], e_x, e_y, e_z)
    residual = distance / sigma
    if model == END_POINT:
        value, slope = mixture_loss(residual, level[PARAMETER_B], level[PARAMETER_C])
    else:
        value, slope = huber_loss(residual, level[PARAMETER_B])
    # Gauss-Newton on the residual: H = w f f' with w = slope / residual, in terms of g = slope f.
    scale = slope * inverse / sigma
    weight = 1.0 / (slope * residual) if slope * residual > 1e-18 else 0.0
    g_x = scale * f_x
    g_y = scale * f_y
    g_z = scale * f_z
    return value, g_x, g_y, g_z, length * g_x, length * g_y, length * g_z, weight


@kernel
def spatial_scan_cost(
    pose, origins, directions, lengths, first, last, low, directory, primary, secondary, tertiary, level,
    information, want_gradient, gradient, hessian,
):  # fmt: skip
    """Sum a level's costs over the rays ``first:last`` of one scan; see :func:`spatial_scan_batch`."""
    r_00 = pose[0, 0]
    r_01 = pose[0, 1]
    r_02 = pose[0, 2]
    r_10 = pose[1, 0]
    r_11 = pose[1, 1]
    r_12 = pose[1, 2]
    r_20 = pose[2, 0]
    r_21 = pose[2, 1]
    r_22 = pose[2, 2]
    t_x = pose[0, 3] - low[0]
    t_y = pose[1, 3] - low[1]
    t_z = pose[2, 3] - low[2]
    inverse = 1.0 / level[RESOLUTION]
    places = directory[int(level[START]) :]
    model = int(level[MODEL])
    cost = 0.0
    row = np.empty(6)
    for i in range(6):
        gradient[i] = 0.0
        for j in range(6):
            hessian[i, j] = 0.0
    for k in range(first, last):
        a_x = origins[k, 0]
        a_y = origins[k, 1]
        a_z = origins[k, 2]
        b_x = directions[k, 0]
        b_y = directions[k, 1]
        b_z = directions[k, 2]
        p_x = (r_00 * a_x + r_01 * a_y + r_02 * a_z + t_x) * inverse
        p_y = (r_10 * a_x + r_11 * a_y + r_12 * a_z + t_y) * inverse
        p_z = (r_20 * a_x + r_21 * a_y + r_22 * a_z + t_z) * inverse
        d_x = r_00 * b_x + r_01 * b_y + r_02 * b_z
        d_y = r_10 * b_x + r_11 * b_y + r_12 * b_z
        d_z = r_20 * b_x + r_21 * b_y + r_22 * b_z
        if tertiary is None:
            if model == DECAY_RATE:
                value, g_x, g_y, g_z, m_x, m_y, m_z, weight = decay_ray(
                    places, primary, secondary, level, p_x, p_y, p_z, d_x, d_y, d_z, lengths[k], want_gradient
                )
            else:
                value, g_x, g_y, g_z, m_x, m_y, m_z, weight = field_ray(
                    model, places, primary, level, p_x, p_y, p_z, d_x, d_y, d_z, lengths[k]
                )
        elif model == POSTERIOR:
            value, g_x, g_y, g_z, m_x, m_y, m_z, weight = posterior_ray(
                places, primary, secondary, tertiary, level, p_x, p_y, p_z, d_x, d_y, d_z, lengths[k]
            )
        else:
            value, g_x, g_y, g_z, m_x, m_y, m_z, weight = field_ray(
                model, places, primary, level, p_x, p_y, p_z, d_x, d_y, d_z, lengths[k]
            )
        cost += value
        if want_gradient:
            # In the frame of the body: origin and direction move by omega x a + v and omega x b.
            u_x = r_00 * g_x + r_10 * g_y + r_20 * g_z
            u_y = r_01 * g_x + r_11 * g_y + r_21 * g_z
            u_z = r_02 * g_x + r_12 * g_y + r_22 * g_z
            w_x = r_00 * m_x + r_10 * m_y + r_20 * m_z
            w_y = r_01 * m_x + r_11 * m_y + r_21 * m_z
            w_z = r_02 * m_x + r_12 * m_y + r_22 * m_z
            row[0] = a_y * u_z - a_z * u_y + b_y * w_z - b_z * w_y
            row[1] = a_z * u_x - a_x * u_z + b_z * w_x - b_x * w_z
            row[2] = a_x * u_y - a_y * u_x + b_x * w_y - b_y * w_x
            row[3] = u_x
            row[4] = u_y
            row[5] = u_z
            for i in range(6):
                gradient[i] += row[i]
                scaled = weight * row[i]
                for j in range(i, 6):
                    hessian[i, j] += scaled * row[j]
    for i in range(6):
        gradient[i] *= information
        for j in range(i, 6):
            hessian[i, j] *= information
            hessian[j, i] = hessian[i, j]
    return information * cost


@kernel(allocates=False)
def spatial_scan_batch(
    poses, scan_of_pose, origins, directions, lengths, offsets, low, directory, primary, secondary, tertiary, level,
    information, want_gradient, costs, gradients, hessians,
):  # fmt: skip
    """Cost, gradient and Hessian of many scans at many poses.

    Parameters
    ----------
    poses : (N, 4, 4) float64
        ``T_map_body``.
    scan_of_pose : (N,) int64
        The scan each pose is tried for.
    origins, directions : (M, 3) float64
        Rays in body frames.
    lengths : (M,) float64
    offsets : (S + 1,) int64
    low : (3,) float64
        Lowest corner of all levels, m.
    directory : int32, flat
        Bricks of every place, of all levels one after the other.
    primary, secondary : float32, flat
        The pool.
    tertiary : None or float32, flat
        A third number of its cells.
    level : (12,) float64
        Numbers of the level.
    information : float
        Factor of all costs.
    want_gradient : bool
    costs : (N,), gradients : (N, 6), hessians : (N, 6, 6)
        Written; derivatives in the tangent space of the body.
    """
    for n in range(poses.shape[0]):
        k = scan_of_pose[n]
        costs[n] = spatial_scan_cost(
            poses[n], origins, directions, lengths, offsets[k], offsets[k + 1], low, directory, primary, secondary,
            tertiary, level, information, want_gradient, gradients[n], hessians[n],
        )  # fmt: skip
