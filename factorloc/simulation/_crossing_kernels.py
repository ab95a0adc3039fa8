"""Kernels that count how rays cross closed meshes, and measure how far points are from meshes.

Crossings of a closed mesh balance to the last bit (see ``_mesh_kernels``), so that the regions around the origin of a
ray are those it leaves more often than it enters them.
"""

import math

import numpy as np

from factorloc._jit import exact_kernel
from factorloc.simulation._forest_kernels import DEPTH
from factorloc.simulation._mesh_kernels import (
    crossing_distance,
    crossing_side,
    entry,
    inverse,
    main_axis,
    vertex,
)


@exact_kernel
def _gather(origin, direction, root, triangles, order, boxes, links, stack, at, which):
    """List the crossings of a ray with one tree, unsorted, as 1 + index signed by side; -1 if there is no room."""
    ix, iy, iz = inverse(direction[0]), inverse(direction[1]), inverse(direction[2])
    axis = main_axis(direction[0], direction[1], direction[2])
    found = 0
    stack[0] = root
    height = 1
    while height > 0:
        height -= 1
        node = stack[height]
        if entry(boxes, node, origin[0], origin[1], origin[2], ix, iy, iz, math.inf) == math.inf:
            continue
        left, end = links[node, 0], links[node, 1]
        if end < 0:
            stack[height], stack[height + 1] = left, left + 1
            height += 2
            continue
        for m in range(left, end):
            side = crossing_side(triangles, order[m], origin, direction, axis)
            if side == 0:
                continue
            reach = crossing_distance(triangles, order[m], origin, direction)
            if reach < 0:
                continue
            if found == len(at):
                return -1
            at[found], which[found] = reach, side * (order[m] + 1)
            found += 1
    return found


@exact_kernel
def free_paths(origins, directions, draws, triangles, rates, order, root, boxes, links):
    """Where the optical depth of rays through semi-transparent regions reaches their draws.

    Parameters
    ----------
    origins, directions : (N, 3) float64
        Start points (m) and unit vectors.
    draws : (N,) float64
        Unit exponential draws.
    triangles, rates : (T, 3, 3), (T,) float64
        Boundaries of closed regions, seen counter-clockwise from outside (m), and the decay rate behind each (1/m).
    order, root, boxes, links
        Their tree, as of ``build_forest``.

    Returns
    -------
    (N,) float64
        Free path, m; infinite for a ray that passes all regions.
    """
    paths = np.empty(len(origins))
    stack = np.empty(2 * DEPTH, np.int64)
    at, which = np.empty(64), np.empty(64, np.int64)
    for n in range(len(origins)):
        paths[n] = math.inf
        found = -1
        while found < 0:
            found = _gather(origins[n], directions[n], root, triangles, order, boxes, links, stack, at, which)
            if found < 0:
                at, which = np.empty(2 * len(at)), np.empty(2 * len(at), np.int64)
        rate = 0.0  # at the origin: of the regions that the ray leaves more often than it enters them
        for m in range(found):
            rate += rates[abs(which[m]) - 1] * (1 if which[m] > 0 else -1)
            k = m
            while k > 0 and at[k - 1] > at[k]:
                at[k - 1], at[k] = at[k], at[k - 1]
                which[k - 1], which[k] = which[k], which[k - 1]
                k -= 1
        depth, behind = draws[n], 0.0
        for m in range(found):
            spent = max(rate, 0.0) * (at[m] - behind)
            if rate > 0 and depth <= spent:
                paths[n] = behind + depth / rate
                break
            depth -= spent
            behind = at[m]
            rate -= rates[abs(which[m]) - 1] * (1 if which[m] > 0 else -1)
    return paths


@exact_kernel
def _square_to_edge(ax, ay, az, bx, by, bz):
    """Square of the distance of the origin to the line segment from a to b."""
    ex, ey, ez = bx - ax, by - ay, bz - az
    square = ex * ex + ey * ey + ez * ez
    u = min(max(-(ax * ex + ay * ey + az * ez) / square, 0.0), 1.0) if square > 0 else 0.0
    x, y, z = ax + u * ex, ay + u * ey, az + u * ez
    return x * x + y * y + z * z


