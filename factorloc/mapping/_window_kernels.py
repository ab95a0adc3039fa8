"""Hits and misses of rays in a dense window around a place: as much of ray statistics as a reflection map needs.

The window is cut into slices along z, as a beam of a turning lidar stays in few of them: cell ``(z, x, y)`` of the
window lies at ``(z + 1, x + 1, y + 1)`` of arrays with a rim of one cell. Crossings are computed from the index of the
line, as everywhere in the package, so that counts are those of the exact walk but for pieces shorter than 2^-20 m.
"""

import math

from factorloc._jit import exact_kernel
from factorloc.mapping._spatial_traversal_kernels import clip_axis


@exact_kernel(allocates=False)
def count_in_window(origins, directions, ranges, status, T_window_sensor, resolution, shape, first, last, hits, misses):
    """Add the rays ``first:last`` of a scan to hits and misses of the cells of a window.

    Parameters
    ----------
    origins, directions : (M, 3) float64
        Rays in the sensor frame, m and unit vectors.
    ranges : (M,) float64
        Length of each ray, m.
    status : (M,) uint8
        0 is a return, 1 a ray below the minimum, which is left out, 2 one without return.
    T_window_sensor : (4, 4) float64
        Pose of the sensor in a frame with the axes of the window, m, its origin in the lowest corner.
    resolution : float
        Edge length of a cell, m.
    shape : (int, int, int)
        Cells along x, y and z.
    hits, misses : (cells with rim,) uint32
        Flat; added to.

    Returns
    -------
    int
        Rays that ended in the window.
    """
    n_x, n_y, n_z = shape
    stride_x = n_y + 2
    stride_z = (n_x + 2) * stride_x
    inverse = 1.0 / resolution
    r00 = T_window_sensor[0, 0] * inverse
    r01 = T_window_sensor[0, 1] * inverse
    r02 = T_window_sensor[0, 2] * inverse
    r10 = T_window_sensor[1, 0] * inverse
    r11 = T_window_sensor[1, 1] * inverse
    r12 = T_window_sensor[1, 2] * inverse
    r20 = T_window_sensor[2, 0] * inverse
    r21 = T_window_sensor[2, 1] * inverse
    r22 = T_window_sensor[2, 2] * inverse
    s_x = T_window_sensor[0, 3] * inverse
    s_y = T_window_sensor[1, 3] * inverse
    s_z = T_window_sensor[2, 3] * inverse
    ended = 0
    for k in range(first, last):
        if status[k] == 1:
            continue
        o_x = origins[k, 0]
        o_y = origins[k, 1]
        o_z = origins[k, 2]
        d_x = directions[k, 0]
        d_y = directions[k, 1]
        d_z = directions[k, 2]
        length = ranges[k]
        p_x = r00 * o_x + r01 * o_y + r02 * o_z + s_x
        p_y = r10 * o_x + r11 * o_y + r12 * o_z + s_y
        p_z = r20 * o_x + r21 * o_y + r22 * o_z + s_z
        v_x = r00 * d_x + r01 * d_y + r02 * d_z
        v_y = r10 * d_x + r11 * d_y + r12 * d_z
        v_z = r20 * d_x + r21 * d_y + r22 * d_z
        e_x = math.floor(p_x + v_x * length)
        e_y = math.floor(p_y + v_y * length)
        e_z = math.floor(p_z + v_z * length)
        i_x = math.floor(p_x)
        i_y = math.floor(p_y)
        i_z = math.floor(p_z)
        begins = 0 <= i_x < n_x and 0 <= i_y < n_y and 0 <= i_z < n_z
        ends = 0 <= e_x < n_x and 0 <= e_y < n_y and 0 <= e_z < n_z
        if not (begins and ends):
            t_in, t_out = clip_axis(p_x, v_x, n_x, 0.0, length)
            t_in, t_out = clip_axis(p_y, v_y, n_y, t_in, t_out)
            t_in, t_out = clip_axis(p_z, v_z, n_z, t_in, t_out)
            if t_in >= t_out:
                continue
            if not begins:
                i_x = min(max(math.floor(p_x + v_x * t_in), 0), n_x - 1)
                i_y = min(max(math.floor(p_y + v_y * t_in), 0), n_y - 1)
                i_z = min(max(math.floor(p_z + v_z * t_in), 0), n_z - 1)
            if not ends:
                e_x = min(max(math.floor(p_x + v_x * t_out), 0), n_x - 1)
                e_y = min(max(math.floor(p_y + v_y * t_out), 0), n_y - 1)
                e_z = min(max(math.floor(p_z + v_z * t_out), 0), n_z - 1)
        i_v_x = 1.0 / v_x
        i_v_y = 1.0 / v_y
        i_v_z = 1.0 / v_z
        step_x = 1.0 if v_x >= 0.0 else -1.0
        step_y = 1.0 if v_y >= 0.0 else -1.0
        step_z = 1.0 if v_z >= 0.0 else -1.0
        line_x = i_x + 0.5 + 0.5 * step_x
        line_y = i_y + 0.5 + 0.5 * step_y
        line_z = i_z + 0.5 + 0.5 * step_z
        # A ray along a line may cross it by its direction and not by its end, which is rounded; the end decides.
        t_x = (line_x - p_x) * i_v_x if i_x != e_x else math.inf
        t_y = (line_y - p_y) * i_v_y if i_y != e_y else math.inf
        t_z = (line_z - p_z) * i_v_z if i_z != e_z else math.inf
        cell_x = stride_x if v_x >= 0.0 else -stride_x
        cell_y = 1 if v_y >= 0.0 else -1
        cell_z = stride_z if v_z >= 0.0 else -stride_z
        cell = (i_z + 1) * stride_z + (i_x + 1) * stride_x + i_y + 1
        for _ in range(abs(e_x - i_x) + abs(e_y - i_y) + abs(e_z - i_z)):
            misses[cell] += 1
            if t_x < t_y and t_x < t_z:
                line_x += step_x
                t_x = (line_x - p_x) * i_v_x
                cell += cell_x
            elif t_y < t_z:
                line_y += step_y
                t_y = (line_y - p_y) * i_v_y
                cell += cell_y
            else:
                line_z += step_z
                t_z = (line_z - p_z) * i_v_z
                cell += cell_z
        # Rounding may lead to a neighbour of the last cell, or onto the rim; the end decides here, too.
        cell = (e_z + 1) * stride_z + (e_x + 1) * stride_x + e_y + 1
        if ends and status[k] == 0:
            hits[cell] += 1
            ended += 1
        else:
            misses[cell] += 1
    return ended


