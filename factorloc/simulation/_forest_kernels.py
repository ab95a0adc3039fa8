"""Kernels that sort groups of triangles into trees of boxes: a forest, one binary tree a group.

Branches are halved on the median of their longest axis, until a few triangles are left.
"""

import math

import numpy as np

from factorloc._jit import exact_kernel

DEPTH = 64
"""No tree is as deep: halving takes no more steps than an index has bits."""

_LEAF = 4  # triangles of a leaf, at most
_MARGIN = 1e-9  # m; boxes are wider than rounding can move an intersection


@exact_kernel
def _halve(order, first, end, centres, axis):
    """Put the lower half of a part of the order first, by quickselect; returns where the upper half begins."""
    middle = (first + end) // 2
    low, high = first, end - 1
    while low < high:
        pivot = centres[order[(low + high) // 2], axis]
        i, j = low, high
        while i <= j:
            while centres[order[i], axis] < pivot:
                i += 1
            while centres[order[j], axis] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i, j = i + 1, j - 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            break
    return middle


@exact_kernel
def build_forest(triangles, starts):
    """Sort the triangles of each group into a tree of boxes.

    Parameters
    ----------
    triangles : (T, 3, 3) float64
        Vertices, m.
    starts : (G + 1,) int64
        Group ``g`` owns the triangles ``starts[g]:starts[g + 1]``.

    Returns
    -------
    order : (T,) int64
        The triangles as leaves hold them, group after group.
    roots : (G,) int64
        First node of each tree; -1 for an empty group.
    boxes : (M, 6) float64
        Lowest and highest corner of each node, m.
    links : (M, 2) int64
        Of a branch, its first child and -1 (the second child follows the first); of a leaf, its range of ``order``.
    """
    count = len(triangles)
    order = np.arange(count)
    roots = np.full(len(starts) - 1, -1, np.int64)
    boxes = np.empty((2 * count + 1, 6))
    links = np.empty((2 * count + 1, 2), np.int64)
    centres = np.empty((count, 3))
    for n in range(count):
        for k in range(3):
            low = min(triangles[n, 0, k], triangles[n, 1, k], triangles[n, 2, k])
            centres[n, k] = (low + max(triangles[n, 0, k], triangles[n, 1, k], triangles[n, 2, k])) / 2
    used = 0
    stack = np.empty((2 * DEPTH, 3), np.int64)  # node, first and end of its part of the order
    for g in range(len(starts) - 1):
        if starts[g] == starts[g + 1]:
            continue
        roots[g] = used
        stack[0, 0], stack[0, 1], stack[0, 2] = used, starts[g], starts[g + 1]
        used += 1
        height = 1
        while height > 0:
            height -= 1
            node, first, end = stack[height, 0], stack[height, 1], stack[height, 2]
            axis, widest = 0, -1.0
            for k in range(3):
                low, high, near, far = math.inf, -math.inf, math.inf, -math.inf
                for m in range(first, end):
                    for corner in range(3):
                        low = min(low, triangles[order[m], corner, k])
                        high = max(high, triangles[order[m], corner, k])
                    near, far = min(near, centres[order[m], k]), max(far, centres[order[m], k])
                margin = _MARGIN + 1e-12 * max(abs(low), abs(high))
                boxes[node, k], boxes[node, 3 + k] = low - margin, high + margin
                if far - near > widest:
                    axis, widest = k, far - near
            if end - first <= _LEAF:
                links[node, 0], links[node, 1] = first, end
                continue
            middle = _halve(order, first, end, centres, axis)
            links[node, 0], links[node, 1] = used, -1
            stack[height, 0], stack[height, 1], stack[height, 2] = used, first, middle
            stack[height + 1, 0], stack[height + 1, 1], stack[height + 1, 2] = used + 1, middle, end
            used += 2
            height += 2
    return order, roots, boxes[:used].copy(), links[:used].copy()
