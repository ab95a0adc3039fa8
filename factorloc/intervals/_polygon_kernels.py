"""Clipping of convex polygons by half-planes."""

import math

from factorloc._jit import exact_kernel


@exact_kernel(allocates=False)
def clip_half_planes(a, b, c, x, y, count, room_x, room_y, margin):
    """Clip in place by ``a x + b y <= c + margin |(a, b)|``; Sutherland and Hodgman, one half-plane after the other.

    Parameters
    ----------
    a, b, c : (K,) float
        Half-planes.
    x, y : (M,) float
        Corners, counter-clockwise; the first ``count`` are set. Each half-plane adds one, with room for two.
    count : int
        Corners of the polygon.
    room_x, room_y : (M,) float
        To work in.
    margin : float
        Outward shift, m.

    Returns
    -------
    int
        Corners left; 0 if the polygon is empty.
    """
    for k in range(a.size):
        if count == 0:
            break
        limit = c[k] + margin * math.hypot(a[k], b[k])
        if limit == math.inf:
            continue
        kept = 0
        cut = full = False
        x_0, y_0 = x[count - 1], y[count - 1]
        d_0 = a[k] * x_0 + b[k] * y_0 - limit
        for i in range(count):
            # Corners almost in line may change sides several times by rounding; without room, nothing is cut off.
            full = full or kept + 2 > x.size
            if full:
                break
            x_1, y_1 = x[i], y[i]
            d_1 = a[k] * x_1 + b[k] * y_1 - limit
            if (d_0 <= 0.0) != (d_1 <= 0.0):
                t = d_0 / (d_0 - d_1)
                room_x[kept], room_y[kept] = x_0 + t * (x_1 - x_0), y_0 + t * (y_1 - y_0)
                kept += 1
                cut = True
            if d_1 <= 0.0:
                room_x[kept], room_y[kept] = x_1, y_1
                kept += 1
            else:
                cut = True
            x_0, y_0, d_0 = x_1, y_1, d_1
        if cut and not full:
            count = kept
            for i in range(kept):
                x[i], y[i] = room_x[i], room_y[i]
    return count


@exact_kernel(allocates=False)
def meets_lines(xl, xh, yl, yh, cl, ch, sl, sh, dl, dh, hull, out):
    """Which boxes meet which lines within the hulls of their segments, written to ``out`` (K, N).

    A box is on line k if ``x cos + y sin`` meets ``d`` and the box meets ``hull[:, k]``, rows x low, x high, y low, y
    high. One margin covers the five roundings of the sum: ``8u`` of the sum of magnitudes and ``ETA``.
    """
    for k in range(cl.size):
        c0, c1, s0, s1, low, high = cl[k], ch[k], sl[k], sh[k], dl[k], dh[k]
        x0, x1, y0, y1 = hull[0, k], hull[1, k], hull[2, k], hull[3, k]
        for i in range(xl.size):
            p, q, r, s = c0 * xl[i], c0 * xh[i], c1 * xl[i], c1 * xh[i]
            t, u, v, w = s0 * yl[i], s0 * yh[i], s1 * yl[i], s1 * yh[i]
            a, b = (p if p < q else q), (r if r < s else s)
            e, f = (t if t < u else u), (v if v < w else w)
            lo = (a if a < b else b) + (e if e < f else f)
            a, b = (p if p > q else q), (r if r > s else s)
            e, f = (t if t > u else u), (v if v > w else w)
            hi = (a if a > b else b) + (e if e > f else f)
            margin = 2.0**-50 * (abs(p) + abs(q) + abs(r) + abs(s) + abs(t) + abs(u) + abs(v) + abs(w)) + 2.0**-1020
            out[k, i] = (
                (not lo - margin > high)  # as what is not a number, of infinite boxes, excludes nothing
                & (not hi + margin < low)
                & (xl[i] <= x1)
                & (xh[i] >= x0)
                & (yl[i] <= y1)
                & (yh[i] >= y0)
            )
