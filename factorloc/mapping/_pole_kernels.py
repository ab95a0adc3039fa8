"""From counts of a window to poles: occupancy, scores of boxes, stacks, modes and widths (thesis, 12.4.1).

Arrays of counts have a rim of one cell and lie slice by slice, ``(z + 1, x + 1, y + 1)``; all others are ``(z, x, y)``
or ``(x, y)`` without rim. A box of width ``a`` has its lowest corner in cell ``(x, y)`` and covers ``a x a`` cells; its
hull are the cells around it, ``f`` of them on each side.
"""

import math

import numpy as np

from factorloc._jit import exact_kernel


@exact_kernel(allocates=False)
def reflection_moments(hits, misses):
    """Sums over all visited cells of 1, of H / (H + M) and of its square (flat counts)."""
    count = 0
    first = 0.0
    second = 0.0
    for k in range(hits.shape[0]):
        if hits[k] > 0:
            mu = hits[k] / (np.float64(hits[k]) + misses[k])
            count += 1
            first += mu
            second += mu * mu
        elif misses[k] > 0:
            count += 1
    return count, first, second


@exact_kernel(allocates=False)
def fill_tail_table(seed, first_term, alpha, beta, threshold, table):
    """Probability of Beta(H + alpha, M + beta) above a threshold, for all small counts, from that of no counts.

    With ``I`` the probability *below* x, and ``t(a, b) = x^a (1 - x)^b / B(a, b)`` (DLMF 8.17.20, 8.17.21)::

        I(a + 1, b) = I(a, b) - t(a, b) / a          I(a, b + 1) = I(a, b) + t(a, b) / b
        t(a + 1, b) = t(a, b) x (a + b) / a          t(a, b + 1) = t(a, b) (1 - x) (a + b) / b

    ``seed`` and ``first_term`` are the probability above and ``t`` at (alpha, beta); ``table`` (H, M) is written.
    """
    row, row_term = seed, first_term
    for h in range(table.shape[0]):
        a = alpha + h
        value, term = row, row_term
        for m in range(table.shape[1]):
            b = beta + m
            table[h, m] = min(max(value, 0.0), 1.0)
            value -= term / b
            term *= (1.0 - threshold) * (a + b) / b
        row += row_term / a
        row_term *= threshold * (a + beta) / a


@exact_kernel(allocates=False)
def look_up(hits, misses, table, first, last, out):
    """Write what a table says of the counts of slices ``first:last``; negative where it ends.

    Parameters
    ----------
    hits, misses : (n_z + 2, n_x + 2, n_y + 2) uint32
    table : (H, M) float64
    out : (n_z, n_x, n_y) float32
    """
    for z in range(first, last):
        for x in range(out.shape[1]):
            for y in range(out.shape[2]):
                h = hits[z + 1, x + 1, y + 1]
                m = misses[z + 1, x + 1, y + 1]
                if h < table.shape[0] and m < table.shape[1]:
                    out[z, x, y] = table[h, m]
                else:
                    out[z, x, y] = -1.0


@exact_kernel(allocates=False)
def integrate(values, sums):
    """Integral image: ``sums[x, y]`` (n_x + 1, n_y + 1) is the sum of all values before column x and row y."""
    for y in range(sums.shape[1]):
        sums[0, y] = 0.0
    for x in range(values.shape[0]):
        row = 0.0
        sums[x + 1, 0] = 0.0
        for y in range(values.shape[1]):
            row += values[x, y]
            sums[x + 1, y + 1] = sums[x, y + 1] + row


@exact_kernel(allocates=False)
def box_score(occupancy, sums, x, y, a, f, least):
    """Mean of a box less the greatest value of its hull; ``least`` or less as soon as it cannot be more."""
    mean = (sums[x + a, y + a] - sums[x, y + a] - sums[x + a, y] + sums[x, y]) / (a * a)
    highest = 0.0
    most = mean - least
    if most <= 0.0:
        return least
    for i in range(x - f, x + a + f):
        inside = x <= i < x + a
        for j in range(y - f, y + a + f):
            if inside and y <= j < y + a:
                continue
            if occupancy[i, j] > highest:
                highest = occupancy[i, j]
                if highest >= most:
                    return least
    return mean - highest


@exact_kernel(allocates=False)
def score_slice(occupancy, widths, f, least, sums, scores):
    """Greatest score of all boxes that cover each cell of a slice, over all widths.

    Only boxes above ``least`` count: what is below is never part of a stack.

    Parameters
    ----------
    occupancy : (n_x, n_y) float32
    widths : (W,) int64
        Cells, increasing.
    f : int
        Thickness of the hull, cells.
    least : float
        Score that boxes surpass.
    sums : (n_x + 1, n_y + 1) float64
        Work array.
    scores : (n_x, n_y) float32
        Written; -1 where no box surpasses it.
    """
    n_x, n_y = occupancy.shape
    integrate(occupancy, sums)
    for x in range(n_x):
        for y in range(n_y):
            scores[x, y] = -1.0
    for w in range(widths.shape[0]):
        a = widths[w]
        enough = least * a * a
        for x in range(f, n_x - a - f + 1):
            # A strip with too little in it has no box with enough.
            if sums[x + a, n_y] - sums[x, n_y] <= enough:
                continue
            for y in range(f, n_y - a - f + 1):
                if sums[x + a, y + a] - sums[x, y + a] - sums[x + a, y] + sums[x, y] <= enough:
                    continue
                score = box_score(occupancy, sums, x, y, a, f, least)
                if score > least:
                    for i in range(x, x + a):
                        for j in range(y, y + a):
                            if score > scores[i, j]:
                                scores[i, j] = score