@exact_kernel(allocates=False)
def gather_shaft_returns(
    origins, directions, ranges, status, T_window_sensor, resolution, shape, owners, centres, bottoms, tops, moments
):
    """Add up what the returns of a scan tell of the shafts they come from.

    Arguments as :func:`count_in_window`, and

    Parameters
    ----------
    owners : (n_x, n_y) int64
        Which shaft the returns in a column belong to, or -1.
    centres : (P, 2) float64
        First guesses of axes in the window, m; sums are taken about them.
    bottoms, tops : (P,) int64
        Slices of each shaft.
    moments : (P, 11) float64
        Added to, over the returns at ``p`` of rays with the horizontal direction ``u``, to whose left is ``v``: 1; p;
        u; (v p)^2; v (v p); v_x^2, v_x v_y, v_y^2.
    """
    n_x, n_y, n_z = shape
    inverse = 1.0 / resolution
    for k in range(ranges.shape[0]):
        if status[k] != 0:
            continue
        o_x = origins[k, 0] + directions[k, 0] * ranges[k]
        o_y = origins[k, 1] + directions[k, 1] * ranges[k]
        o_z = origins[k, 2] + directions[k, 2] * ranges[k]
        x = T_window_sensor[0, 0] * o_x + T_window_sensor[0, 1] * o_y + T_window_sensor[0, 2] * o_z
        y = T_window_sensor[1, 0] * o_x + T_window_sensor[1, 1] * o_y + T_window_sensor[1, 2] * o_z
        z = T_window_sensor[2, 0] * o_x + T_window_sensor[2, 1] * o_y + T_window_sensor[2, 2] * o_z
        x += T_window_sensor[0, 3]
        y += T_window_sensor[1, 3]
        z += T_window_sensor[2, 3]
        i = math.floor(x * inverse)
        j = math.floor(y * inverse)
        level = math.floor(z * inverse)
        if not (0 <= i < n_x and 0 <= j < n_y and 0 <= level < n_z):
            continue
        p = owners[i, j]
        if p < 0 or level < bottoms[p] or level >= tops[p]:
            continue
        u_x = (
            T_window_sensor[0, 0] * directions[k, 0]
            + T_window_sensor[0, 1] * directions[k, 1]
            + T_window_sensor[0, 2] * directions[k, 2]
        )
        u_y = (
            T_window_sensor[1, 0] * directions[k, 0]
            + T_window_sensor[1, 1] * directions[k, 1]
            + T_window_sensor[1, 2] * directions[k, 2]
        )
        norm = math.sqrt(u_x * u_x + u_y * u_y)
        if norm == 0.0:
            continue
        u_x /= norm
        u_y /= norm
        x -= centres[p, 0]
        y -= centres[p, 1]
        across = u_x * y - u_y * x
        moments[p, 0] += 1.0
        moments[p, 1] += x
        moments[p, 2] += y
        moments[p, 3] += u_x
        moments[p, 4] += u_y
        moments[p, 5] += across * across
        moments[p, 6] -= u_y * across
        moments[p, 7] += u_x * across
        moments[p, 8] += u_y * u_y
        moments[p, 9] -= u_x * u_y
        moments[p, 10] += u_x * u_x
