"""Exact traversal of spatial grids, dense and in bricks: hits, misses and path lengths of rays.

The walk is that of the planar kernels: crossings come from the index of the line, lengths are integers in units of
2^-20 m, and a piece shorter than that is no visit. Two things differ. Threads do not own private grids, which would be
too large, but *slabs* of cells along x; a ray enters a slab exactly where a walk of the whole grid would cross into it,
so that the statistics do not depend on the slabs. And cells may lie in bricks of 16 x 16 x 16, found through a dense
directory.

Both layouts have a rim, of one cell or of one brick, that keeps rounding at the border inside the arrays. Bricks have
the number 0 where there is none: a spare brick that nobody reads.
"""

import math

from factorloc._jit import exact_kernel
from factorloc.mapping._traversal_kernels import FIXED_POINT, MISS_BITS

BRICK = 16
"""Cells along an edge of a brick."""


@exact_kernel(allocates=False)
def clip_axis(p, v, n, t_in, t_out):
    """Shorten the part (t_in, t_out) of a ray to where one coordinate lies in [0, n]; empty if t_in > t_out."""
    if v != 0.0:
        a = -p / v
        b = (n - p) / v
        return max(t_in, min(a, b)), min(t_out, max(a, b))
    if p < 0.0 or p >= n:
        return t_in, -1.0
    return t_in, t_out


@exact_kernel(allocates=False)
def cell_at(p, v, i_v, start, end, t):
    """Cell along one axis once every line up to ``t`` is crossed, by the very numbers the walk compares."""
    if start == end:
        return start
    i = min(max(math.floor(p + v * t), min(start, end)), max(start, end))
    if v >= 0.0:
        while i < end and (i + 1.0 - p) * i_v <= t:
            i += 1
        while i > start and (i - p) * i_v > t:
            i -= 1
    else:
        while i > end and (i - p) * i_v <= t:
            i -= 1
        while i < start and (i + 1.0 - p) * i_v > t:
            i += 1
    return i


@exact_kernel(allocates=False)
def address(i_x, i_y, i_z, stride_x, stride_y, directory):
    """Place of a cell in the pool: of a dense grid with rim, or of bricks."""
    if directory is None:
        return (i_x + 1) * stride_x + (i_y + 1) * stride_y + i_z + 1
    brick = directory[((i_x >> 4) + 1) * stride_x + ((i_y >> 4) + 1) * stride_y + (i_z >> 4) + 1]
    return (brick << 12) + ((i_x & 15) << 8) + ((i_y & 15) << 4) + (i_z & 15)


