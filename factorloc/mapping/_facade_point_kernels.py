"""Which points of a spatial scan stand for upright surfaces, and where their boxes lie."""

import math

from factorloc._jit import exact_kernel, kernel
from factorloc.intervals._arithmetic_kernels import add, lower, multiply, subtract, upper


@kernel(allocates=False)
def find_columns(points, low_x, low_y, per_metre, lowest, highest):
    """Write the span of heights of the points of every cell.

    Parameters
    ----------
    points : (N, 3) float
        m, in the frame of the body.
    low_x, low_y, per_metre : float
        Corner (m) of the grid and cells a metre.
    lowest, highest : (X, Y) float
        Written, m; +inf and -inf in cells without a point.
    """
    columns, rows = lowest.shape
    for i in range(columns):
        for j in range(rows):
            lowest[i, j] = math.inf
            highest[i, j] = -math.inf
    for k in range(points.shape[0]):
        x, y = (points[k, 0] - low_x) * per_metre, (points[k, 1] - low_y) * per_metre
        if x >= 0.0 and y >= 0.0 and x < columns and y < rows:
            i, j, z = int(x), int(y), points[k, 2]
            lowest[i, j] = min(lowest[i, j], z)
            highest[i, j] = max(highest[i, j], z)


@kernel(allocates=False)
def choose_points(points, low_x, low_y, per_metre, lowest, highest, span, top, bottom, fine, taken, chosen):
    """Choose one point of every fine cell of tall columns: the first one that is no ground.

    Parameters
    ----------
    points, low_x, low_y, per_metre, lowest, highest
        As in :func:`find_columns`.
    span : float
        Least difference of heights in a column, m.
    top : float
        Height that columns must reach, m.
    bottom : float
        Points below are not chosen, m.
    fine : float
        Fine cells a metre.
    taken : (X', Y') bool
        Fine cells, all false; written.
    chosen : (N,) int64
        Written: rows of the points.

    Returns
    -------
    int
        How many.
    """
    columns, rows = lowest.shape
    wide, high = taken.shape
    count = 0
    for k in range(points.shape[0]):
        z = points[k, 2]
        x, y = (points[k, 0] - low_x) * per_metre, (points[k, 1] - low_y) * per_metre
        if not (z >= bottom and x >= 0.0 and y >= 0.0 and x < columns and y < rows):
            continue
        i, j = int(x), int(y)
        if highest[i, j] < top or highest[i, j] - lowest[i, j] < span:
            continue
        u, v = int((points[k, 0] - low_x) * fine), int((points[k, 1] - low_y) * fine)
        if u < wide and v < high and not taken[u, v]:
            taken[u, v] = True
            chosen[count] = k
            count += 1
    return count


@exact_kernel(allocates=False)
def turned(al, ah, bl, bh, cl, ch, sl, sh):
    """``(c a - s b, s a + c b)``."""
    pl, ph = multiply(cl, ch, al, ah)
    ql, qh = multiply(sl, sh, bl, bh)
    ul, uh = subtract(pl, ph, ql, qh)
    pl, ph = multiply(sl, sh, al, ah)
    ql, qh = multiply(cl, ch, bl, bh)
    vl, vh = add(pl, ph, ql, qh)
    return ul, uh, vl, vh


@exact_kernel(allocates=False)
def enclose_points(ranges, bearing, elevation, mount, tilt, turn, travel, lo, hi):
    """Write boxes (x, y) in the level frame of the body, at the time of the scan, around measured points.

    ``R_y(pitch) R_x(roll) (R_mount r u(b, e) + t_mount)``, turned and moved by the vehicle until the time of the scan.

    Parameters
    ----------
    ranges : (2, N) float
        Bounds, m.
    bearing, elevation : (4, N) float
        Bounds of cosine and sine of the angles of rays in the sensor frame.
    mount : (3, 4) float
        ``T_body_sensor``.
    tilt : (8,) float
        Bounds of cosine and sine of roll and of pitch.
    turn : (4, N) float
        Bounds of cosine and sine of the turn of the body from the scan's time to that of the ray.
    travel : (4, N) float
        Bounds of the way of the body meanwhile, x then y, m.
    lo, hi : (2, N) float
        Written, m.
    """
    for i in range(lo.shape[1]):
        rl, rh = ranges[0, i], ranges[1, i]
        pl, ph = multiply(rl, rh, elevation[0, i], elevation[1, i])
        zl, zh = multiply(rl, rh, elevation[2, i], elevation[3, i])
        xl, xh = multiply(pl, ph, bearing[0, i], bearing[1, i])
        yl, yh = multiply(pl, ph, bearing[2, i], bearing[3, i])
        bxl, bxh = mounted(mount, 0, xl, xh, yl, yh, zl, zh)
        byl, byh = mounted(mount, 1, xl, xh, yl, yh, zl, zh)
        bzl, bzh = mounted(mount, 2, xl, xh, yl, yh, zl, zh)
        yl, yh, zl, zh = turned(byl, byh, bzl, bzh, tilt[0], tilt[1], tilt[2], tilt[3])
        zl, zh, xl, xh = turned(zl, zh, bxl, bxh, tilt[4], tilt[5], tilt[6], tilt[7])
        ul, uh, vl, vh = turned(xl, xh, yl, yh, turn[0, i], turn[1, i], turn[2, i], turn[3, i])
        lo[0, i], hi[0, i] = add(ul, uh, travel[0, i], travel[1, i])
        lo[1, i], hi[1, i] = add(vl, vh, travel[2, i], travel[3, i])


@exact_kernel(allocates=False)
def mounted(mount, row, xl, xh, yl, yh, zl, zh):
    """One row of a rigid motion of numbers, applied to intervals."""
    a, b, c, d = mount[row, 0], mount[row, 1], mount[row, 2], mount[row, 3]
    pl, ph = multiply(a, a, xl, xh)
    ql, qh = multiply(b, b, yl, yh)
    pl, ph = add(pl, ph, ql, qh)
    ql, qh = multiply(c, c, zl, zh)
    pl, ph = add(pl, ph, ql, qh)
    return lower(pl + d), upper(ph + d)
