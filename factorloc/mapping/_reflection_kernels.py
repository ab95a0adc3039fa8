"""Log-likelihoods of planar scans at many poses under reflection probabilities of the cells.

A ray is reflected in cell ``k`` with probability ``mu_k prod (1 - mu_i)``, the product over the cells it visited before
(thesis, eq. 7.23). Maps hold ``log(1 - mu)``, of which a walk is a plain sum. Which cells are visited is decided as
:mod:`factorloc.mapping._traversal_kernels` decides it when it counts: by crossings computed from the index of a line,
and with no visit where a piece is shorter than 2^-20 m. Hence strict arithmetic here as well.

Space outside the grid goes on as cells of the same raster, which are counted from one end to the other, not walked: by
the lines crossed, be it two at once in a corner.
"""

import math

from factorloc._jit import exact_kernel
from factorloc.mapping._likelihood_kernels import log_outcome
from factorloc.mapping._traversal_kernels import FIXED_POINT, clip_ray

_SHORTEST = 1.0 / FIXED_POINT  # m; a shorter chord is no visit
_PARALLEL_TO_AXIS = 1e-9  # cells/m; a ray this close to an axis crosses no line it does not lie on


@exact_kernel(allocates=False)
def first_cell(p, last):
    """Cell along one axis a ray begins in that ends in cell ``last``; from a line downwards, the one below it."""
    i = math.floor(p)
    return i - 1 if p == i and last < i else i


@exact_kernel(allocates=False)
def chord_axis(p, v, cell, length, t_in, t_out):
    """Shorten the part (t_in, t_out) of a ray to where one coordinate lies in a cell, the one the ray ends in."""
    if v == 0.0:
        return t_in, t_out
    enters = (cell - p) / v if v > 0.0 else (cell + 1.0 - p) / v
    leaves = (cell + 1.0 - p) / v if v > 0.0 else (cell - p) / v
    # That the end lies in the cell is beyond doubt; along a line, rounded crossings may lie anywhere.
    along = abs(v) < _PARALLEL_TO_AXIS
    if enters > length:
        enters = t_in if along else length
    if leaves < length:
        leaves = t_out if along else length
    return max(t_in, enters), min(t_out, leaves)


@exact_kernel(allocates=False)
def log_reflection(status, log_pass, log_miss, length, t_in, t_out):
    """Log-likelihood of a ray that comes to its last cell with a probability, from what became of it there.

    The cell reflects anywhere on the ray's chord alike (thesis, eq. 7.30 to 7.32), so a ray that is to come beyond its
    length passes so much of the cell's probability as of its chord (the integral of eq. 7.16).

    Parameters
    ----------
    status : int
        0 return, 1 below minimum, 2 no return.
    log_pass : float
        Log-probability to enter the last cell.
    log_miss : float
        ``log(1 - mu)`` of that cell.
    length, t_in, t_out : float
        Of the ray, and where its line enters and leaves the cell, m.
    """
    chord = max(t_out - t_in, _SHORTEST)
    mu = -math.expm1(log_miss)
    if status == 0:
        return log_outcome(status, log_pass, mu / chord)
    passed = mu * min(max((length - t_in) / chord, 0.0), 1.0)
    log_pass += math.log1p(-passed) if passed < 1.0 else -math.inf
    return log_outcome(status, log_pass, 0.0)


@exact_kernel(allocates=False)
def reflection_log_likelihoods(
    log_misses, shape, outside, low, resolution, poses, group, origins, directions, lengths, status, each, sums
):
    """Log-likelihood of a scan at many poses under reflection probabilities (thesis, eq. 7.23 and 8.22).

    Parameters
    ----------
    log_misses : (cells with rim,) float64
        ``log(1 - mu)`` of the cells.
    shape : (int, int)
        Cells without rim.
    outside : float
        ``log(1 - mu)`` of the cells outside the grid.
    low : (2,) float64
    resolution : float
    poses : (P, 4) float64
        Poses of the body in the map: x, y, and cosine and sine of the heading.
    group : int
        Poses that a ray is weighed at one after the other, before the next ray.
    origins, directions : (N, 2) float64
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
                x = poses[i, 0] - low[0]
                y = poses[i, 1] - low[1]
                c = poses[i, 2]
                s = poses[i, 3]
                p_x = (c * origins[k, 0] - s * origins[k, 1] + x) * inverse
                p_y = (s * origins[k, 0] + c * origins[k, 1] + y) * inverse
                v_x = (c * directions[k, 0] - s * directions[k, 1]) * inverse
                v_y = (s * directions[k, 0] + c * directions[k, 1]) * inverse
                length = lengths[k]
                log_pass, log_miss = _pass_cells(log_misses, shape, outside, p_x, p_y, v_x, v_y, length)
                t_in, t_out = chord_axis(p_x, v_x, math.floor(p_x + v_x * length), length, 0.0, math.inf)
                t_in, t_out = chord_axis(p_y, v_y, math.floor(p_y + v_y * length), length, t_in, t_out)
                value = log_reflection(status[k], log_pass, log_miss, length, t_in, t_out)
                if each.shape[0] > 0:
                    each[i, k] = value
                sums[i] += value


@exact_kernel(allocates=False)
def _pass_cells(log_misses, shape, outside, p_x, p_y, v_x, v_y, length):
    """Log-probability that a ray comes to the cell it ends in, and ``log(1 - mu)`` of that cell."""
    n_x, n_y = shape
    width = n_y + 2
    f_x = math.floor(p_x + v_x * length)
    f_y = math.floor(p_y + v_y * length)
    b_x = first_cell(p_x, f_x)
    b_y = first_cell(p_y, f_y)
    begins_inside = 0 <= b_x < n_x and 0 <= b_y < n_y
    ends_inside = 0 <= f_x < n_x and 0 <= f_y < n_y
    i_x, i_y, e_x, e_y = b_x, b_y, f_x, f_y
    t_in = 0.0
    t_out = length
    if not (begins_inside and ends_inside):
        t_in, t_out = clip_ray(p_x, p_y, v_x, v_y, length, n_x, n_y)
        if t_in >= t_out and not (begins_inside or ends_inside):
            beside = abs(f_x - b_x) + abs(f_y - b_y)
            return (beside * outside if beside > 0 else 0.0), outside
        if not begins_inside:
            i_x = min(max(math.floor(p_x + v_x * t_in), 0), n_x - 1)
            i_y = min(max(math.floor(p_y + v_y * t_in), 0), n_y - 1)
        if not ends_inside:
            e_x = min(max(math.floor(p_x + v_x * t_out), 0), n_x - 1)
            e_y = min(max(math.floor(p_y + v_y * t_out), 0), n_y - 1)
    # As many cells lie before the grid as lines are crossed on the way in; of those behind it the last is the end.
    passed = abs(i_x - b_x) + abs(i_y - b_y)
    if not ends_inside:
        passed += abs(f_x - e_x) + abs(f_y - e_y) - 1
    log_pass = passed * outside if passed > 0 else 0.0
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
        here = int(min(min(t_x, t_y), t_out) * FIXED_POINT)
        if here > before:
            log_pass += log_misses[cell]
            before = here
        if t_x < t_y:
            cell += stride_x
            line_x += step_x
            t_x = (line_x - p_x) * i_v_x
        else:
            cell += stride_y
            line_y += step_y
            t_y = (line_y - p_y) * i_v_y
    cell = (e_x + 1) * width + e_y + 1
    if ends_inside:
        return log_pass, log_misses[cell]
    if int(t_out * FIXED_POINT) > before:
        log_pass += log_misses[cell]
    return log_pass, outside
