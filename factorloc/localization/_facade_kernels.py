"""Points against walls, sight of walls, and the weight of the correspondences that every cell of poses satisfies."""

import math

from factorloc._jit import exact_kernel, kernel
from factorloc.intervals._elementary_kernels import finite_product


@exact_kernel(allocates=False)
def meet_facades(xl, xh, yl, yh, centres, cl, ch, sl, sh, dl, dh, hull, out):
    """Which boxes may hold a point of which walls, written to ``out`` (K, N).

    A box may, if ``n(alpha) . (m - centre)`` meets ``d`` and the box meets ``hull[:, k]``, rows x low, x high, y low,
    y high. The sum errs by less than ``8u`` of its terms' magnitudes, which the margin covers.
    """
    for k in range(cl.size):
        u, v = centres[k, 0], centres[k, 1]
        x0, x1, y0, y1, low, high = hull[0, k], hull[1, k], hull[2, k], hull[3, k], dl[k], dh[k]
        c0, c1, s0, s1 = cl[k], ch[k], sl[k], sh[k]
        for i in range(xl.size):
            p, q = finite_product(xl[i] - u, xh[i] - u, c0, c1)
            r, s = finite_product(yl[i] - v, yh[i] - v, s0, s1)
            margin = 2.0**-48 * (abs(xl[i]) + abs(xh[i]) + abs(yl[i]) + abs(yh[i]) + abs(u) + abs(v)) + 2.0**-1020
            out[k, i] = (
                (p + r - margin <= high)
                & (q + s + margin >= low)
                & (xl[i] <= x1)
                & (xh[i] >= x0)
                & (yl[i] <= y1)
                & (yh[i] >= y0)
            )


@exact_kernel(allocates=False)
def cells_met(a, b, lo, hi, low, high, x_first, step, cells):
    """First and past-the-last cell of a row ``[low, high]`` that a strip ``a x + b y`` in ``[lo, hi]`` meets."""
    if not lo <= hi:
        return 0, 0
    p, q = b * low, b * high
    least, most = lo - (p if p > q else q), hi - (p if p < q else q)
    if abs(a) < 1e-9:
        # So flat a strip is followed across the row by its limits alone; they are widened by what it may rise.
        rise = 1e-9 * (abs(x_first) + step * cells)
        return (0, cells) if least - rise <= 0.0 <= most + rise else (0, 0)
    p, q = least / a, most / a
    least, most = (p, q) if p < q else (q, p)
    first, last = math.floor((least - x_first) / step), math.floor((most - x_first) / step) + 1.0
    first, last = min(max(first, 0.0), cells), min(max(last, 0.0), cells)
    return int(first), int(max(first, last))