@exact_kernel
def _square_distance(triangles, t, x, y, z):
    """Square of the distance of a point to triangle t (Ericson, Real-Time Collision Detection, section 5.1.5)."""
    ax, ay, az = vertex(triangles, t, 0, x, y, z)
    bx, by, bz = vertex(triangles, t, 1, x, y, z)
    cx, cy, cz = vertex(triangles, t, 2, x, y, z)
    ux, uy, uz, vx, vy, vz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
    uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
    au, av = -(ax * ux + ay * uy + az * uz), -(ax * vx + ay * vy + az * vz)
    area = uu * vv - uv * uv
    p, q = vv * au - uv * av, uu * av - uv * au
    if area > 0 and p >= 0 and q >= 0 and p + q <= area:
        p, q = p / area, q / area
        dx, dy, dz = ax + p * ux + q * vx, ay + p * uy + q * vy, az + p * uz + q * vz
        return dx * dx + dy * dy + dz * dz
    # Outside the prism over the triangle, one of its edges is nearest.
    nearest = min(_square_to_edge(ax, ay, az, bx, by, bz), _square_to_edge(bx, by, bz, cx, cy, cz))
    return min(nearest, _square_to_edge(cx, cy, cz, ax, ay, az))


@exact_kernel
def _square_gap(boxes, n, x, y, z):
    """Square of the distance of a point to box n; 0 inside."""
    dx, dy = max(boxes[n, 0] - x, x - boxes[n, 3], 0.0), max(boxes[n, 1] - y, y - boxes[n, 4], 0.0)
    dz = max(boxes[n, 2] - z, z - boxes[n, 5], 0.0)
    return dx * dx + dy * dy + dz * dz


@exact_kernel
def clearances(points, times, velocities, closed, triangles, order, roots, boxes, links):
    """Distances from points to the nearest triangle of a forest.

    Parameters
    ----------
    points, times : (N, 3), (N,) float64
        m and s.
    velocities : (G, 3) float64
        Of the groups, m/s.
    closed : (G,) bool
        Groups of closed meshes; in these, the distance is 0.
    triangles, order, roots, boxes, links
        The forest, as of ``build_forest``.

    Returns
    -------
    (N,) float64
        m; infinite if the forest is empty.
    """
    result = np.empty(len(points))
    stack = np.empty(2 * DEPTH, np.int64)
    point, up = np.empty(3), np.array([0.0, 0.0, 1.0])
    at, which = np.empty(64), np.empty(64, np.int64)
    for n in range(len(points)):
        nearest = math.inf
        for g in range(len(roots)):
            if roots[g] < 0:
                continue
            for k in range(3):
                point[k] = points[n, k] - velocities[g, k] * times[n]
            if closed[g]:
                found = -1
                while found < 0:
                    found = _gather(point, up, roots[g], triangles, order, boxes, links, stack, at, which)
                    if found < 0:
                        at, which = np.empty(2 * len(at)), np.empty(2 * len(at), np.int64)
                if np.sign(which[:found]).sum() > 0:
                    nearest = 0.0
                    break
            stack[0] = roots[g]
            height = 1
            while height > 0:
                height -= 1
                node = stack[height]
                if _square_gap(boxes, node, point[0], point[1], point[2]) >= nearest:
                    continue
                left, end = links[node, 0], links[node, 1]
                if end >= 0:
                    for m in range(left, end):
                        square = _square_distance(triangles, order[m], point[0], point[1], point[2])
                        nearest = min(nearest, square)
                    continue
                a = _square_gap(boxes, left, point[0], point[1], point[2])
                b = _square_gap(boxes, left + 1, point[0], point[1], point[2])
                near, far = (left, left + 1) if a <= b else (left + 1, left)
                stack[height], stack[height + 1] = far, near
                height += 2
        result[n] = math.sqrt(nearest)
    return result
