"""Log-likelihoods of spatial scans at many poses, under known decay rates and under Gamma posteriors of them.

The maps are dense arrays with a rim, or pools of bricks with a directory, as the walks of
:mod:`factorloc.mapping._spatial_forward_kernels` take them; ``rim`` is the width of the rim in cells. Rays come in the
frame of the body and are moved inside the kernel. Those out of range have the limit as their length.
"""

import math

import numpy as np

from factorloc._jit import kernel
from factorloc.mapping._likelihood_kernels import log_kept, log_outcome
from factorloc.mapping._spatial_forward_kernels import walk_layers
from factorloc.mapping._spatial_traversal_kernels import address, clip_axis


@kernel(allocates=False, inline=True)
def turned(T, v, axis):
    """One coordinate of a vector, turned by a pose."""
    return T[axis, 0] * v[0] + T[axis, 1] * v[1] + T[axis, 2] * v[2]


@kernel(allocates=False)
def spatial_decay_log_likelihoods(
    directory, rates, strides, rim, shape, outside, low, resolution, poses, group, origins, directions, lengths, status,
    each, sums,
):  # fmt: skip
    """Log-likelihood of a scan at many poses under constant decay rates (thesis, eq. 7.13 to 7.16).

    As :func:`factorloc.mapping._likelihood_kernels.decay_log_likelihoods`, in space.

    Parameters
    ----------
    directory : None or int32, flat
    rates : float, flat
        Decay rates, 1/m.
    strides : (int, int, int)
        Of the dense array, or of the directory.
    rim : float
        1 for a dense array, 16 for bricks.
    shape : (int, int, int)
        Cells without rim.
    outside : float
        Rate outside the grid.
    low : (3,) float64
    resolution : float
    poses : (P, 4, 4) float64
        Poses of the body in the map.
    group : int
        Poses that a ray is weighed at one after the other, before the next ray.
    origins, directions : (N, 3) float64
        Rays in the frame of the body.
    lengths : (N,) float64
    status : (N,) uint8
        0 return, 1 below minimum, 2 no return.
    each : (P, N) or (0, N) float64
        Written: log-likelihoods of the rays, if wanted.
    sums : (P,) float64
        Written: their sums over each pose.
    """
    n_x, n_y, n_z = shape
    inverse = 1.0 / resolution
    for first in range(0, poses.shape[0], group):
        last = min(first + group, poses.shape[0])
        for i in range(first, last):
            sums[i] = 0.0
        for k in range(lengths.shape[0]):
            for i in range(first, last):
                T = poses[i]
                x = T[0, 3] - low[0]
                y = T[1, 3] - low[1]
                z = T[2, 3] - low[2]
                p_x = (turned(T, origins[k], 0) + x) * inverse
                p_y = (turned(T, origins[k], 1) + y) * inverse
                p_z = (turned(T, origins[k], 2) + z) * inverse
                v_x = turned(T, directions[k], 0) * inverse
                v_y = turned(T, directions[k], 1) * inverse
                v_z = turned(T, directions[k], 2) * inverse
                length = lengths[k]
                e_x = math.floor(p_x + v_x * length)
                e_y = math.floor(p_y + v_y * length)
                e_z = math.floor(p_z + v_z * length)
                ends_inside = 0 <= e_x < n_x and 0 <= e_y < n_y and 0 <= e_z < n_z
                t_in = 0.0
                t_out = length
                if not (ends_inside and 0.0 <= p_x < n_x and 0.0 <= p_y < n_y and 0.0 <= p_z < n_z):
                    t_in, t_out = clip_axis(p_x, v_x, float(n_x), t_in, t_out)
                    t_in, t_out = clip_axis(p_y, v_y, float(n_y), t_in, t_out)
                    t_in, t_out = clip_axis(p_z, v_z, float(n_z), t_in, t_out)
                rate = outside
                integral = outside * length
                if t_in < t_out:
                    walked = walk_layers(
                        directory, rates, strides, p_x + rim, p_y + rim, p_z + rim, v_x, v_y, v_z, t_in, t_out
                    )
                    integral = walked[0] + outside * (length - (t_out - t_in))
                    rate = walked[1] if ends_inside else outside
                elif ends_inside:  # of no length
                    rate = np.float64(rates[address(e_x, e_y, e_z, strides[0], strides[1], directory)])
                value = log_outcome(status[k], -integral, rate)
                if each.shape[0] > 0:
                    each[i, k] = value
                sums[i] += value