@exact_kernel(allocates=False)
def stack_columns(scores, least, height, running, totals, stacked, bottoms, tops):
    """Find the highest run of cells above ``least`` of every column (the lower of two as high).

    Parameters
    ----------
    scores : (n_z, n_x, n_y) float32
    least : float
        What the cells of a run surpass.
    height : int
        Cells of the lowest run that counts.
    running : (n_x, n_y) int64
        Work array: length of the run that ends at the present slice.
    totals : (n_x, n_y) float64
        Work array: sum of its scores.
    stacked : (n_x, n_y) float64
        Written: mean score of the run; 0 without.
    bottoms, tops : (n_x, n_y) int64
        Written: first cell, and the one after the last; 0 without.
    """
    n_z, n_x, n_y = scores.shape
    for x in range(n_x):
        for y in range(n_y):
            running[x, y] = 0
            totals[x, y] = 0.0
            stacked[x, y] = 0.0
            bottoms[x, y] = 0
            tops[x, y] = 0
    # Slice by slice, as they lie in memory.
    for z in range(n_z):
        for x in range(n_x):
            for y in range(n_y):
                score = scores[z, x, y]
                if score > least:
                    run = running[x, y] + 1
                    totals[x, y] += score
                    running[x, y] = run
                    if run >= height and run > tops[x, y] - bottoms[x, y]:
                        bottoms[x, y] = z + 1 - run
                        tops[x, y] = z + 1
                        stacked[x, y] = totals[x, y] / run
                elif running[x, y] > 0:
                    running[x, y] = 0
                    totals[x, y] = 0.0


@exact_kernel(allocates=False)
def find_seeds(stacked, seeds):
    """Write the cells of a score map that no neighbour surpasses to ``seeds`` (S, 2); returns how many there are."""
    n_x, n_y = stacked.shape
    count = 0
    for x in range(n_x):
        for y in range(n_y):
            here = stacked[x, y]
            if here <= 0.0:
                continue
            highest = True
            for i in range(max(x - 1, 0), min(x + 2, n_x)):
                for j in range(max(y - 1, 0), min(y + 2, n_y)):
                    if stacked[i, j] > here:
                        highest = False
            if highest:
                if count < seeds.shape[0]:
                    seeds[count, 0] = x
                    seeds[count, 1] = y
                count += 1
    return count


@exact_kernel(allocates=False)
def shift_to_modes(stacked, bandwidth, reach, modes):
    """Mean shift of points to the modes of a score map, with a Gaussian kernel cut off in a window.

    Parameters
    ----------
    stacked : (n_x, n_y) float64
        Weights of the cells, which lie at whole numbers.
    bandwidth : float
        Standard deviation of the kernel, cells.
    reach : int
        Half the width of the window, cells.
    modes : (S, 2) float64
        Points, cells; moved.
    """
    n_x, n_y = stacked.shape
    scale = -0.5 / (bandwidth * bandwidth)
    for k in range(modes.shape[0]):
        for _ in range(200):
            p_x = modes[k, 0]
            p_y = modes[k, 1]
            total = 0.0
            sum_x = 0.0
            sum_y = 0.0
            c_x = math.floor(p_x + 0.5)
            c_y = math.floor(p_y + 0.5)
            for i in range(max(c_x - reach, 0), min(c_x + reach + 1, n_x)):
                for j in range(max(c_y - reach, 0), min(c_y + reach + 1, n_y)):
                    if stacked[i, j] > 0.0:
                        weight = stacked[i, j] * math.exp(scale * ((i - p_x) ** 2 + (j - p_y) ** 2))
                        total += weight
                        sum_x += weight * i
                        sum_y += weight * j
            modes[k, 0] = sum_x / total
            modes[k, 1] = sum_y / total
            if (modes[k, 0] - p_x) ** 2 + (modes[k, 1] - p_y) ** 2 < 1e-8:
                break


@exact_kernel(allocates=False)
def width_weights(occupancy, cells, bottoms, tops, widths, f, sums, weights):
    """Mean over the cells of columns of the best box of each width that covers them; at least 0.

    Parameters
    ----------
    occupancy : (n_z, n_x, n_y) float32
    cells : (P, 2) int64
        Columns.
    bottoms, tops : (P,) int64
        Their cells along z.
    widths : (W,) int64
        Cells.
    f : int
        Thickness of the hull, cells.
    sums : (n_x + 1, n_y + 1) float64
        Work array.
    weights : (P, W) float64
        Written.
    """
    n_z, n_x, n_y = occupancy.shape
    for p in range(cells.shape[0]):
        for w in range(widths.shape[0]):
            weights[p, w] = 0.0
    for z in range(n_z):
        ready = False
        for p in range(cells.shape[0]):
            if z < bottoms[p] or z >= tops[p]:
                continue
            if not ready:
                integrate(occupancy[z], sums)
                ready = True
            for w in range(widths.shape[0]):
                a = widths[w]
                best = 0.0
                for x in range(max(cells[p, 0] - a + 1, f), min(cells[p, 0], n_x - a - f) + 1):
                    for y in range(max(cells[p, 1] - a + 1, f), min(cells[p, 1], n_y - a - f) + 1):
                        best = max(best, box_score(occupancy[z], sums, x, y, a, f, best))
                weights[p, w] += best / (tops[p] - bottoms[p])
