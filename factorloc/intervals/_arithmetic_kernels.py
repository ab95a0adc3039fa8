"""Arithmetic of closed intervals with outward rounding, in rounding to nearest.

An interval is a pair of floats ``lo <= hi``, where ``lo`` may be minus and ``hi`` plus infinity; the empty set is a
pair of NaN, which arithmetic hands on by itself. A product of zero and infinity and a quotient of infinities are NaN
too and must never pass for the empty set; they are replaced by 0, right as bounds are limits of finite numbers.

Directed rounding (Rump, Zimmermann, Boldo, Melquiond 2009, with the smallest normal number in place of the smallest
subnormal one). Let ``u = 2^-53``, ``phi = u (1 + 2u)``, ``eta = 2^-1022`` and ``e = fl(fl(phi |x|) + eta)`` for a
finite ``x`` with ``2^k <= |x| < 2^(k+1)``. The distance of ``x`` to its neighbours is at most ``2u 2^k``, so that
``fl(x - e)`` is at most the predecessor of ``x`` as soon as ``e > u 2^k``. Rounding is monotone and
``u 2^k (1 + 2u)`` is a float unless it is below ``eta``; hence ``e >= fl(phi |x|) >= u 2^k (1 + 2u) > u 2^k``, or else
``e >= eta > phi |x| > u 2^k``. For ``x = 0``, ``e = eta``. What rounds to ``x`` lies between the neighbours of ``x``,
so between the two bounds. A result that overflowed lies beyond the largest float and is bounded by it. The cost is a
bound of at most two units in the last place and ``eta`` beyond the rounded result.

The argument needs every operation rounded on its own: all kernels here are exact, none is fast.
"""

import math

from factorloc._jit import exact_kernel

UNIT = 2.0**-53
PHI = UNIT * (1.0 + 2.0**-52)
ETA = 2.0**-1022
LARGEST = 2.0**1023 * (2.0 - 2.0**-52)


@exact_kernel(allocates=False, inline=True)
def lower(x):
    """A float below all numbers that round to ``x``."""
    x = LARGEST if x > LARGEST else x
    return x - (abs(x) * PHI + ETA)


@exact_kernel(allocates=False, inline=True)
def upper(x):
    """A float above all numbers that round to ``x``."""
    x = -LARGEST if x < -LARGEST else x
    return x + (abs(x) * PHI + ETA)


@exact_kernel(allocates=False, inline=True)
def add(al, ah, bl, bh):
    """``a + b``; no sum meets opposite infinities, as no lower bound is plus infinity."""
    return lower(al + bl), upper(ah + bh)


@exact_kernel(allocates=False, inline=True)
def subtract(al, ah, bl, bh):
    """``a - b``."""
    return lower(al - bh), upper(ah - bl)


@exact_kernel(allocates=False, inline=True)
def multiply(al, ah, bl, bh):
    """``a b``, without a branch."""
    p, q, r, s = al * bl, al * bh, ah * bl, ah * bh
    p = p if p == p else 0.0
    q = q if q == q else 0.0
    r = r if r == r else 0.0
    s = s if s == s else 0.0
    least, less = (p if p < q else q), (r if r < s else s)
    most, more = (p if p > q else q), (r if r > s else s)
    lo = lower(least if least < less else less)
    hi = upper(most if most > more else more)
    empty = (al != al) | (bl != bl)
    return (math.nan if empty else lo), (math.nan if empty else hi)


@exact_kernel(allocates=False, inline=True)
def dot(al, ah, bl, bh, xl, xh, yl, yh):
    """``a x + b y``."""
    pl, ph = multiply(al, ah, xl, xh)
    ql, qh = multiply(bl, bh, yl, yh)
    return add(pl, ph, ql, qh)


@exact_kernel(allocates=False, inline=True)
def meet(al, ah, bl, bh):
    """Intersection."""
    lo, hi = (bl if bl > al else al), (bh if bh < ah else ah)
    there = (lo <= hi) & (bl == bl)
    return (lo if there else math.nan), (hi if there else math.nan)


@exact_kernel(allocates=False, inline=True)
def join(al, ah, bl, bh):
    """Hull of the union."""
    lo, hi = (bl if bl < al else al), (bh if bh > ah else ah)
    return (lo if al == al else bl), (hi if al == al else bh)


@exact_kernel(allocates=False, inline=True)
def divide_within(al, ah, bl, bh, xl, xh):
    """Hull of the ``x`` in ``[xl, xh]`` with ``x b = a`` for some ``a`` and ``b``: both pieces, if 0 splits them.

    Without a branch. Two quotients do for all cases, one of them a lower bound and one an upper: of the whole where
    ``b > 0``; where 0 splits it, of the right and of the left piece.
    """
    empty = (al != al) | (bl != bl) | (xl != xl)
    turn = bh < 0.0
    al, ah, bl, bh = (-ah if turn else al), (-al if turn else ah), (-bh if turn else bl), (-bl if turn else bh)
    positive, above, below = bl > 0.0, al > 0.0, ah < 0.0
    p = (ah if below & (not positive) else al) / (bl if al < 0.0 else bh)
    q = (al if above & (not positive) else ah) / (bh if below else bl)
    lo, hi = lower(p if p == p else 0.0), upper(q if q == q else 0.0)
    whole_l, whole_h = meet(xl, xh, lo, hi)
    to_left, to_right = (bl < 0.0 if above else bh > 0.0), (bh > 0.0 if above else bl < 0.0)
    left_l, left_h = meet(xl, xh, -math.inf if to_left else math.nan, hi)
    right_l, right_h = meet(xl, xh, lo if to_right else math.nan, math.inf)
    split_l, split_h = join(left_l, left_h, right_l, right_h)
    split = above | below
    lo, hi = (split_l if split else xl), (split_h if split else xh)
    lo, hi = (whole_l if positive else lo), (whole_h if positive else hi)
    return (math.nan if empty else lo), (math.nan if empty else hi)