@kernel(allocates=False)
def spatial_posterior_log_likelihoods(
    directory, shapes, paths, strides, shape, prior_shape, prior_path, low, resolution, poses, group, origins,
    directions, lengths, status, each, sums,
):  # fmt: skip
    """Log-likelihood of a scan at many poses under Gamma posteriors of the rates (thesis, l_dec of section 8.4.5).

    As :func:`factorloc.mapping._likelihood_kernels.posterior_log_likelihoods`, in space; maps as
    :func:`spatial_decay_log_likelihoods`. What lies outside the grid is one cell with the prior.
    """
    inverse = 1.0 / resolution
    for first in range(0, poses.shape[0], group):
        last = min(first + group, poses.shape[0])
        for i in range(first, last):
            sums[i] = 0.0
        for k in range(lengths.shape[0]):
            for i in range(first, last):
                T = poses[i]
                x = T[0, 3] - low[0]
                y = T[1, 3] - low[1]
                z = T[2, 3] - low[2]
                p_x = (turned(T, origins[k], 0) + x) * inverse
                p_y = (turned(T, origins[k], 1) + y) * inverse
                p_z = (turned(T, origins[k], 2) + z) * inverse
                v_x = turned(T, directions[k], 0) * inverse
                v_y = turned(T, directions[k], 1) * inverse
                v_z = turned(T, directions[k], 2) * inverse
                log_pass, density = _pass_posterior(
                    directory, shapes, paths, strides, shape, prior_shape, prior_path, p_x, p_y, p_z, v_x, v_y, v_z,
                    lengths[k],
                )  # fmt: skip
                value = log_outcome(status[k], log_pass, density)
                if each.shape[0] > 0:
                    each[i, k] = value
                sums[i] += value


@kernel(allocates=False)
def _pass_posterior(
    directory, shapes, paths, strides, shape, prior_shape, prior_path, p_x, p_y, p_z, v_x, v_y, v_z, length
):
    """Log-probability that a ray (in cells of the grid) gets so far, and the density of a reflection there."""
    n_x, n_y, n_z = shape
    t_in, t_out = clip_axis(p_x, v_x, float(n_x), 0.0, length)
    t_in, t_out = clip_axis(p_y, v_y, float(n_y), t_in, t_out)
    t_in, t_out = clip_axis(p_z, v_z, float(n_z), t_in, t_out)
    if t_in > t_out:
        return -prior_shape * math.log1p(length / prior_path), prior_shape / (prior_path + length)
    passed_outside = length - (t_out - t_in)
    log_pass = -prior_shape * math.log1p(passed_outside / prior_path)
    i_x = min(max(math.floor(p_x + v_x * t_in), 0), n_x - 1)
    i_y = min(max(math.floor(p_y + v_y * t_in), 0), n_y - 1)
    i_z = min(max(math.floor(p_z + v_z * t_in), 0), n_z - 1)
    e_x = min(max(math.floor(p_x + v_x * t_out), 0), n_x - 1)
    e_y = min(max(math.floor(p_y + v_y * t_out), 0), n_y - 1)
    e_z = min(max(math.floor(p_z + v_z * t_out), 0), n_z - 1)
    step_x = 1 if v_x > 0.0 else -1
    step_y = 1 if v_y > 0.0 else -1
    step_z = 1 if v_z > 0.0 else -1
    i_v_x = 1.0 / v_x
    i_v_y = 1.0 / v_y
    i_v_z = 1.0 / v_z
    # Cell to line ahead; a ray along a plane may cross it by its direction and not by its end, which is rounded: the
    # end decides.
    ahead_x = 1.0 if step_x > 0 else 0.0
    ahead_y = 1.0 if step_y > 0 else 0.0
    ahead_z = 1.0 if step_z > 0 else 0.0
    t_x = (i_x + ahead_x - p_x) * i_v_x if i_x != e_x else math.inf
    t_y = (i_y + ahead_y - p_y) * i_v_y if i_y != e_y else math.inf
    t_z = (i_z + ahead_z - p_z) * i_v_z if i_z != e_z else math.inf
    t = t_in
    for _ in range(abs(e_x - i_x) + abs(e_y - i_y) + abs(e_z - i_z)):
        t_next = max(min(min(min(t_x, t_y), t_z), t_out), t)
        cell = address(i_x, i_y, i_z, strides[0], strides[1], directory)
        log_pass += log_kept(np.float64(shapes[cell]), t_next - t, np.float64(paths[cell]))
        t = t_next
        if t_x < t_y and t_x < t_z:
            i_x += step_x
            t_x = (i_x + ahead_x - p_x) * i_v_x if i_x != e_x else math.inf
        elif t_y < t_z:
            i_y += step_y
            t_y = (i_y + ahead_y - p_y) * i_v_y if i_y != e_y else math.inf
        else:
            i_z += step_z
            t_z = (i_z + ahead_z - p_z) * i_v_z if i_z != e_z else math.inf
    cell = address(e_x, e_y, e_z, strides[0], strides[1], directory)
    a = np.float64(shapes[cell])
    b = np.float64(paths[cell])
    last = max(t_out - t, 0.0)
    log_pass += log_kept(a, last, b)
    end_x = math.floor(p_x + v_x * length)
    end_y = math.floor(p_y + v_y * length)
    end_z = math.floor(p_z + v_z * length)
    if 0 <= end_x < n_x and 0 <= end_y < n_y and 0 <= end_z < n_z:
        return log_pass, a / (b + last)
    return log_pass, prior_shape / (prior_path + passed_outside)
