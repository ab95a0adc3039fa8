"""Evidence for poles: likelihood ratios of boxes of cells, summed up columns.

Every cell weighs three explanations of its hits H and misses M: it belongs to the shaft of a pole, it is free, or it
is clutter. Its tables are differences of log marginal likelihoods: ``shaft`` less free, and ``clutter`` less free. A
box of cells with a hull around it speaks for a pole by

    sum of shaft over the box  -  max(0, sum of clutter over box and hull),

which compares "the box is a shaft, the hull is free" with "all is free" and "all is clutter". Cells that no ray has
met say nothing.
"""

from factorloc._jit import exact_kernel


@exact_kernel(allocates=False)
def fill_evidence(hits, misses, shaft_table, clutter_table, first, last, shaft, clutter):
    """Write integral images of the evidence of slices ``first:last``.

    Parameters
    ----------
    hits, misses : (n_z + 2, n_x + 2, n_y + 2) uint32
        Counts with a rim.
    shaft_table, clutter_table : (N + 1, N + 1) float64
        Evidence of H hits and M misses. More than N rays count as N with the same share of hits.
    shaft, clutter : (n_z, n_x + 1, n_y + 1) float64
        Written: sums over all cells before column x and row y.
    """
    most = shaft_table.shape[0] - 1
    n_x = shaft.shape[1] - 1
    n_y = shaft.shape[2] - 1
    for z in range(first, last):
        for y in range(n_y + 1):
            shaft[z, 0, y] = 0.0
            clutter[z, 0, y] = 0.0
        for x in range(n_x):
            row_shaft = 0.0
            row_clutter = 0.0
            shaft[z, x + 1, 0] = 0.0
            clutter[z, x + 1, 0] = 0.0
            for y in range(n_y):
                h = int(hits[z + 1, x + 1, y + 1])
                m = int(misses[z + 1, x + 1, y + 1])
                if h + m > 0:
                    if h + m > most:
                        h = (2 * h * most + h + m) // (2 * (h + m))
                        m = most - h
                    row_shaft += shaft_table[h, m]
                    row_clutter += clutter_table[h, m]
                shaft[z, x + 1, y + 1] = shaft[z, x, y + 1] + row_shaft
                clutter[z, x + 1, y + 1] = clutter[z, x, y + 1] + row_clutter


@exact_kernel(allocates=False)
def best_runs(shaft, clutter, a, f, height, current, starts, best, bottoms, tops):
    """Run of slices with the greatest sum of evidence, for every box of one width (Kadane's algorithm).

    Parameters
    ----------
    shaft, clutter : (n_z, n_x + 1, n_y + 1) float64
        Integral images.
    a, f : int
        Width of the box and thickness of the hull, cells.
    height : int
        Slices of the lowest run that counts.
    current : (n_x, n_y) float64
        Work array.
    starts : (n_x, n_y) int64
        Work array.
    best : (n_x, n_y) float64
        Written, by the lowest corner of the box: the sum; 0 where no run counts.
    bottoms, tops : (n_x, n_y) int64
        Written: its first slice, and the one after its last.
    """
    n_z = shaft.shape[0]
    n_x, n_y = best.shape
    for x in range(n_x):
        for y in range(n_y):
            current[x, y] = 0.0
            starts[x, y] = 0
            best[x, y] = 0.0
            bottoms[x, y] = 0
            tops[x, y] = 0
    for z in range(n_z):
        for x in range(f, n_x - a - f + 1):
            for y in range(f, n_y - a - f + 1):
                inside = shaft[z, x + a, y + a] - shaft[z, x, y + a] - shaft[z, x + a, y] + shaft[z, x, y]
                around = (
                    clutter[z, x + a + f, y + a + f]
                    - clutter[z, x - f, y + a + f]
                    - clutter[z, x + a + f, y - f]
                    + clutter[z, x - f, y - f]
                )
                evidence = inside - max(around, 0.0)
                total = current[x, y] + evidence
                if total <= 0.0:
                    current[x, y] = 0.0
                    starts[x, y] = z + 1
                    continue
                current[x, y] = total
                if total > best[x, y] and z + 1 - starts[x, y] >= height:
                    best[x, y] = total
                    bottoms[x, y] = starts[x, y]
                    tops[x, y] = z + 1


@exact_kernel(allocates=False)
def choose_boxes(boxes, order, f, taken, chosen):
    """Choose boxes in a given order, none of which reaches into the hull of another.

    Parameters
    ----------
    boxes : (N, 3) int64
        Lowest corner and width, cells.
    order : (N,) int64
        Which comes first.
    f : int
        Thickness of the hull, cells.
    taken : (n_x, n_y) bool
        All false; left with the chosen boxes and hulls.
    chosen : (N,) bool
        Written.
    """
    for n in range(order.shape[0]):
        k = order[n]
        x = boxes[k, 0]
        y = boxes[k, 1]
        a = boxes[k, 2]
        free = True
        for i in range(x, x + a):
            for j in range(y, y + a):
                if taken[i, j]:
                    free = False
        chosen[k] = free
        if free:
            for i in range(x - f, x + a + f):
                for j in range(y - f, y + a + f):
                    taken[i, j] = True


@exact_kernel(allocates=False)
def hull_evidence(shaft, boxes, bottoms, tops, f, most):
    """Greatest evidence of any column around each box to be part of a shaft itself, between the slices of the box.

    Parameters
    ----------
    shaft : (n_z, n_x + 1, n_y + 1) float64
        Integral images.
    boxes : (N, 3) int64
        Lowest corner and width, cells.
    bottoms, tops : (N,) int64
        Slices.
    f : int
        Thickness of the hull, cells.
    most : (N,) float64
        Written.
    """
    for k in range(boxes.shape[0]):
        x = boxes[k, 0]
        y = boxes[k, 1]
        a = boxes[k, 2]
        greatest = -1e300
        for i in range(x - f, x + a + f):
            inside = x <= i < x + a
            for j in range(y - f, y + a + f):
                if inside and y <= j < y + a:
                    continue
                total = 0.0
                for z in range(bottoms[k], tops[k]):
                    total += shaft[z, i + 1, j + 1] - shaft[z, i, j + 1] - shaft[z, i + 1, j] + shaft[z, i, j]
                greatest = max(greatest, total)
        most[k] = greatest
