"""Kernels that send rays through triangle meshes sorted into trees of boxes, in double precision.

A forest holds one binary tree of boxes for each group of triangles; a group moves as a whole. A ray is sheared onto its
main axis, so that it meets a triangle where the origin of a plane lies in its projection (Woop, Benthin and Wald,
"Watertight ray/triangle intersection", 2013). Whether it does is counted, not measured: each edge that crosses the
positive half of the first axis winds the triangle around the origin by one. The two triangles of an edge see it from
both ends with the same bits, so that a ray neither slips through the edges of a closed mesh nor enters it more often
than it leaves. Arithmetic is strict for that reason.
"""

import math

import numpy as np

from factorloc._jit import exact_kernel
from factorloc.simulation._forest_kernels import DEPTH

_HUGE = 1e300  # stands for the inverse of zero: times zero, it stays zero


@exact_kernel
def inverse(value):
    return 1 / value if abs(value) > 1 / _HUGE else math.copysign(_HUGE, value)


@exact_kernel
def entry(boxes, n, ox, oy, oz, ix, iy, iz, reach):
    """Distance at which a ray enters box n; infinity if it does not before its reach."""
    a, b = (boxes[n, 0] - ox) * ix, (boxes[n, 3] - ox) * ix
    near, far = min(a, b), max(a, b)
    a, b = (boxes[n, 1] - oy) * iy, (boxes[n, 4] - oy) * iy
    near, far = max(near, min(a, b)), min(far, max(a, b))
    a, b = (boxes[n, 2] - oz) * iz, (boxes[n, 5] - oz) * iz
    near, far = max(near, min(a, b), 0.0), min(far, max(a, b), reach)
    return near if near <= far else math.inf


@exact_kernel
def main_axis(dx, dy, dz):
    x, y, z = abs(dx), abs(dy), abs(dz)
    return 2 if z >= x and z >= y else (0 if x >= y else 1)


@exact_kernel
def _turn(px, py, qx, qy):
    """How often the edge from p to q winds around the origin: 1, 0 or -1; the same edge reversed unwinds it."""
    if (py >= 0) == (qy >= 0):
        return 0
    side = px * qy - py * qx
    if qy >= 0:
        return 1 if side > 0 else 0
    return -1 if side < 0 else 0


@exact_kernel
def _sheared(triangles, t, corner, origin, axis, sx, sy):
    """Vertex of triangle t in the plane across a line, from where the line pierces it."""
    k, m = (axis + 1) % 3, (axis + 2) % 3
    z = triangles[t, corner, axis] - origin[axis]
    return triangles[t, corner, k] - origin[k] - sx * z, triangles[t, corner, m] - origin[m] - sy * z


@exact_kernel
def crossing_side(triangles, t, origin, direction, axis):
    """How a line meets triangle t: 1 leaves it behind its outer side, -1 enters there, 0 passes by."""
    sx, sy = direction[(axis + 1) % 3] / direction[axis], direction[(axis + 2) % 3] / direction[axis]
    ax, ay = _sheared(triangles, t, 0, origin, axis, sx, sy)
    bx, by = _sheared(triangles, t, 1, origin, axis, sx, sy)
    cx, cy = _sheared(triangles, t, 2, origin, axis, sx, sy)
    winding = _turn(ax, ay, bx, by) + _turn(bx, by, cx, cy) + _turn(cx, cy, ax, ay)
    return winding if direction[axis] > 0 else -winding


@exact_kernel
def vertex(triangles, t, corner, x, y, z):
    """Vertex of triangle t as seen from a point."""
    return triangles[t, corner, 0] - x, triangles[t, corner, 1] - y, triangles[t, corner, 2] - z


@exact_kernel
def crossing_distance(triangles, t, origin, direction):
    """Distance along a line to the plane of triangle t, no nearer and no farther than its vertices."""
    dx, dy, dz = direction[0], direction[1], direction[2]
    ax, ay, az = vertex(triangles, t, 0, origin[0], origin[1], origin[2])
    bx, by, bz = vertex(triangles, t, 1, origin[0], origin[1], origin[2])
    cx, cy, cz = vertex(triangles, t, 2, origin[0], origin[1], origin[2])
    ux, uy, uz, vx, vy, vz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    a, b, c = ax * dx + ay * dy + az * dz, bx * dx + by * dy + bz * dz, cx * dx + cy * dy + cz * dz
    slope = nx * dx + ny * dy + nz * dz
    low, high = min(a, b, c), max(a, b, c)
    if slope == 0:
        return low
    return min(max((ax * nx + ay * ny + az * nz) / slope, low), high)


@exact_kernel
def plane_ranges(origins, directions, triangles, chosen):
    """Ranges (N,) of rays (N, 3) on the triangles (N,) chosen for them, m; infinite where that is -1."""
    ranges = np.empty(len(origins))
    for n in range(len(origins)):
        ranges[n] = math.inf
        if chosen[n] >= 0:
            ranges[n] = max(crossing_distance(triangles, chosen[n], origins[n], directions[n]), 0.0)
    return ranges


@exact_kernel
def first_hits(origins, directions, times, velocities, triangles, order, roots, boxes, links, ranges, chosen):
    """Shorten rays to the first triangle of a forest that they meet.

    Parameters
    ----------
    origins, directions : (N, 3) float64
        Start points (m) and unit vectors.
    times : (N,) float64
        s.
    velocities : (G, 3) float64
        Of the groups, m/s; triangles are where they were at time 0.
    triangles, order, roots, boxes, links
        The forest, as of ``build_forest``.
    ranges : (N,) float64
        Lengths of the rays, m; updated.
    chosen : (N,) int64
        Triangles that end them; updated where a ray becomes shorter.
    """
    stack = np.empty(DEPTH, np.int64)
    origin = np.empty(3)
    for n in range(len(origins)):
        direction = directions[n]
        ix, iy, iz = inverse(direction[0]), inverse(direction[1]), inverse(direction[2])
        axis = main_axis(direction[0], direction[1], direction[2])
        for g in range(len(roots)):
            for k in range(3):
                origin[k] = origins[n, k] - velocities[g, k] * times[n]
            height = 0
            if roots[g] >= 0:
                stack[0] = roots[g]
                height = 1
            while height > 0:
                height -= 1
                node = stack[height]
                if entry(boxes, node, origin[0], origin[1], origin[2], ix, iy, iz, ranges[n]) == math.inf:
                    continue
                left, end = links[node, 0], links[node, 1]
                if end >= 0:
                    for m in range(left, end):
                        t = order[m]
                        if crossing_side(triangles, t, origin, direction, axis) != 0:
                            at = crossing_distance(triangles, t, origin, direction)
                            if 0 <= at < ranges[n]:
                                ranges[n], chosen[n] = at, t
                    continue
                a = entry(boxes, left, origin[0], origin[1], origin[2], ix, iy, iz, ranges[n])
                b = entry(boxes, left + 1, origin[0], origin[1], origin[2], ix, iy, iz, ranges[n])
                near, far = (left, left + 1) if a <= b else (left + 1, left)
                if max(a, b) < math.inf:
                    stack[height] = far
                    height += 1
                if min(a, b) < math.inf:
                    stack[height] = near
                    height += 1
