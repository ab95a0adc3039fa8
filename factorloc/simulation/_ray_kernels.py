"""Kernels that send rays through a plan of segments sorted into the cells of a uniform grid.

Each segment carries the optical depth of crossing it (infinite for a wall, ``-log(1 - p)`` for glass that reflects with
probability p, 0 for the edge of a semi-transparent region) and the decay rate that begins on its left-hand side. A ray
ends where its optical depth reaches its own draw from the unit exponential distribution: one draw samples foliage and
glass alike, because the exponential law has no memory.

Arithmetic is strict: two walls that share a corner must find it on the same side of a ray to the last bit, or rays
would leak between them. A march goes from cell to cell (Amanatides and Woo, "A fast voxel traversal algorithm", 1987).
"""

import math

import numpy as np

from factorloc._jit import exact_kernel

NOTHING, WALL, GLASS, FOLIAGE = 0, 1, 2, 3


@exact_kernel
def _touches(segment, x, y, half):
    """Whether a segment meets the square of half width ``half`` around (x, y), by separating axes."""
    ax, ay, bx, by = segment[0] - x, segment[1] - y, segment[2] - x, segment[3] - y
    if min(ax, bx) > half or max(ax, bx) < -half or min(ay, by) > half or max(ay, by) < -half:
        return False
    return abs(ax * by - ay * bx) <= half * (abs(bx - ax) + abs(by - ay))


@exact_kernel
def sort_into_cells(segments, corner, cell, shape):
    """List the segments of each cell of a grid.

    Parameters
    ----------
    segments : (S, 4) float64
        End points [x_a, y_a, x_b, y_b], m.
    corner : (2,) float64
        Lowest corner of the grid, m.
    cell : float
        Width of a cell, m.
    shape : (int, int)
        Columns and rows.

    Returns
    -------
    starts : (cells + 1,) int64
        Cell ``c = row * columns + column`` holds ``members[starts[c]:starts[c + 1]]``.
    members : (K,) int64
        Indices of segments.
    """
    columns, rows = shape
    # Wider than the cell by more than rounding can move a crossing, so that none falls between two cells.
    half = (0.5 + 1e-7) * cell
    starts = np.zeros(columns * rows + 1, np.int64)
    place = np.empty(columns * rows, np.int64)  # where the next member of each cell goes
    members = np.empty(0, np.int64)
    for filling in (False, True):
        if filling:
            for c in range(columns * rows):
                starts[c + 1] += starts[c]
                place[c] = starts[c]
            members = np.empty(starts[columns * rows], np.int64)
        for s in range(len(segments)):
            ax, ay, bx, by = segments[s]
            low_x = max(0, int((min(ax, bx) - corner[0]) / cell) - 1)
            low_y = max(0, int((min(ay, by) - corner[1]) / cell) - 1)
            high_x = min(columns, int((max(ax, bx) - corner[0]) / cell) + 2)
            high_y = min(rows, int((max(ay, by) - corner[1]) / cell) + 2)
            for j in range(low_y, high_y):
                for i in range(low_x, high_x):
                    if _touches(segments[s], corner[0] + (i + 0.5) * cell, corner[1] + (j + 0.5) * cell, half):
                        c = j * columns + i
                        if filling:
                            members[place[c]] = s
                            place[c] += 1
                        else:
                            starts[c + 1] += 1
    return starts, members


@exact_kernel
def rates_at(points, edges, rates):
    """Decay rate at points (N, 2) among region edges (F, 4) whose regions of ``rates`` (F,) lie on their left."""
    result = np.zeros(len(points))
    for n in range(len(points)):
        x, y = points[n]
        for k in range(len(edges)):
            ax, ay, bx, by = edges[k]
            if (ay > y) == (by > y):
                continue
            left = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
            # An upward edge to the right of the point winds around it once, a downward one unwinds it.
            if by > ay and left > 0:
                result[n] += rates[k]
            elif by < ay and left < 0:
                result[n] -= rates[k]
    return result


