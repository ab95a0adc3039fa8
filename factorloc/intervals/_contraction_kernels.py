"""Contractions of boxes in place: arrays of bounds of shape (n, N), one row a variable; an empty box becomes NaN.

Each variable is met with what the constraint leaves for it, given the others: no solution is lost, whatever the order.
"""

import math

from factorloc._jit import exact_kernel
from factorloc.intervals._arithmetic_kernels import (
    add,
    divide_within,
    join,
    meet,
    multiply,
    norm,
    root_within,
    square,
    subtract,
)
from factorloc.intervals._trigonometric_kernels import (
    arc,
    arccosine,
    cosine_sine_arrays,
    cosine_within,
    meet_turns,
    sine_within,
)


@exact_kernel(allocates=False)
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


@exact_kernel(allocates=False)
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
    """``x = r cos b, y = r sin b, r >= 0`` in rows x, y, r, b; the rest is room to work in."""
    for i in range(lo.shape[1]):
        rl, rh = meet(lo[2, i], hi[2, i], 0.0, math.inf)
        xl, xh, yl, yh, rl, rh = legs(lo[0, i], hi[0, i], lo[1, i], hi[1, i], rl, rh)
        if rl > 0.0 or not (xl <= 0.0 <= xh and yl <= 0.0 <= yh):
            al, ah = arc(yl, yh, xl, xh)
            lo[3, i], hi[3, i] = meet_turns(lo[3, i], hi[3, i], al, ah)
        lo[0, i], hi[0, i], lo[1, i], hi[1, i], lo[2, i], hi[2, i] = xl, xh, yl, yh, rl, rh
    cosine_sine_arrays(lo[3], hi[3], cl, ch, sl, sh)
    for i in range(lo.shape[1]):
        xl, xh, yl, yh = lo[0, i], hi[0, i], lo[1, i], hi[1, i]
        rl, rh = divide_within(xl, xh, cl[i], ch[i], lo[2, i], hi[2, i])
        rl, rh = divide_within(yl, yh, sl[i], sh[i], rl, rh)
        al, ah = multiply(rl, rh, cl[i], ch[i])
        xl, xh = meet(xl, xh, al, ah)
        al, ah = multiply(rl, rh, sl[i], sh[i])
        yl, yh = meet(yl, yh, al, ah)
        lo[0, i], hi[0, i], lo[1, i], hi[1, i], lo[2, i], hi[2, i] = xl, xh, yl, yh, rl, rh
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


@exact_kernel(allocates=False)
def dot(al, ah, bl, bh, xl, xh, yl, yh):
    """``a x + b y``."""
    pl, ph = multiply(al, ah, xl, xh)
    ql, qh = multiply(bl, bh, yl, yh)
    return add(pl, ph, ql, qh)


@exact_kernel(allocates=False)
def contract_rigid_motion(lo, hi, cl, ch, sl, sh):
    """``m = R(theta) l + t`` in rows theta, t_x, t_y, l_x, l_y, m_x, m_y; the rest is room to work in.

    With ``w = m - t``: ``w = R l``, ``l = R' w``, and the angle of ``w`` exceeds that of ``l`` by ``theta``.
    """
    cosine_sine_arrays(lo[0], hi[0], cl, ch, sl, sh)
    for i in range(lo.shape[1]):
        c0, c1, s0, s1 = cl[i], ch[i], sl[i], sh[i]
        al, ah = dot(c0, c1, -s1, -s0, lo[3, i], hi[3, i], lo[4, i], hi[4, i])
        bl, bh = dot(s0, s1, c0, c1, lo[3, i], hi[3, i], lo[4, i], hi[4, i])
        xl, xh = subtract(lo[5, i], hi[5, i], lo[1, i], hi[1, i])
        yl, yh = subtract(lo[6, i], hi[6, i], lo[2, i], hi[2, i])
        xl, xh = meet(xl, xh, al, ah)
        yl, yh = meet(yl, yh, bl, bh)
        a, b = add(lo[1, i], hi[1, i], xl, xh)
        store(lo, hi, i, 5, a, b)
        a, b = add(lo[2, i], hi[2, i], yl, yh)
        store(lo, hi, i, 6, a, b)
        a, b = subtract(lo[5, i], hi[5, i], xl, xh)
        store(lo, hi, i, 1, a, b)
        a, b = subtract(lo[6, i], hi[6, i], yl, yh)
        store(lo, hi, i, 2, a, b)
        a, b = dot(c0, c1, s0, s1, xl, xh, yl, yh)
        store(lo, hi, i, 3, a, b)
        a, b = dot(-s1, -s0, c0, c1, xl, xh, yl, yh)
        store(lo, hi, i, 4, a, b)
        pl, ph, ql, qh = lo[3, i], hi[3, i], lo[4, i], hi[4, i]
        # Both vectors have one length; if one of them cannot vanish, both have an angle.
        if not (pl <= 0.0 <= ph and ql <= 0.0 <= qh) or not (xl <= 0.0 <= xh and yl <= 0.0 <= yh):
            al, ah = arc(yl, yh, xl, xh)
            bl, bh = arc(ql, qh, pl, ph)
            a, b = subtract(al, ah, bl, bh)
            lo[0, i], hi[0, i] = meet_turns(lo[0, i], hi[0, i], a, b)
    clear_empty(lo, hi)


