"""Contractions of boxes in place: arrays of bounds of shape (n, N), one row a variable; an empty box becomes NaN.

Each variable is met with what the constraint leaves for it, given the others: no solution is lost, whatever the order.
"""

import math

from factorloc._jit import exact_kernel
from factorloc.intervals._arithmetic_kernels import (
    add,
    divide_within,
    dot,
    meet,
    multiply,
    norm,
    root_within,
    square,
    subtract,
)
from factorloc.intervals._trigonometric_kernels import (
    arc,
    cosine_sine_arrays,
    cosine_within,
    meet_turns,
    sine_within,
)


@exact_kernel(allocates=False, inline=True)
def store(lo, hi, i, row, low, high):
    """Meet one side with ``[low, high]``."""
    lo[row, i], hi[row, i] = meet(lo[row, i], hi[row, i], low, high)


@exact_kernel(allocates=False)
def clear_empty(lo, hi):
    """Make boxes with an empty side empty as a whole."""
    for i in range(lo.shape[1]):
        empty = False
        for row in range(lo.shape[0]):
            empty = empty or lo[row, i] != lo[row, i]
        if empty:
            for row in range(lo.shape[0]):
                lo[row, i], hi[row, i] = math.nan, math.nan


@exact_kernel(allocates=False)
def contract_sum(lo, hi):
    """``z = x + y`` in rows x, y, z."""
    for i in range(lo.shape[1]):
        a, b = add(lo[0, i], hi[0, i], lo[1, i], hi[1, i])
        store(lo, hi, i, 2, a, b)
        a, b = subtract(lo[2, i], hi[2, i], lo[1, i], hi[1, i])
        store(lo, hi, i, 0, a, b)
        a, b = subtract(lo[2, i], hi[2, i], lo[0, i], hi[0, i])
        store(lo, hi, i, 1, a, b)
    clear_empty(lo, hi)


@exact_kernel(allocates=False)
def contract_product(lo, hi):
    """``z = x y`` in rows x, y, z."""
    for i in range(lo.shape[1]):
        a, b = multiply(lo[0, i], hi[0, i], lo[1, i], hi[1, i])
        store(lo, hi, i, 2, a, b)
        lo[0, i], hi[0, i] = divide_within(lo[2, i], hi[2, i], lo[1, i], hi[1, i], lo[0, i], hi[0, i])
        lo[1, i], hi[1, i] = divide_within(lo[2, i], hi[2, i], lo[0, i], hi[0, i], lo[1, i], hi[1, i])
    clear_empty(lo, hi)


@exact_kernel(allocates=False)
def contract_square(lo, hi):
    """``y = x^2`` in rows x, y."""
    for i in range(lo.shape[1]):
        a, b = square(lo[0, i], hi[0, i])
        store(lo, hi, i, 1, a, b)
        lo[0, i], hi[0, i] = root_within(lo[1, i], hi[1, i], lo[0, i], hi[0, i])
        a, b = square(lo[0, i], hi[0, i])
        store(lo, hi, i, 1, a, b)
    clear_empty(lo, hi)


@exact_kernel(allocates=False)
def contract_cosine(lo, hi, cl, ch, sl, sh):
    """``y = cos x`` in rows x, y; the rest is room to work in."""
    for turn in range(2):
        cosine_sine_arrays(lo[0], hi[0], cl, ch, sl, sh)
        for i in range(lo.shape[1]):
            store(lo, hi, i, 1, cl[i], ch[i])
            if turn == 0:
                lo[0, i], hi[0, i] = cosine_within(lo[1, i], hi[1, i], lo[0, i], hi[0, i])
    clear_empty(lo, hi)


