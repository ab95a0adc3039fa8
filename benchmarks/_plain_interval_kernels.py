"""Interval loops without outward rounding, compiled like the package's own: what those are measured against."""

from factorloc._jit import exact_kernel


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