@exact_kernel(allocates=False)
def accumulate_spatial(
    origins, directions, lengths, is_return, first_x, last_x, low, resolution, shape, directory, walked, hits
):
    """Walk all rays through the cells ``first_x <= x < last_x`` of a spatial grid.

    Parameters
    ----------
    origins, directions : (M, 3) float64
        Rays in the frame of the grid, m and unit vectors.
    lengths : (M,) float64
        Length of each ray, m.
    is_return : (M,) bool
        Whether the ray was reflected at its end.
    first_x, last_x : int
        The slab this call may write to.
    low : (3,) float64
        Lowest corner of the grid, m.
    resolution : float
        Edge length of a cell, m.
    shape : (int, int, int)
        Cells along x, y and z.
    directory : None or int32, flat
        None for a dense grid; else the brick of every place, with a rim of one brick.
    walked : (cells,) int64
        Path length (fixed point) of each cell above its misses in the lower 22 bits. Added to.
    hits : (cells,) uint32
        Added to.
    """
    n_x, n_y, n_z = shape
    if directory is None:
        stride_y = n_z + 2
        stride_x = stride_y * (n_y + 2)
    else:
        stride_y = ((n_z + 15) >> 4) + 2
        stride_x = stride_y * (((n_y + 15) >> 4) + 2)
    inverse = 1.0 / resolution
    for k in range(lengths.shape[0]):
        p_x = (origins[k, 0] - low[0]) * inverse
        v_x = directions[k, 0] * inverse
        length = lengths[k]
        # Most rays that miss the slab are told apart by their ends.
        if max(p_x, p_x + v_x * length) < first_x - 1.0 or min(p_x, p_x + v_x * length) > last_x + 1.0:
            continue
        p_y = (origins[k, 1] - low[1]) * inverse
        p_z = (origins[k, 2] - low[2]) * inverse
        v_y = directions[k, 1] * inverse
        v_z = directions[k, 2] * inverse
        i_x = math.floor(p_x)
        i_y = math.floor(p_y)
        i_z = math.floor(p_z)
        e_x = math.floor(p_x + v_x * length)
        e_y = math.floor(p_y + v_y * length)
        e_z = math.floor(p_z + v_z * length)
        ends_here = is_return[k]
        t_in = 0.0
        t_out = length
        inside = 0 <= i_x < n_x and 0 <= i_y < n_y and 0 <= i_z < n_z
        end_inside = 0 <= e_x < n_x and 0 <= e_y < n_y and 0 <= e_z < n_z
        if not (inside and end_inside):
            t_in, t_out = clip_axis(p_x, v_x, n_x, t_in, t_out)
            t_in, t_out = clip_axis(p_y, v_y, n_y, t_in, t_out)
            t_in, t_out = clip_axis(p_z, v_z, n_z, t_in, t_out)
            if t_in > t_out:
                continue
            ends_here = ends_here and end_inside
            i_x = min(max(math.floor(p_x + v_x * t_in), 0), n_x - 1)
            i_y = min(max(math.floor(p_y + v_y * t_in), 0), n_y - 1)
            i_z = min(max(math.floor(p_z + v_z * t_in), 0), n_z - 1)
            e_x = min(max(math.floor(p_x + v_x * t_out), 0), n_x - 1)
            e_y = min(max(math.floor(p_y + v_y * t_out), 0), n_y - 1)
            e_z = min(max(math.floor(p_z + v_z * t_out), 0), n_z - 1)
        i_v_x = 1.0 / v_x
        i_v_y = 1.0 / v_y
        i_v_z = 1.0 / v_z
        if max(i_x, e_x) < first_x or min(i_x, e_x) >= last_x:
            continue
        leaves = False
        if i_x < first_x or i_x >= last_x:
            line = first_x if i_x < first_x else last_x
            t = (line - p_x) * i_v_x
            i_y = cell_at(p_y, v_y, i_v_y, i_y, e_y, t)
            i_z = cell_at(p_z, v_z, i_v_z, i_z, e_z, t)
            i_x = first_x if i_x < first_x else last_x - 1
            t_in = min(max(t, t_in), t_out)
        if e_x < first_x or e_x >= last_x:
            line = first_x if e_x < first_x else last_x
            t = (line - p_x) * i_v_x
            e_y = cell_at(p_y, v_y, i_v_y, i_y, e_y, t)
            e_z = cell_at(p_z, v_z, i_v_z, i_z, e_z, t)
            e_x = first_x if e_x < first_x else last_x - 1
            t_out = min(max(t, t_in), t_out)
            leaves = True
        up_x = v_x >= 0.0
        up_y = v_y >= 0.0
        up_z = v_z >= 0.0
        line_x = i_x + 1.0 if up_x else float(i_x)
        line_y = i_y + 1.0 if up_y else float(i_y)
        line_z = i_z + 1.0 if up_z else float(i_z)
        step_x = 1.0 if up_x else -1.0
        step_y = 1.0 if up_y else -1.0
        step_z = 1.0 if up_z else -1.0
        # A ray along a line may cross it by its direction and not by its end, which is rounded; the end decides.
        t_x = (line_x - p_x) * i_v_x if i_x != e_x else math.inf
        t_y = (line_y - p_y) * i_v_y if i_y != e_y else math.inf
        t_z = (line_z - p_z) * i_v_z if i_z != e_z else math.inf
        steps = abs(e_x - i_x) + abs(e_y - i_y) + abs(e_z - i_z)
        before = int(t_in * FIXED_POINT)
        cell = address(i_x, i_y, i_z, stride_x, stride_y, directory)
        walk_x = 1 if up_x else -1
        walk_y = 1 if up_y else -1
        walk_z = 1 if up_z else -1
        if directory is None:
            cell_x = walk_x * stride_x
            cell_y = walk_y * stride_y
        else:
            cell_x = walk_x << 8
            cell_y = walk_y << 4
        for _ in range(steps):
            if t_x < t_y and t_x < t_z:
                here = int(min(t_x, t_out) * FIXED_POINT)
                if here > before:
                    walked[cell] += ((here - before) << MISS_BITS) + 1
                    before = here
                line_x += step_x
                t_x = (line_x - p_x) * i_v_x
                cell += cell_x
                if directory is not None:
                    i_x += walk_x
                    if (i_x ^ (i_x - walk_x)) >> 4:
                        cell = address(i_x, i_y, i_z, stride_x, stride_y, directory)
            elif t_y < t_z:
                here = int(min(t_y, t_out) * FIXED_POINT)
                if here > before:
                    walked[cell] += ((here - before) << MISS_BITS) + 1
                    before = here
                line_y += step_y
                t_y = (line_y - p_y) * i_v_y
                cell += cell_y
                if directory is not None:
                    i_y += walk_y
                    if (i_y ^ (i_y - walk_y)) >> 4:
                        cell = address(i_x, i_y, i_z, stride_x, stride_y, directory)
            else:
                here = int(min(t_z, t_out) * FIXED_POINT)
                if here > before:
                    walked[cell] += ((here - before) << MISS_BITS) + 1
                    before = here
                line_z += step_z
                t_z = (line_z - p_z) * i_v_z
                cell += walk_z
                if directory is not None:
                    i_z += walk_z
                    if (i_z ^ (i_z - walk_z)) >> 4:
                        cell = address(i_x, i_y, i_z, stride_x, stride_y, directory)
        cell = address(e_x, e_y, e_z, stride_x, stride_y, directory)
        here = int(t_out * FIXED_POINT)
        if ends_here and not leaves:
            walked[cell] += max(here - before, 0) << MISS_BITS
            hits[cell] += 1
        elif here > before:
            walked[cell] += ((here - before) << MISS_BITS) + 1