@exact_kernel(allocates=False)
def contract_line(lo, hi, cl, ch, sl, sh):
    """``x cos a + y sin a = d`` in rows a, d, x, y; the rest is room to work in."""
    cosine_sine_arrays(lo[0], hi[0], cl, ch, sl, sh)
    for i in range(lo.shape[1]):
        pl, ph = multiply(cl[i], ch[i], lo[2, i], hi[2, i])
        ql, qh = multiply(sl[i], sh[i], lo[3, i], hi[3, i])
        a, b = add(pl, ph, ql, qh)
        store(lo, hi, i, 1, a, b)
        a, b = subtract(lo[1, i], hi[1, i], ql, qh)
        pl, ph = meet(pl, ph, a, b)
        a, b = subtract(lo[1, i], hi[1, i], pl, ph)
        ql, qh = meet(ql, qh, a, b)
        lo[2, i], hi[2, i] = divide_within(pl, ph, cl[i], ch[i], lo[2, i], hi[2, i])
        lo[3, i], hi[3, i] = divide_within(ql, qh, sl[i], sh[i], lo[3, i], hi[3, i])
        # In polar coordinates, r cos(a - b) = d.
        rl, rh = norm(lo[2, i], hi[2, i], lo[3, i], hi[3, i])
        if rl > 0.0:
            bl, bh = arc(lo[3, i], hi[3, i], lo[2, i], hi[2, i])
            lo[0, i], hi[0, i] = around_arc(lo[0, i], hi[0, i], bl, bh, lo[1, i], hi[1, i], rl, rh)
    clear_empty(lo, hi)


@exact_kernel(allocates=False)
def around_arc(xl, xh, bl, bh, dl, dh, rl, rh):
    """Hull of the ``x`` in ``[xl, xh]`` with ``r cos(x - b) = d``, ``r > 0``: both sides of ``b``, in every turn."""
    al, ah = divide_within(dl, dh, rl, rh, -1.0, 1.0)
    al, ah = arccosine(al, ah)
    fl, fh = add(bl, bh, al, ah)
    gl, gh = subtract(bl, bh, al, ah)
    fl, fh = meet_turns(xl, xh, fl, fh)
    gl, gh = meet_turns(xl, xh, gl, gh)
    return join(fl, fh, gl, gh)


@exact_kernel(allocates=False)
def contract_heading(lo, hi, cl, ch, sl, sh):
    """Heading of a sensor at t that sees a point (r, b) of the line (a, d): rows theta, t_x, t_y, r, b, a, d.

    ``r cos(theta + b - a) = d - t . (cos a, sin a)``, so that ``theta = a - b +- acos((d - t . n) / r)``.
    """
    cosine_sine_arrays(lo[5], hi[5], cl, ch, sl, sh)
    for i in range(lo.shape[1]):
        rl, rh = lo[3, i], hi[3, i]
        if rl > 0.0:
            nl, nh = dot(cl[i], ch[i], sl[i], sh[i], lo[1, i], hi[1, i], lo[2, i], hi[2, i])
            nl, nh = subtract(lo[6, i], hi[6, i], nl, nh)
            bl, bh = subtract(lo[5, i], hi[5, i], lo[4, i], hi[4, i])
            lo[0, i], hi[0, i] = around_arc(lo[0, i], hi[0, i], bl, bh, nl, nh, rl, rh)
    clear_empty(lo, hi)


@exact_kernel(allocates=False)
def contract_linear(lo, hi, al, ah, bl, bh, dl, dh):
    """``a x + b y`` in ``[dl, dh]``, rows x, y; the coefficients are intervals."""
    for i in range(lo.shape[1]):
        pl, ph = multiply(al, ah, lo[0, i], hi[0, i])
        ql, qh = multiply(bl, bh, lo[1, i], hi[1, i])
        a, b = subtract(dl, dh, ql, qh)
        pl, ph = meet(pl, ph, a, b)
        a, b = subtract(dl, dh, pl, ph)
        ql, qh = meet(ql, qh, a, b)
        lo[0, i], hi[0, i] = divide_within(pl, ph, al, ah, lo[0, i], hi[0, i])
        lo[1, i], hi[1, i] = divide_within(ql, qh, bl, bh, lo[1, i], hi[1, i])
    clear_empty(lo, hi)