@exact_kernel
def _enter(origin, direction, low, high, first, last):
    """Clip the stretch (first, last) of a ray to where one of its coordinates lies between low and high."""
    if direction == 0:
        return (first, last) if low <= origin < high else (math.inf, last)
    a, b = (low - origin) / direction, (high - origin) / direction
    return max(first, min(a, b)), min(last, max(a, b))


@exact_kernel
def _march(ox, oy, dx, dy, rate, depth, corner, cell, shape, starts, segments, depths, rates):
    """Range and surface of one ray; infinity where nothing stops it."""
    columns, rows = shape
    t, end = _enter(ox, dx, corner[0], corner[0] + columns * cell, 0.0, math.inf)
    t, end = _enter(oy, dy, corner[1], corner[1] + rows * cell, t, end)
    if t >= end:
        return math.inf, NOTHING
    i = min(max(int((ox + t * dx - corner[0]) / cell), 0), columns - 1)
    j = min(max(int((oy + t * dy - corner[1]) / cell), 0), rows - 1)
    step_i, step_j = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    face_i, face_j = (1 if dx > 0 else 0), (1 if dy > 0 else 0)
    inverse_x, inverse_y = (1 / dx if dx != 0 else math.inf), (1 / dy if dy != 0 else math.inf)
    behind = 0.0  # up to here the optical depth is spent
    while True:
        next_i = (corner[0] + (i + face_i) * cell - ox) * inverse_x if dx != 0 else math.inf
        next_j = (corner[1] + (j + face_j) * cell - oy) * inverse_y if dy != 0 else math.inf
        leave = min(next_i, next_j)
        c = j * columns + i
        previous = -1
        while True:  # the crossings in this cell, from near to far
            near, nearest = leave, -1
            for k in range(starts[c], starts[c + 1]):
                ax, ay = segments[k, 0] - ox, segments[k, 1] - oy
                bx, by = segments[k, 2] - ox, segments[k, 3] - oy
                side_a, side_b = dx * ay - dy * ax, dx * by - dy * bx
                if (side_a >= 0) == (side_b >= 0):
                    continue
                u = side_a / (side_a - side_b)
                at = dx * (ax + u * (bx - ax)) + dy * (ay + u * (by - ay))
                if at < near and (at > t or (at == t and k > previous)):
                    near, nearest, entering = at, k, side_a >= 0
            if nearest < 0:
                break
            if rate > 0:
                if depth <= rate * (near - behind):
                    return behind + depth / rate, FOLIAGE
                depth -= rate * (near - behind)
            if depth <= depths[nearest]:
                return near, WALL if depths[nearest] == math.inf else GLASS
            depth -= depths[nearest]
            rate += rates[nearest] if entering else -rates[nearest]
            t, behind, previous = near, near, nearest
        t = leave
        if next_i < next_j:
            i += step_i
        else:
            j += step_j
        if not (0 <= i < columns and 0 <= j < rows):
            return math.inf, NOTHING


@exact_kernel
def cast_rays(origins, directions, rates_at_origins, draws, corner, cell, shape, starts, segments, depths, rates):
    """Send rays through a grid of segments.

    Parameters
    ----------
    origins, directions : (N, 2) float64
        Start points (m) and unit vectors.
    rates_at_origins : (N,) float64
        Decay rates, 1/m.
    draws : (N,) float64
        Unit exponential draws; infinite to pass all but walls.
    corner, cell, shape, starts
        The grid, as of ``sort_into_cells``.
    segments, depths, rates : (K, 4), (K,), (K,) float64
        End points (m), optical depths and decay rates (1/m), in the order of the grid's members.

    Returns
    -------
    ranges : (N,) float64
        m; infinite where nothing reflects.
    surfaces : (N,) uint8
        What reflected.
    """
    ranges = np.empty(len(origins))
    surfaces = np.empty(len(origins), np.uint8)
    for n in range(len(origins)):
        ranges[n], surfaces[n] = _march(
            origins[n, 0], origins[n, 1], directions[n, 0], directions[n, 1], rates_at_origins[n], draws[n],
            corner, cell, shape, starts, segments, depths, rates,
        )  # fmt: skip
    return ranges, surfaces
