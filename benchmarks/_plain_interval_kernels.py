"""Interval loops without outward rounding, compiled like the package's own: what those are measured against."""

from factorloc._jit import exact_kernel, kernel


@exact_kernel(allocates=False)
def plain_multiply(al, ah, bl, bh):
    """``a b`` of finite bounds, rounded to nearest."""
    p, q, r, s = al * bl, al * bh, ah * bl, ah * bh
    least, less = (p if p < q else q), (r if r < s else s)
    most, more = (p if p > q else q), (r if r > s else s)
    return (least if least < less else less), (most if most > more else more)


@exact_kernel(allocates=False)
def plain_move(xl, xh, yl, yh, cl, ch, sl, sh, al, ah, bl, bh, ul, uh, vl, vh):
    """As ``factorloc.intervals._elementary_kernels.move_arrays``, rounded to nearest."""
    for i in range(xl.size):
        p, q = plain_multiply(xl[i], xh[i], cl, ch)
        r, s = plain_multiply(yl[i], yh[i], sl, sh)
        ul[i], uh[i] = p - s + al, q - r + ah
        p, q = plain_multiply(xl[i], xh[i], sl, sh)
        r, s = plain_multiply(yl[i], yh[i], cl, ch)
        vl[i], vh[i] = p + r + bl, q + s + bh


@kernel(allocates=False)
def plain_pass(points, c, s, x, y, out):
    """Turn and shift every point of a scan once and write its squared range: one plain pass over the points."""
    for i in range(points.shape[0]):
        u = c * points[i, 0] - s * points[i, 1] + x
        v = s * points[i, 0] + c * points[i, 1] + y
        out[i] = u * u + v * v + points[i, 2] * points[i, 2]


@kernel(allocates=False)
def scattered_increments(where, counts, times):
    """Add one to scattered cells, so many times over: what an accumulator costs at least."""
    for _ in range(times):
        for i in range(where.size):
            counts[where[i]] += 1