@exact_kernel(allocates=False)
def contract_sine(lo, hi, cl, ch, sl, sh):
    """``y = sin x`` in rows x, y; the rest is room to work in."""
    for turn in range(2):
        cosine_sine_arrays(lo[0], hi[0], cl, ch, sl, sh)
        for i in range(lo.shape[1]):
            store(lo, hi, i, 1, sl[i], sh[i])
            if turn == 0:
                lo[0, i], hi[0, i] = sine_within(lo[1, i], hi[1, i], lo[0, i], hi[0, i])
    clear_empty(lo, hi)


@exact_kernel(allocates=False, inline=True)
def legs(xl, xh, yl, yh, rl, rh):
    """``x``, ``y`` and ``r >= 0``, given that ``x^2 + y^2 = r^2``."""
    al, ah = norm(xl, xh, yl, yh)
    rl, rh = meet(rl, rh, al, ah)
    sl, sh = square(rl, rh)
    al, ah = square(yl, yh)
    al, ah = subtract(sl, sh, al, ah)
    xl, xh = root_within(al, ah, xl, xh)
    al, ah = square(xl, xh)
    al, ah = subtract(sl, sh, al, ah)
    yl, yh = root_within(al, ah, yl, yh)
    return xl, xh, yl, yh, rl, rh


@exact_kernel(allocates=False)
def contract_polar(lo, hi, cl, ch, sl, sh):
    """``x = r cos b, y = r sin b, r >= 0`` in rows x, y, r, b; the rest is room to work in.

    Short loops without a branch, which vectorize.
    """
    for i in range(lo.shape[1]):
        rl, rh = meet(lo[2, i], hi[2, i], 0.0, math.inf)
        lo[0, i], hi[0, i], lo[1, i], hi[1, i], lo[2, i], hi[2, i] = legs(
            lo[0, i], hi[0, i], lo[1, i], hi[1, i], rl, rh
        )
    for i in range(lo.shape[1]):
        cl[i], ch[i] = arc(lo[1, i], hi[1, i], lo[0, i], hi[0, i])
    for i in range(lo.shape[1]):
        xl, xh, yl, yh = lo[0, i], hi[0, i], lo[1, i], hi[1, i]
        around = around_zero(xl, xh, yl, yh) & (not lo[2, i] > 0.0)
        al, ah = meet_turns(lo[3, i], hi[3, i], cl[i], ch[i])
        lo[3, i], hi[3, i] = (lo[3, i] if around else al), (hi[3, i] if around else ah)
    cosine_sine_arrays(lo[3], hi[3], cl, ch, sl, sh)
    for i in range(lo.shape[1]):
        rl, rh = divide_within(lo[0, i], hi[0, i], cl[i], ch[i], lo[2, i], hi[2, i])
        lo[2, i], hi[2, i] = divide_within(lo[1, i], hi[1, i], sl[i], sh[i], rl, rh)
    for i in range(lo.shape[1]):
        al, ah = multiply(lo[2, i], hi[2, i], cl[i], ch[i])
        lo[0, i], hi[0, i] = meet(lo[0, i], hi[0, i], al, ah)
        al, ah = multiply(lo[2, i], hi[2, i], sl[i], sh[i])
        lo[1, i], hi[1, i] = meet(lo[1, i], hi[1, i], al, ah)
    clear_empty(lo, hi)


@exact_kernel(allocates=False)
def contract_distance(lo, hi):
    """``d^2 = (a_x - b_x)^2 + (a_y - b_y)^2`` in rows a_x, a_y, b_x, b_y, d."""
    for i in range(lo.shape[1]):
        xl, xh = subtract(lo[0, i], hi[0, i], lo[2, i], hi[2, i])
        yl, yh = subtract(lo[1, i], hi[1, i], lo[3, i], hi[3, i])
        rl, rh = meet(lo[4, i], hi[4, i], 0.0, math.inf)
        xl, xh, yl, yh, lo[4, i], hi[4, i] = legs(xl, xh, yl, yh, rl, rh)
        a, b = add(lo[2, i], hi[2, i], xl, xh)
        store(lo, hi, i, 0, a, b)
        a, b = subtract(lo[0, i], hi[0, i], xl, xh)
        store(lo, hi, i, 2, a, b)
        a, b = add(lo[3, i], hi[3, i], yl, yh)
        store(lo, hi, i, 1, a, b)
        a, b = subtract(lo[1, i], hi[1, i], yl, yh)
        store(lo, hi, i, 3, a, b)
    clear_empty(lo, hi)


