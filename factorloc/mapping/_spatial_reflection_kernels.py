"""Log-likelihoods of spatial scans at many poses under reflection probabilities of the cells.

The planar kernel of :mod:`factorloc.mapping._reflection_kernels` in three dimensions. Maps of ``log(1 - mu)`` are dense
arrays with a rim of one cell, or pools of bricks with a directory.
"""

import math

import numpy as np

from factorloc._jit import exact_kernel
from factorloc.mapping._reflection_kernels import chord_axis, first_cell, log_reflection
from factorloc.mapping._spatial_likelihood_kernels import turned
from factorloc.mapping._spatial_traversal_kernels import address, clip_axis
from factorloc.mapping._traversal_kernels import FIXED_POINT


@exact_kernel(allocates=False)
def spatial_reflection_log_likelihoods(
    directory, log_misses, strides, shape, outside, low, resolution, poses, group, origins, directions, lengths, status,
    each, sums,
):  # fmt: skip
    """Log-likelihood of a scan at many poses under reflection probabilities (thesis, eq. 7.23 and 8.22).

    Parameters
    ----------
    directory : None or int32, flat
    log_misses : float, flat
        ``log(1 - mu)`` of the cells.
    strides : (int, int, int)
        Of the dense array, or of the directory.
    shape : (int, int, int)
        Cells without rim.
    outside : float
        ``log(1 - mu)`` of the cells outside the grid.
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
                log_pass, log_miss = _pass_cells(
                    directory, log_misses, strides, shape, outside, p_x, p_y, p_z, v_x, v_y, v_z, length
                )
                t_in, t_out = chord_axis(p_x, v_x, math.floor(p_x + v_x * length), length, 0.0, math.inf)
                t_in, t_out = chord_axis(p_y, v_y, math.floor(p_y + v_y * length), length, t_in, t_out)
                t_in, t_out = chord_axis(p_z, v_z, math.floor(p_z + v_z * length), length, t_in, t_out)
                value = log_reflection(status[k], log_pass, log_miss, length, t_in, t_out)
                if each.shape[0] > 0:
                    each[i, k] = value
                sums[i] += value


@exact_kernel(allocates=False)
def _pass_cells(directory, log_misses, strides, shape, outside, p_x, p_y, p_z, v_x, v_y, v_z, length):
    """Log-probability that a ray comes to the cell it ends in, and ``log(1 - mu)`` of that cell."""
    n_x, n_y, n_z = shape
    f_x = math.floor(p_x + v_x * length)
    f_y = math.floor(p_y + v_y * length)
    f_z = math.floor(p_z + v_z * length)
    b_x = first_cell(p_x, f_x)
    b_y = first_cell(p_y, f_y)
    b_z = first_cell(p_z, f_z)
    begins_inside = 0 <= b_x < n_x and 0 <= b_y < n_y and 0 <= b_z < n_z
    ends_inside = 0 <= f_x < n_x and 0 <= f_y < n_y and 0 <= f_z < n_z
    i_x, i_y, i_z, e_x, e_y, e_z = b_x, b_y, b_z, f_x, f_y, f_z
    t_in = 0.0
    t_out = length
    if not (begins_inside and ends_inside):
        t_in, t_out = clip_axis(p_x, v_x, n_x, t_in, t_out)
        t_in, t_out = clip_axis(p_y, v_y, n_y, t_in, t_out)
        t_in, t_out = clip_axis(p_z, v_z, n_z, t_in, t_out)
        if t_in >= t_out and not (begins_inside or ends_inside):
            beside = abs(f_x - b_x) + abs(f_y - b_y) + abs(f_z - b_z)
            return (beside * outside if beside > 0 else 0.0), outside
        if not begins_inside:
            i_x = min(max(math.floor(p_x + v_x * t_in), 0), n_x - 1)
            i_y = min(max(math.floor(p_y + v_y * t_in), 0), n_y - 1)
            i_z = min(max(math.floor(p_z + v_z * t_in), 0), n_z - 1)
        if not ends_inside:
            e_x = min(max(math.floor(p_x + v_x * t_out), 0), n_x - 1)
            e_y = min(max(math.floor(p_y + v_y * t_out), 0), n_y - 1)
            e_z = min(max(math.floor(p_z + v_z * t_out), 0), n_z - 1)
    # As many cells lie before the grid as planes are crossed on the way in; of those behind it the last is the end.
    passed = abs(i_x - b_x) + abs(i_y - b_y) + abs(i_z - b_z)
    if not ends_inside:
        passed += abs(f_x - e_x) + abs(f_y - e_y) + abs(f_z - e_z) - 1
    log_pass = passed * outside if passed > 0 else 0.0
    i_v_x = 1.0 / v_x
    i_v_y = 1.0 / v_y
    i_v_z = 1.0 / v_z
    walk_x = 1 if v_x >= 0.0 else -1
    walk_y = 1 if v_y >= 0.0 else -1
    walk_z = 1 if v_z >= 0.0 else -1
    ahead_x = 1.0 if v_x >= 0.0 else 0.0
    ahead_y = 1.0 if v_y >= 0.0 else 0.0
    ahead_z = 1.0 if v_z >= 0.0 else 0.0
    # A ray along a plane may cross it by its direction and not by its end, which is rounded; the end decides.
    t_x = (i_x + ahead_x - p_x) * i_v_x if i_x != e_x else math.inf
    t_y = (i_y + ahead_y - p_y) * i_v_y if i_y != e_y else math.inf
    t_z = (i_z + ahead_z - p_z) * i_v_z if i_z != e_z else math.inf
    before = int(t_in * FIXED_POINT)
    for _ in range(abs(e_x - i_x) + abs(e_y - i_y) + abs(e_z - i_z)):
        here = int(min(min(min(t_x, t_y), t_z), t_out) * FIXED_POINT)
        if here > before:
            log_pass += np.float64(log_misses[address(i_x, i_y, i_z, strides[0], strides[1], directory)])
            before = here
        if t_x < t_y and t_x < t_z:
            i_x += walk_x
            t_x = (i_x + ahead_x - p_x) * i_v_x
        elif t_y < t_z:
            i_y += walk_y
            t_y = (i_y + ahead_y - p_y) * i_v_y
        else:
            i_z += walk_z
            t_z = (i_z + ahead_z - p_z) * i_v_z
    log_miss = np.float64(log_misses[address(e_x, e_y, e_z, strides[0], strides[1], directory)])
    if ends_inside:
        return log_pass, log_miss
    if int(t_out * FIXED_POINT) > before:
        log_pass += log_miss
    return log_pass, outside
