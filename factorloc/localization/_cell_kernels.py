"""Convex polygons and cells: which cells a polygon meets, and the convex hull of cells."""

import math

from factorloc._jit import exact_kernel


@exact_kernel(allocates=False)
def mark_polygon(corners, x_first, y_first, step, slack, flags):
    """Set the cells, (Y, X), that a convex polygon (counter-clockwise) may meet.

    In a row of cells every edge bounds their middles from one side. The slack, m, covers the rounding.
    """
    rows, cells = flags.shape
    half = 0.5 * step + slack
    for y in range(rows):
        v = y_first + step * (y + 0.5)
        low, high = x_first, x_first + step * cells
        for k in range(corners.shape[0]):
            x0, y0 = corners[k, 0], corners[k, 1]
            x1, y1 = corners[(k + 1) % corners.shape[0], 0], corners[(k + 1) % corners.shape[0], 1]
            a, b = y1 - y0, x0 - x1
            room = half * (abs(a) + abs(b)) + slack - b * (v - y0)
            if abs(a) < 1e-9 * abs(b) or a == 0.0:
                # So flat an edge is followed along the row by its limit alone.
                if room + 1e-9 * abs(b) * (abs(x_first - x0) + step * cells) < 0.0:
                    high = low - step
            elif a > 0.0:
                high = min(high, x0 + room / a + slack)
            else:
                low = max(low, x0 + room / a - slack)
        first = max(math.ceil((low - x_first) / step - 0.5), 0)
        last = min(math.floor((high - x_first) / step - 0.5), cells - 1)
        for x in range(first, last + 1):
            flags[y, x] = True


@exact_kernel(allocates=False)
def spread_corners(corners, apart, out):
    """Write the corners that are farther than ``apart`` from the last one written, and from the first.

    Returns how many.
    """
    count = 0
    for i in range(corners.shape[0]):
        x, y = corners[i, 0], corners[i, 1]
        near = False
        for k in (count - 1, 0):
            if 0 <= k < count and abs(x - out[k, 0]) <= apart and abs(y - out[k, 1]) <= apart:
                near = True
        if not near:
            out[count, 0], out[count, 1] = x, y
            count += 1
    return count


@exact_kernel(allocates=False)
def convex_hull(points, order, out):
    """Write the convex hull of points, counter-clockwise; Andrew's monotone chain. Returns how many corners.

    Parameters
    ----------
    points : (N, 2) float
    order : (N,) int64
        By x, then y.
    out : (2 N, 2) float
        Written.
    """
    count = 0
    for side in range(2):
        base = count
        for i in range(order.size):
            k = order[i] if side == 0 else order[order.size - 1 - i]
            x, y = points[k, 0], points[k, 1]
            while count >= base + 2:
                ax, ay = out[count - 2, 0], out[count - 2, 1]
                bx, by = out[count - 1, 0], out[count - 1, 1]
                # Corners that are almost in line stay: leaving them out would cut a sliver off.
                if (bx - ax) * (y - ay) - (by - ay) * (x - ax) < 0.0:
                    count -= 1
                else:
                    break
            if count == base or x != out[count - 1, 0] or y != out[count - 1, 1]:
                out[count, 0], out[count, 1] = x, y
                count += 1
        count -= 1  # the last one begins the other chain
    return max(count, 1)
