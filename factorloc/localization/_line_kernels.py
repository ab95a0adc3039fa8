"""Lines of a scan for many facades at once: votes, peak, and what of the facade its supporters cover."""

import math

import numpy as np

from factorloc._jit import exact_kernel
from factorloc.intervals._hough_kernels import find_peak, vote
from factorloc.intervals._sweep_kernels import sort_first
from factorloc.intervals._trigonometric_kernels import cosine_sine_arrays
from factorloc.localization._facade_kernels import gather

PEAK = 17
"""Numbers of a peak."""

EDGE = 1e-12  # rad and m a unit of magnitude; bins overlap by far more than rounding moves their edges


@exact_kernel
def extract_lines(
    points, lo, hi, mask, anchors, lengths, first_alpha, bins_alpha, step_alpha, first_d, bins_d, step_d, threshold,
    core_threshold, apart, least_votes, out,
):  # fmt: skip
    """Write the peak of every facade with enough points.

    Parameters
    ----------
    points : (N, 2) float
        As measured, in the frame of the body, m.
    lo, hi : (2, N) float
        Their boxes.
    mask : (K, N) bool
        Points associated with each facade.
    anchors : (K, 2) float
        Origins of the accumulators, m.
    lengths : (K,) float
        Of the facades, m.
    first_alpha, bins_alpha, step_alpha, first_d, bins_d, step_d
        Cells of the accumulators: (K,) float, (K,) int64, float, likewise; rad and m.
    threshold, core_threshold, apart : float, float, int
        See ``find_peak``; with the second, of the core of the peak.
    least_votes : int
        Facades with fewer points are passed over.
    out : (K, PEAK) float
        Written: votes (NaN if passed over), second peak, lower and upper alpha, lower and upper d, coverage, and the
        5 %, 25 %, 50 %, 75 % and 95 % quantiles along the line of the supporters; their number; and the
        lower and upper alpha and d of the core.
    """
    most_a, most_d = 1, 1
    for k in range(lengths.size):
        most_a, most_d = max(most_a, bins_alpha[k]), max(most_d, bins_d[k])
    count = lo.shape[1]
    box = np.empty((4, count))
    starts, ends = np.empty(count, np.int32), np.empty(count, np.int32)
    edge_lo, edge_hi = np.empty(most_a), np.empty(most_a)
    cl, ch, sl, sh = np.empty(most_a), np.empty(most_a), np.empty(most_a), np.empty(most_a)
    votes = np.empty(most_a * (most_d + 1), np.int32)
    stack, seen = np.empty(most_a * most_d, np.int64), np.empty(most_a * most_d, np.bool_)
    hull = np.empty(4, np.int64)
    along = np.empty(count)
    for k in range(lengths.size):
        out[k, 0] = math.nan
        n = gather(lo, hi, mask[k], anchors[k, 0], anchors[k, 1], box)
        if n < least_votes:
            continue
        rows, columns = bins_alpha[k], bins_d[k]
        for a in range(rows):
            low, high = first_alpha[k] + a * step_alpha, first_alpha[k] + (a + 1) * step_alpha
            edge_lo[a], edge_hi[a] = low - EDGE * (1.0 + abs(low)), high + EDGE * (1.0 + abs(high))
        cosine_sine_arrays(edge_lo[:rows], edge_hi[:rows], cl[:rows], ch[:rows], sl[:rows], sh[:rows])
        counts = votes[: rows * (columns + 1)].reshape(rows, columns + 1)
        vote(
            box[0, :n], box[1, :n], box[2, :n], box[3, :n], cl[:rows], ch[:rows], sl[:rows], sh[:rows], first_d[k],
            step_d, starts, ends, counts,
        )  # fmt: skip
        flags = seen[: rows * columns].reshape(rows, columns)
        find_peak(counts, core_threshold, apart, stack, flags, hull)
        write_hull(hull, first_alpha[k], step_alpha, first_d[k], step_d, out[k, 13:17])
        out[k, 0], out[k, 1] = find_peak(counts, threshold, apart, stack, flags, hull)
        write_hull(hull, first_alpha[k], step_alpha, first_d[k], step_d, out[k, 2:6])
        support(points, mask[k], anchors[k], lengths[k], out[k], along)


@exact_kernel(allocates=False)
def write_hull(hull, first_alpha, step_alpha, first_d, step_d, out):
    """Write lower and upper alpha, lower and upper d of the bins of a hull."""
    for side in range(2):
        alpha, d = first_alpha + hull[side] * step_alpha, first_d + hull[2 + side] * step_d
        sign = 2.0 * side - 1.0
        out[side] = alpha + sign * EDGE * (1.0 + abs(alpha))
        out[2 + side] = d + sign * EDGE * (1.0 + abs(d))


@exact_kernel
def support(points, mask, anchor, length, row, along):
    """Write coverage and quantiles of the points near the line of a hull."""
    middle, half = 0.5 * (row[2] + row[3]), 0.5 * (row[3] - row[2])
    c, s = math.cos(middle), math.sin(middle)
    slack = 0.1 + half * length
    n = 0
    for i in range(mask.size):
        if mask[i]:
            x, y = points[i, 0] - anchor[0], points[i, 1] - anchor[1]
            d = x * c + y * s
            if row[4] - slack < d < row[5] + slack:
                along[n] = y * c - x * s
                n += 1
    row[12] = n
    if n == 0:
        row[6:12] = 0.0
        return
    sort_first(along, n)
    bins = 1
    for i in range(1, n):
        bins += 1 if math.floor(along[i]) != math.floor(along[i - 1]) else 0
    row[6] = min(bins / max(length, 1.0), 1.0)
    for j in range(5):
        part = 0.05 if j == 0 else (0.95 if j == 4 else 0.25 * j)
        row[7 + j] = along[int(part * (n - 1) + 0.5)]
