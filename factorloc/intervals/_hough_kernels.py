"""Votes of boxes for lines, and the peaks of their accumulator."""

import numpy as np

from factorloc._jit import exact_kernel

GUARD = 2.0**-20
"""Cells; what rounding may move a bound of a line's distance, as long as distances are below 2^28 cells."""


@exact_kernel(allocates=False)
def vote(xl, xh, yl, yh, cl, ch, sl, sh, first, step, starts, ends, counts):
    """Count, for every cell of lines, the boxes that one of its lines may meet.

    Two loops for each bin of directions: one fills the numbers of the first and the last bin of distances and
    vectorizes, one adds and subtracts ones there; running sums follow. A distance ``x cos + y sin`` is rounded three
    times, its cell twice more, by less than ``8u`` of the largest cell number: the guard is more.

    Parameters
    ----------
    xl, xh, yl, yh : (N,) float
        Bounds of boxes, m.
    cl, ch, sl, sh : (A,) float
        Bounds of cosine and sine of each bin of directions.
    first, step : float
        Lowest distance and width of a bin of distances, m.
    starts, ends : (N,) int32
        To work in.
    counts : (A, D + 1) int32
        Written; the last column is to be ignored.
    """
    bins = counts.shape[1] - 1
    per_metre = 1.0 / step
    for a in range(cl.size):
        c0, c1, s0, s1 = cl[a], ch[a], sl[a], sh[a]
        for i in range(xl.size):
            p, q, r, s = xl[i] * c0, xl[i] * c1, xh[i] * c0, xh[i] * c1
            t, u, v, w = yl[i] * s0, yl[i] * s1, yh[i] * s0, yh[i] * s1
            least, less = (p if p < q else q), (r if r < s else s)
            most, more = (p if p > q else q), (r if r > s else s)
            low, high = (least if least < less else less), (most if most > more else more)
            least, less = (t if t < u else u), (v if v < w else w)
            most, more = (t if t > u else u), (v if v > w else w)
            low += least if least < less else less
            high += most if most > more else more
            x, y = np.floor((low - first) * per_metre - GUARD), np.floor((high - first) * per_metre + GUARD) + 1.0
            x = 0.0 if x < 0.0 else x
            y = 0.0 if y < 0.0 else y
            starts[i] = np.int32(bins if x > bins else x)
            ends[i] = np.int32(bins if y > bins else y)
        for d in range(bins + 1):
            counts[a, d] = 0
        for i in range(xl.size):
            counts[a, starts[i]] += 1
            counts[a, ends[i]] -= 1
        running = 0
        for d in range(bins + 1):
            running += counts[a, d]
            counts[a, d] = running


@exact_kernel(allocates=False)
def find_peak(counts, threshold, apart, stack, seen, hull):
    """Cluster of the highest cell, and what is highest elsewhere.

    The cluster is all cells above ``threshold`` times the highest that hang together (8 neighbours) with the first cell
    that is highest. Other such cells at most ``apart`` bins of distance away widen its hull: they are no other wall.

    Parameters
    ----------
    counts : (A, D + 1) int32
        Votes; the last column is ignored.
    threshold : float
    apart : int
    stack : (>= A D,) int64
        To work in.
    seen : (A, D) bool
        To work in.
    hull : (4,) int64
        Written: first and past-the-last bin of directions, then of distances.

    Returns
    -------
    (int, int)
        Votes of the peak, and the most votes more than ``apart`` bins of distance away from its hull.
    """
    rows, columns = counts.shape[0], counts.shape[1] - 1
    top, at_a, at_d = -1, 0, 0
    for a in range(rows):
        for d in range(columns):
            seen[a, d] = False
            if counts[a, d] > top:
                top, at_a, at_d = counts[a, d], a, d
    least = threshold * top
    hull[0], hull[1], hull[2], hull[3] = at_a, at_a + 1, at_d, at_d + 1
    stack[0], waiting = at_a * columns + at_d, 1
    seen[at_a, at_d] = True
    while waiting > 0:
        waiting -= 1
        a, d = stack[waiting] // columns, stack[waiting] % columns
        hull[0], hull[1] = min(hull[0], a), max(hull[1], a + 1)
        hull[2], hull[3] = min(hull[2], d), max(hull[3], d + 1)
        for i in range(max(a - 1, 0), min(a + 2, rows)):
            for j in range(max(d - 1, 0), min(d + 2, columns)):
                if not seen[i, j] and counts[i, j] > least:
                    seen[i, j] = True
                    stack[waiting] = i * columns + j
                    waiting += 1
    low, high = hull[2] - apart, hull[3] + apart
    second = 0
    for a in range(rows):
        for d in range(columns):
            if d < low or d >= high:
                second = max(second, counts[a, d])
            elif counts[a, d] > least:
                hull[0], hull[1] = min(hull[0], a), max(hull[1], a + 1)
                hull[2], hull[3] = min(hull[2], d), max(hull[3], d + 1)
    return top, second
