"""Contractions of boxes in place by lines in the plane: arrays of bounds of shape (n, N), one row a variable.

As in the kernels of other constraints, an empty box becomes NaN, and no solution is lost.
"""

import math

from factorloc._jit import exact_kernel
from factorloc.intervals._arithmetic_kernels import add, divide_within, dot, join, meet, multiply, norm, subtract
from factorloc.intervals._contraction_kernels import clear_empty
from factorloc.intervals._trigonometric_kernels import arc, arccosine, cosine_sine_arrays, meet_turns


@exact_kernel(allocates=False, inline=True)
def around_arc(bl, bh, dl, dh, rl, rh):
    """The ``x`` with ``r cos(x - b) = d``: an arc on either side of ``b``; all numbers if ``r`` may be 0."""
    al, ah = divide_within(dl, dh, rl, rh, -1.0, 1.0)
    al, ah = arccosine(al, ah)
    fl, fh = add(bl, bh, al, ah)
    gl, gh = subtract(bl, bh, al, ah)
    told = rl > 0.0
    fl, fh = (fl if told else -math.inf), (fh if told else math.inf)
    return fl, fh, (gl if told else -math.inf), (gh if told else math.inf)


@exact_kernel(allocates=False, inline=True)
def meet_either(xl, xh, fl, fh, gl, gh):
    """Hull of the part of ``[xl, xh]`` on either of two arcs, in every turn."""
    fl, fh = meet_turns(xl, xh, fl, fh)
    gl, gh = meet_turns(xl, xh, gl, gh)
    return join(fl, fh, gl, gh)


@exact_kernel(allocates=False)
def contract_line(lo, hi, cl, ch, sl, sh):
    """``x cos a + y sin a = d`` in rows a, d, x, y; the rest is room to work in."""
    cosine_sine_arrays(lo[0], hi[0], cl, ch, sl, sh)
    for i in range(lo.shape[1]):
        pl, ph = multiply(cl[i], ch[i], lo[2, i], hi[2, i])
        ql, qh = multiply(sl[i], sh[i], lo[3, i], hi[3, i])
        a, b = add(pl, ph, ql, qh)
        dl, dh = meet(lo[1, i], hi[1, i], a, b)
        a, b = subtract(dl, dh, ql, qh)
        pl, ph = meet(pl, ph, a, b)
        a, b = subtract(dl, dh, pl, ph)
        ql, qh = meet(ql, qh, a, b)
        lo[1, i], hi[1, i] = dl, dh
        lo[2, i], hi[2, i] = divide_within(pl, ph, cl[i], ch[i], lo[2, i], hi[2, i])
        lo[3, i], hi[3, i] = divide_within(ql, qh, sl[i], sh[i], lo[3, i], hi[3, i])
    # In polar coordinates, r cos(a - b) = d.
    for i in range(lo.shape[1]):
        rl, rh = norm(lo[2, i], hi[2, i], lo[3, i], hi[3, i])
        bl, bh = arc(lo[3, i], hi[3, i], lo[2, i], hi[2, i])
        cl[i], ch[i], sl[i], sh[i] = around_arc(bl, bh, lo[1, i], hi[1, i], rl, rh)
    for i in range(lo.shape[1]):
        lo[0, i], hi[0, i] = meet_either(lo[0, i], hi[0, i], cl[i], ch[i], sl[i], sh[i])
    clear_empty(lo, hi)


@exact_kernel(allocates=False)
def contract_heading(lo, hi, cl, ch, sl, sh):
    """Heading of a sensor at t that sees a point (r, b) of the line (a, d): rows theta, t_x, t_y, r, b, a, d.

    ``r cos(theta + b - a) = d - t . (cos a, sin a)``, so that ``theta = a - b +- acos((d - t . n) / r)``.
    """
    cosine_sine_arrays(lo[5], hi[5], cl, ch, sl, sh)
    for i in range(lo.shape[1]):
        nl, nh = dot(cl[i], ch[i], sl[i], sh[i], lo[1, i], hi[1, i], lo[2, i], hi[2, i])
        nl, nh = subtract(lo[6, i], hi[6, i], nl, nh)
        bl, bh = subtract(lo[5, i], hi[5, i], lo[4, i], hi[4, i])
        cl[i], ch[i], sl[i], sh[i] = around_arc(bl, bh, nl, nh, lo[3, i], hi[3, i])
    for i in range(lo.shape[1]):
        lo[0, i], hi[0, i] = meet_either(lo[0, i], hi[0, i], cl[i], ch[i], sl[i], sh[i])
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