@exact_kernel(allocates=False)
def weigh_satisfied(strips, across, boxes, pairs, groups, weights, x_first, y_first, step, first, last, changes, sums):
    """Add up for every cell of poses the weights of the facades of which its poses may satisfy a correspondence.

    Parameters
    ----------
    strips, across : (J, K, 4) float
        ``a, b, lo, hi`` of the strips of every slice of headings and every correspondence: along the wall's normal, and
        along the wall. Limits that cross: not satisfied.
    boxes : (J, P, 2, 4) float
        Two more strips of every pair of correspondences of one building.
    pairs : (P, 4) int64
        Those correspondences, and their facades; each is in one pair at most, and the only one of its facade.
    groups : (G + 1,) int64
        Where the correspondences of each facade begin, and K: any of them will do.
    weights : (G,) int32
        Of the facades.
    x_first, y_first, step : float
        Corner and edge of the cells, m.
    first, last : (K,) int64
        To work in.
    changes : (X + 1,) int32
        To work in.
    sums : (J, Y, X) int32
        Written. Of a pair both of whose correspondences, but not whose strips are satisfied, the lighter one is left.
    """
    slices, rows, cells = sums.shape
    for j in range(slices):
        for y in range(rows):
            low = y_first + step * y
            high = low + step
            changes[:] = 0
            for k in range(strips.shape[1]):
                a, b, lo, hi = strips[j, k, 0], strips[j, k, 1], strips[j, k, 2], strips[j, k, 3]
                begin, end = cells_met(a, b, lo, hi, low, high, x_first, step, cells)
                a, b, lo, hi = across[j, k, 0], across[j, k, 1], across[j, k, 2], across[j, k, 3]
                other, stop = cells_met(a, b, lo, hi, low, high, x_first, step, cells)
                first[k], last[k] = max(begin, other), min(end, stop)
            for g in range(groups.size - 1):
                # The union of a few ranges: again and again the first one that reaches beyond what is covered.
                covered = 0
                while True:
                    begin, end = cells, cells
                    for k in range(groups[g], groups[g + 1]):
                        if first[k] < last[k] and last[k] > covered and max(first[k], covered) < begin:
                            begin, end = max(first[k], covered), last[k]
                    if begin >= cells:
                        break
                    changes[begin] += weights[g]
                    changes[end] -= weights[g]
                    covered = end
            for p in range(pairs.shape[0]):
                begin, end = max(first[pairs[p, 0]], first[pairs[p, 1]]), min(last[pairs[p, 0]], last[pairs[p, 1]])
                if begin >= end:
                    continue
                lighter = min(weights[pairs[p, 2]], weights[pairs[p, 3]])
                changes[begin] -= lighter
                changes[end] += lighter
                for side in range(2):
                    a, b, lo, hi = (
                        boxes[j, p, side, 0],
                        boxes[j, p, side, 1],
                        boxes[j, p, side, 2],
                        boxes[j, p, side, 3],
                    )
                    other, stop = cells_met(a, b, lo, hi, low, high, x_first, step, cells)
                    begin, end = max(begin, other), min(end, stop)
                if begin < end:
                    changes[begin] += lighter
                    changes[end] -= lighter
            running = 0
            for x in range(cells):
                running += changes[x]
                sums[j, y, x] = running


@kernel(allocates=False)
def see(segments, candidates, blockers, observers, samples, off, out):
    """How many samples of a wall, shifted off it to its outer side, are seen from how many observers.

    Parameters
    ----------
    segments : (F, 2, 2) float
        Walls, their building on the left.
    candidates, blockers : (C,), (B,) int64
        Walls asked for, and those in the way.
    observers : (O, 2) float
        m.
    samples : int
        Points of each wall.
    off : float
        Shift, m.
    out : (C,) float
        Written: share of all ways between samples and observers that are free.
    """
    for k in range(candidates.size):
        f = candidates[k]
        ax, ay = segments[f, 0, 0], segments[f, 0, 1]
        dx, dy = segments[f, 1, 0] - ax, segments[f, 1, 1] - ay
        length = math.hypot(dx, dy)
        nx, ny = dy / length, -dx / length
        free = 0
        for o in range(observers.shape[0]):
            ox, oy = observers[o, 0], observers[o, 1]
            if nx * (ox - ax) + ny * (oy - ay) <= 0.0:
                continue
            for s in range(samples):
                u = (s + 0.5) / samples
                rx, ry = ax + u * dx + nx * off - ox, ay + u * dy + ny * off - oy
                hidden = False
                for e in range(blockers.size):
                    g = blockers[e]
                    bx, by = segments[g, 0, 0] - ox, segments[g, 0, 1] - oy
                    ex, ey = segments[g, 1, 0] - segments[g, 0, 0], segments[g, 1, 1] - segments[g, 0, 1]
                    den = rx * ey - ry * ex
                    if den == 0.0:
                        continue
                    t, w = (bx * ey - by * ex) / den, (bx * ry - by * rx) / den
                    if 0.0 < t < 0.999 and 0.0 < w < 1.0:
                        hidden = True
                        break
                if not hidden:
                    free += 1
        out[k] = free / (samples * observers.shape[0])


@exact_kernel(allocates=False)
def gather(lo, hi, mask, x, y, out):
    """Write the boxes of a mask, moved by ``(-x, -y)`` and rounded outwards, to ``out`` (4, N); returns how many."""
    count = 0
    for i in range(mask.size):
        if mask[i]:
            for axis in range(2):
                move = x if axis == 0 else y
                low, high = lo[axis, i] - move, hi[axis, i] - move
                out[2 * axis, count] = low - (abs(low) * 2.0**-52 + 2.0**-1022)
                out[2 * axis + 1, count] = high + (abs(high) * 2.0**-52 + 2.0**-1022)
            count += 1
    return count
