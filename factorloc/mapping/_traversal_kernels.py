"""Exact traversal of planar grids: hits, misses and path lengths of rays.

Amanatides and Woo's walk with the number of steps known beforehand. The crossing with a grid line is computed from the
line's own index, ``(line - p) / v``, never by adding up increments: a ray then leaves the same integers in a cell
however it is clipped, in whatever order and by whatever thread it is walked.

Lengths are integers in units of 2^-20 m (about a micrometre). The end of one piece is the start of the next, so the
pieces of a ray add up to its length without any rounding; a piece shorter than the unit is no visit.
"""

import math

from factorloc._jit import exact_kernel

FIXED_POINT = 2**20
"""Units of path length per metre."""

MISS_BITS = 22
"""While rays are walked, one integer of a cell holds its misses, in so many bits, and its path length above them."""

MOST_RAYS = 2**21
"""Rays that may be walked before misses or path lengths could overflow (in cells of up to half a metre)."""


@exact_kernel(allocates=False)
def clip_ray(p_x, p_y, v_x, v_y, length, n_x, n_y):
    """Part of a ray inside [0, n_x] x [0, n_y] (cell units): parameters (t_in, t_out), empty if t_in > t_out."""
    t_in = 0.0
    t_out = length
    if v_x != 0.0:
        a = -p_x / v_x
        b = (n_x - p_x) / v_x
        t_in = max(t_in, min(a, b))
        t_out = min(t_out, max(a, b))
    elif p_x < 0.0 or p_x >= n_x:
        t_out = -1.0
    if v_y != 0.0:
        a = -p_y / v_y
        b = (n_y - p_y) / v_y
        t_in = max(t_in, min(a, b))
        t_out = min(t_out, max(a, b))
    elif p_y < 0.0 or p_y >= n_y:
        t_out = -1.0
    return t_in, t_out


@exact_kernel(allocates=False)
def accumulate(origins, directions, lengths, is_return, first, last, low, resolution, shape, walked, hits):
    """Walk the rays ``first:last`` through a planar grid.

    Parameters
    ----------
    origins, directions : (M, 2) float64
        Rays in the frame of the grid, m and unit vectors.
    lengths : (M,) float64
        Length of each ray, m.
    is_return : (M,) bool
        Whether the ray was reflected at its end.
    low : (2,) float64
        Lowest corner of the grid, m.
    resolution : float
        Edge length of a cell, m.
    shape : (int, int)
        Cells along x and y.
    walked : ((n_x + 2) * (n_y + 2),) int64
        Path length (fixed point) of each cell above its misses in the lower 22 bits: one integer to add to, for a walk
        is bound by memory. With a rim of one cell that keeps rounding at the border inside the array. Added to.
    hits : ((n_x + 2) * (n_y + 2),) uint32
        Added to.
    """
    n_x, n_y = shape
    width = n_y + 2
    inverse = 1.0 / resolution
    for k in range(first, last):
        p_x = (origins[k, 0] - low[0]) * inverse
        p_y = (origins[k, 1] - low[1]) * inverse
        v_x = directions[k, 0] * inverse
        v_y = directions[k, 1] * inverse
        length = lengths[k]
        i_x = math.floor(p_x)
        i_y = math.floor(p_y)
        e_x = math.floor(p_x + v_x * length)
        e_y = math.floor(p_y + v_y * length)
        ends_here = is_return[k]
        t_in = 0.0
        t_out = length
        inside = 0 <= i_x < n_x and 0 <= i_y < n_y and 0 <= e_x < n_x and 0 <= e_y < n_y
        if not inside:
            t_in, t_out = clip_ray(p_x, p_y, v_x, v_y, length, n_x, n_y)
            if t_in > t_out:
                continue
            ends_here = ends_here and 0 <= e_x < n_x and 0 <= e_y < n_y
            i_x = min(max(math.floor(p_x + v_x * t_in), 0), n_x - 1)
            i_y = min(max(math.floor(p_y + v_y * t_in), 0), n_y - 1)
            e_x = min(max(math.floor(p_x + v_x * t_out), 0), n_x - 1)
            e_y = min(max(math.floor(p_y + v_y * t_out), 0), n_y - 1)
        i_v_x = 1.0 / v_x
        i_v_y = 1.0 / v_y
        line_x = i_x + 1.0 if v_x >= 0.0 else float(i_x)
        line_y = i_y + 1.0 if v_y >= 0.0 else float(i_y)
        step_x = 1.0 if v_x >= 0.0 else -1.0
        step_y = 1.0 if v_y >= 0.0 else -1.0
        stride_x = width if v_x >= 0.0 else -width
        stride_y = 1 if v_y >= 0.0 else -1
        # A ray along a line may cross it by its direction and not by its end, which is rounded; the end decides.
        t_x = (line_x - p_x) * i_v_x if i_x != e_x else math.inf
        t_y = (line_y - p_y) * i_v_y if i_y != e_y else math.inf
        cell = (i_x + 1) * width + i_y + 1
        before = int(t_in * FIXED_POINT)
        for _ in range(abs(e_x - i_x) + abs(e_y - i_y)):
            if t_x < t_y:
                here = int(min(t_x, t_out) * FIXED_POINT)
                if here > before:
                    walked[cell] += ((here - before) << MISS_BITS) + 1
                    before = here
                cell += stride_x
                line_x += step_x
                t_x = (line_x - p_x) * i_v_x
            else:
                here = int(min(t_y, t_out) * FIXED_POINT)
                if here > before:
                    walked[cell] += ((here - before) << MISS_BITS) + 1
                    before = here
                cell += stride_y
                line_y += step_y
                t_y = (line_y - p_y) * i_v_y
        cell = (e_x + 1) * width + e_y + 1
        here = int(t_out * FIXED_POINT)
        walked[cell] += max(here - before, 0) << MISS_BITS
        if ends_here:
            hits[cell] += 1
        elif here > before:
            walked[cell] += 1


@exact_kernel(allocates=False)
def add_private(walked, hits, shape, hits_out, misses_out, path_out):
    """Add what threads accumulated privately to the statistics.

    Parameters
    ----------
    walked, hits : (threads, cells with rim) int64 and uint32
        As :func:`accumulate` leaves them.
    shape : (int, int)
    hits_out, misses_out : (n_x, n_y) uint32
        Added to.
    path_out : (n_x, n_y) int64
        Added to.
    """
    n_x, n_y = shape
    for i in range(n_x):
        for b in range(walked.shape[0]):
            cell = (i + 1) * (n_y + 2) + 1
            for j in range(n_y):
                value = walked[b, cell]
                path_out[i, j] += value >> MISS_BITS
                misses_out[i, j] += value & (2**MISS_BITS - 1)
                hits_out[i, j] += hits[b, cell]
                cell += 1