@exact_kernel(allocates=False, inline=True)
def shift(tl, th, ml, mh, wl, wh):
    """``t`` and ``m``, given that ``m = t + w``."""
    a, b = add(tl, th, wl, wh)
    ml, mh = meet(ml, mh, a, b)
    a, b = subtract(ml, mh, wl, wh)
    tl, th = meet(tl, th, a, b)
    return tl, th, ml, mh


@exact_kernel(allocates=False)
def contract_rigid_motion(lo, hi, cl, ch, sl, sh):
    """``m = R(theta) l + t`` in rows theta, t_x, t_y, l_x, l_y, m_x, m_y; the rest is room to work in.

    With ``w = m - t``: ``w = R l``, ``l = R' w``, and the angle of ``w`` exceeds that of ``l`` by ``theta``.
    """
    cosine_sine_arrays(lo[0], hi[0], cl, ch, sl, sh)
    for i in range(lo.shape[1]):
        c0, c1, s0, s1 = cl[i], ch[i], sl[i], sh[i]
        pl, ph, ql, qh = lo[3, i], hi[3, i], lo[4, i], hi[4, i]
        xl, xh = subtract(lo[5, i], hi[5, i], lo[1, i], hi[1, i])
        yl, yh = subtract(lo[6, i], hi[6, i], lo[2, i], hi[2, i])
        a, b = dot(c0, c1, -s1, -s0, pl, ph, ql, qh)
        xl, xh = meet(xl, xh, a, b)
        a, b = dot(s0, s1, c0, c1, pl, ph, ql, qh)
        yl, yh = meet(yl, yh, a, b)
        a, b = dot(c0, c1, s0, s1, xl, xh, yl, yh)
        lo[3, i], hi[3, i] = meet(pl, ph, a, b)
        a, b = dot(-s1, -s0, c0, c1, xl, xh, yl, yh)
        lo[4, i], hi[4, i] = meet(ql, qh, a, b)
        cl[i], ch[i], sl[i], sh[i] = xl, xh, yl, yh
    for i in range(lo.shape[1]):
        lo[1, i], hi[1, i], lo[5, i], hi[5, i] = shift(lo[1, i], hi[1, i], lo[5, i], hi[5, i], cl[i], ch[i])
        lo[2, i], hi[2, i], lo[6, i], hi[6, i] = shift(lo[2, i], hi[2, i], lo[6, i], hi[6, i], sl[i], sh[i])
    for i in range(lo.shape[1]):
        around = around_zero(lo[3, i], hi[3, i], lo[4, i], hi[4, i]) & around_zero(cl[i], ch[i], sl[i], sh[i])
        al, ah = arc(sl[i], sh[i], cl[i], ch[i])
        bl, bh = arc(lo[4, i], hi[4, i], lo[3, i], hi[3, i])
        a, b = subtract(al, ah, bl, bh)
        # Both vectors have one length; if one of them cannot vanish, both have an angle.
        cl[i], ch[i] = (-math.inf if around else a), (math.inf if around else b)
    for i in range(lo.shape[1]):
        lo[0, i], hi[0, i] = meet_turns(lo[0, i], hi[0, i], cl[i], ch[i])
    clear_empty(lo, hi)


@exact_kernel(allocates=False, inline=True)
def around_zero(xl, xh, yl, yh):
    """Whether the zero vector lies in a box."""
    return (xl <= 0.0) & (xh >= 0.0) & (yl <= 0.0) & (yh >= 0.0)
