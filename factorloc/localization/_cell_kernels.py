"""Convex polygons and cells: which cells a polygon meets, and the convex hull of cells."""

from factorloc._jit import exact_kernel


@exact_kernel(allocates=False)
def mark_polygon(corners, x_first, y_first, step, slack, flags):
    """Set the cells, (Y, X), that a convex polygon (counter-clockwise) may meet."""
    rows, cells = flags.shape
    half = 0.5 * step + slack
    for y in range(rows):
        v = y_first + step * (y + 0.5)
        for x in range(cells):
            if flags[y, x]:
                continue
            u = x_first + step * (x + 0.5)
            inside = True
            for k in range(corners.shape[0]):
                x0, y0 = corners[k, 0], corners[k, 1]
                x1, y1 = corners[(k + 1) % corners.shape[0], 0], corners[(k + 1) % corners.shape[0], 1]
                a, b = y1 - y0, x0 - x1
                if a * (u - x0) + b * (v - y0) > half * (abs(a) + abs(b)) + slack:
                    inside = False
                    break
            flags[y, x] = inside


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
