"""Kernels of visibility: shadows of edges on walls, and walls surely behind convex cores."""

from __future__ import annotations

import math

import numpy as np

from factorloc._jit import exact_kernel

_NEAR = 1e-9  # m; what is nearer than that to the eye, or to the wall, throws no shadow


@exact_kernel
def visible_shares(eye_x, eye_y, walls, edges, out):
    """Share of each wall that is seen from a point.

    Parameters
    ----------
    eye_x, eye_y : float64
        The point.
    walls : float64 (F, 4)
        Starts and ends, the building on the left.
    edges : float64 (E, 4)
        What hides; walls themselves included.
    out : float64 (F,)
        Shares to write.
    """
    low, high = np.empty(len(edges)), np.empty(len(edges))
    for f in range(len(walls)):
        ax, ay = walls[f, 0] - eye_x, walls[f, 1] - eye_y
        ex, ey = walls[f, 2] - walls[f, 0], walls[f, 3] - walls[f, 1]
        length = math.hypot(ex, ey)
        ux, uy = ex / length, ey / length
        # Away from the eye, into the building: the wall is seen from its right.
        depth = -uy * ax + ux * ay
        out[f] = 0.0
        if depth <= _NEAR:
            continue
        begin = ux * ax + uy * ay
        count = 0
        for e in range(len(edges)):
            px, py = edges[e, 0] - eye_x, edges[e, 1] - eye_y
            qx, qy = edges[e, 2] - eye_x, edges[e, 3] - eye_y
            pz, qz = -uy * px + ux * py, -uy * qx + ux * qy
            ps, qs = ux * px + uy * py, ux * qx + uy * qy
            if pz > qz:
                pz, qz, ps, qs = qz, pz, qs, ps
            if qz <= _NEAR or pz >= depth - _NEAR:
                continue
            if pz < _NEAR:  # the part behind the eye throws no shadow
                ps += (qs - ps) * (_NEAR - pz) / (qz - pz)
                pz = _NEAR
            if qz > depth:
                qs = ps + (qs - ps) * (depth - pz) / (qz - pz)
                qz = depth
            one, other = (ps * depth / pz - begin) / length, (qs * depth / qz - begin) / length
            left, right = max(min(one, other), 0.0), min(max(one, other), 1.0)
            if left < right:
                low[count], high[count] = left, right
                count += 1
        order = np.argsort(low[:count])
        seen, reached = 0.0, 0.0
        for k in order:
            seen += max(low[k] - reached, 0.0)
            reached = max(reached, high[k])
        out[f] = seen + max(1.0 - reached, 0.0)


@exact_kernel
def _crosses(px, py, qx, qy, corners, first, last):
    """Whether a way meets a convex polygon, corners counter-clockwise."""
    enter, leave = 0.0, 1.0
    for k in range(first, last):
        n = k + 1 if k + 1 < last else first
        ex, ey = corners[n, 0] - corners[k, 0], corners[n, 1] - corners[k, 1]
        start = ex * (py - corners[k, 1]) - ey * (px - corners[k, 0])  # positive inside
        change = ex * (qy - py) - ey * (qx - px)
        if change > 0.0:
            enter = max(enter, -start / change)
        elif change < 0.0:
            leave = min(leave, -start / change)
        elif start < 0.0:
            return False
        if enter > leave:
            return False
    return True


@exact_kernel
def _hides(cell, piece, corners, first, last):
    """Whether every way from a convex cell to a convex piece meets a convex polygon: those between corners do."""
    for c in range(len(cell)):
        for p in range(len(piece)):
            if not _crosses(cell[c, 0], cell[c, 1], piece[p, 0], piece[p, 1], corners, first, last):
                return False
    return True


@exact_kernel
def surely_hidden(cells, pieces, owners, corners, firsts, used, out):
    """Which walls are hidden from all of a region.

    Parameters
    ----------
    cells : float64 (C, 4, 2)
        Corners of the cells that make up the region.
    pieces : float64 (P, K, 2)
        Points whose convex hulls hold all a piece of a wall can be.
    owners : int64 (P,)
        Wall of each piece, in ascending order.
    corners : float64 (M, 2)
        Corners of convex cores, counter-clockwise.
    firsts : int64 (N + 1,)
        First corner of each core.
    used : int64 (U,)
        Cores to ask.
    out : bool (F,)
        True at first; false where a piece is not hidden from a cell by a single core.
    """
    for p in range(len(pieces)):
        if not out[owners[p]]:
            continue
        guess = 0
        for c in range(len(cells)):
            hidden = False
            for k in range(len(used)):
                place = (guess + k) % len(used)  # what hid it from the last cell often does again
                core = used[place]
                if _hides(cells[c], pieces[p], corners, firsts[core], firsts[core + 1]):
                    hidden, guess = True, place
                    break
            if not hidden:
                out[owners[p]] = False
                break