@exact_kernel(allocates=False)
def divide(al, ah, bl, bh):
    """Hull of ``a / b`` over the ``b`` other than 0."""
    if bl == 0.0 and bh == 0.0:
        return math.nan, math.nan
    return divide_within(al, ah, bl, bh, -math.inf, math.inf)


@exact_kernel(allocates=False, inline=True)
def magnitude(al, ah):
    """``|a|``, exactly."""
    lo, hi = abs(al), abs(ah)
    least, most = (lo if lo < hi else hi), (lo if lo > hi else hi)
    return (0.0 if (al <= 0.0) & (ah >= 0.0) else least), most


@exact_kernel(allocates=False, inline=True)
def square(al, ah):
    """``a^2``."""
    lo, hi = magnitude(al, ah)
    least = lower(lo * lo)
    return (0.0 if least < 0.0 else least), upper(hi * hi)


@exact_kernel(allocates=False, inline=True)
def root(al, ah):
    """``sqrt(a)`` over the ``a`` that are not negative; the square root of floats rounds like their sum."""
    there = ah >= 0.0
    least, most = lower(math.sqrt(al if al > 0.0 else 0.0)), upper(math.sqrt(ah if ah > 0.0 else 0.0))
    least, most = (least if least > 0.0 else 0.0), (most if ah > 0.0 else 0.0)
    return (least if there else math.nan), (most if there else math.nan)


@exact_kernel(allocates=False, inline=True)
def root_within(al, ah, xl, xh):
    """Hull of the ``x`` in ``[xl, xh]`` with ``x^2`` in ``a``: both branches."""
    least, most = root(al, ah)
    first_l, first_h = meet(xl, xh, -most, -least)
    second_l, second_h = meet(xl, xh, least, most)
    return join(first_l, first_h, second_l, second_h)


@exact_kernel(allocates=False)
def power(al, ah, exponent):
    """``a^exponent`` for a positive integer exponent: bounds of magnitudes multiplied outwards one by one."""
    lo, hi = magnitude(al, ah)
    least, most = (lo, hi) if al == al else (math.nan, math.nan)
    # Of an odd power the bounds keep their signs, so that the magnitudes belong to one bound each.
    if exponent % 2 == 1:
        lo, hi = abs(al), abs(ah)
    low_least, low_most, high_least, high_most = lo, lo, hi, hi
    for _ in range(exponent - 1):
        low_least, low_most = max(lower(low_least * lo), 0.0), upper(low_most * lo)
        high_least, high_most = max(lower(high_least * hi), 0.0), upper(high_most * hi)
    if al != al:
        return least, most
    if exponent % 2 == 0:
        return low_least, high_most
    return (low_least if al >= 0.0 else -low_most), (high_most if ah >= 0.0 else -high_least)


@exact_kernel(allocates=False, inline=True)
def norm(xl, xh, yl, yh):
    """``sqrt(x^2 + y^2)``."""
    al, ah = square(xl, xh)
    bl, bh = square(yl, yh)
    lo, hi = add(al, ah, bl, bh)
    return root(lo, hi)


@exact_kernel(allocates=False)
def add_arrays(al, ah, bl, bh, lo, hi):
    """Write ``a + b`` of arrays."""
    for i in range(al.size):
        lo[i], hi[i] = add(al[i], ah[i], bl[i], bh[i])


@exact_kernel(allocates=False)
def multiply_arrays(al, ah, bl, bh, lo, hi):
    """Write ``a b`` of arrays."""
    for i in range(al.size):
        lo[i], hi[i] = multiply(al[i], ah[i], bl[i], bh[i])


@exact_kernel(allocates=False)
def divide_arrays(al, ah, bl, bh, lo, hi):
    """Write ``a / b`` of arrays."""
    for i in range(al.size):
        lo[i], hi[i] = divide(al[i], ah[i], bl[i], bh[i])


@exact_kernel(allocates=False)
def square_arrays(al, ah, lo, hi):
    """Write ``a^2`` of an array."""
    for i in range(al.size):
        lo[i], hi[i] = square(al[i], ah[i])


@exact_kernel(allocates=False)
def root_arrays(al, ah, lo, hi):
    """Write ``sqrt(a)`` of an array."""
    for i in range(al.size):
        lo[i], hi[i] = root(al[i], ah[i])


@exact_kernel(allocates=False)
def power_arrays(al, ah, exponent, lo, hi):
    """Write ``a^exponent`` of an array."""
    for i in range(al.size):
        lo[i], hi[i] = power(al[i], ah[i], exponent)


@exact_kernel(allocates=False)
def norm_arrays(xl, xh, yl, yh, lo, hi):
    """Write ``sqrt(x^2 + y^2)`` of arrays."""
    for i in range(xl.size):
        lo[i], hi[i] = norm(xl[i], xh[i], yl[i], yh[i])
