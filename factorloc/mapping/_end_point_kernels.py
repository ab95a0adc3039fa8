"""Look-ups of end points in likelihood fields: for many poses at once, and normalized along each ray.

The sum over a planar scan is what a particle filter spends its time on. It makes two passes over the rays of a pose:
one that moves and clamps all end points and writes their cells, which vectorizes, and one that adds up the table. A rim
of one cell takes the points outside, so that neither pass has a branch.
"""

import math

import numpy as np

from factorloc._jit import kernel
from factorloc.mapping._spatial_forward_kernels import integrate_spatial
from factorloc.mapping._spatial_traversal_kernels import address, clip_axis


@kernel(allocates=False)
def end_point_sums(table, shape, low, resolution, poses, x, y, cells, out):
    """Sum of a table at the end points of a planar scan, for each pose.

    Parameters
    ----------
    table : (cells with rim,) float32
        Log scores.
    shape : (int, int)
        Cells without rim; fewer than 2^31 with it.
    low : (2,) float64
        Lowest corner of the grid, m.
    resolution : float
        Edge of a cell, m.
    poses : (P, 3) float64
        T_map_body.
    x, y : (N,) float64
        End points in the body frame, in cells.
    cells : (N,) int32
        Scratch.
    out : (P,) float64
        Written.
    """
    n = x.shape[0]
    high_x = shape[0] + 1.0
    high_y = shape[1] + 1.0
    stride = np.int32(shape[1] + 2)
    inverse = 1.0 / resolution
    for p in range(poses.shape[0]):
        c = math.cos(poses[p, 2])
        s = math.sin(poses[p, 2])
        t_x = (poses[p, 0] - low[0]) * inverse + 1.0
        t_y = (poses[p, 1] - low[1]) * inverse + 1.0
        for i in range(n):
            p_x = min(max(c * x[i] - s * y[i] + t_x, 0.0), high_x)
            p_y = min(max(s * x[i] + c * y[i] + t_y, 0.0), high_y)
            cells[i] = np.int32(np.int32(p_x) * stride) + np.int32(p_y)
        total = 0.0
        for i in range(n):
            # An unsigned index need not be asked whether it counts from the end.
            total += np.float64(table[np.uint32(cells[i])])
        out[p] = total


@kernel(allocates=False)
def spatial_end_point_sums(directory, table, strides, shape, poses, points, out):
    """Sum of a table at the end points of a spatial scan, for each pose.

    Parameters
    ----------
    directory : None or int32, flat
        None for a dense array; else the brick of every place.
    table : float, flat
        Log scores: a dense array with a rim of one cell, or a pool of bricks.
    strides : (int, int, int)
        Of the dense array, or of the directory.
    shape : (int, int, int)
        Cells without rim.
    poses : (P, 3, 4) float64
        Rotation and position, in cells of the grid plus one (a cell before the grid has the number 0).
    points : (N, 3) float64
        End points in the body frame, in cells.
    out : (P,) float64
        Written.
    """
    high_x = shape[0] + 1.0
    high_y = shape[1] + 1.0
    high_z = shape[2] + 1.0
    for p in range(poses.shape[0]):
        T = poses[p]
        total = 0.0
        for i in range(points.shape[0]):
            x = points[i, 0]
            y = points[i, 1]
            z = points[i, 2]
            i_x = int(min(max(T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3], 0.0), high_x)) - 1
            i_y = int(min(max(T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3], 0.0), high_y)) - 1
            i_z = int(min(max(T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3], 0.0), high_z)) - 1
            total += np.float64(table[np.uint64(address(i_x, i_y, i_z, strides[0], strides[1], directory))])
        out[p] = total


@kernel(allocates=False)
def normalized_end_point_log_likelihoods(
    directory, scores, strides, rim, shape, outside, low, resolution, pose, origins, directions, lengths, status,
    limits, shares, out,
):  # fmt: skip
    """Log-likelihood of each ray under scores that are normalized over the measured range (thesis, section 7.6.2).

    Scores are constant in each cell: their integral from the minimum to the maximum range is a walk.

    Parameters
    ----------
    directory, strides, rim, shape, outside, low, resolution
        As :class:`factorloc.mapping.cell_layout.CellLayout`.
    scores : float, flat
        Positive.
    pose : (4, 4) float64
        T_map_body.
    origins, directions : (N, 3) float64
        Rays in the body frame.
    lengths : (N,) float64
    status : (N,) uint8
        0 return, 1 below minimum, 2 no return.
    limits : (2,) float64
        Minimum and maximum range, m.
    shares : (3,) float64
        Log-probabilities of the three outcomes.
    out : (N,) float64
        Written.
    """
    n_x, n_y, n_z = shape
    inverse = 1.0 / resolution
    for k in range(lengths.shape[0]):
        if status[k] != 0:
            out[k] = shares[status[k]]
            continue
        x, y, z = origins[k, 0], origins[k, 1], origins[k, 2]
        p_x = (pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3] - low[0]) * inverse
        p_y = (pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3] - low[1]) * inverse
        p_z = (pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3] - low[2]) * inverse
        x, y, z = directions[k, 0], directions[k, 1], directions[k, 2]
        v_x = (pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z) * inverse
        v_y = (pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z) * inverse
        v_z = (pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z) * inverse
        t_in, t_out = clip_axis(p_x, v_x, float(n_x), limits[0], limits[1])
        t_in, t_out = clip_axis(p_y, v_y, float(n_y), t_in, t_out)
        t_in, t_out = clip_axis(p_z, v_z, float(n_z), t_in, t_out)
        total = outside * (limits[1] - limits[0])
        if t_in < t_out:
            total = outside * (limits[1] - limits[0] - (t_out - t_in)) + integrate_spatial(
                directory, scores, strides, p_x + rim, p_y + rim, p_z + rim, v_x, v_y, v_z, t_in, t_out
            )
        i_x = math.floor(p_x + v_x * lengths[k])
        i_y = math.floor(p_y + v_y * lengths[k])
        i_z = math.floor(p_z + v_z * lengths[k])
        score = outside
        if 0 <= i_x < n_x and 0 <= i_y < n_y and 0 <= i_z < n_z:
            score = np.float64(scores[address(i_x, i_y, i_z, strides[0], strides[1], directory)])
        out[k] = shares[0] + math.log(score / total)
