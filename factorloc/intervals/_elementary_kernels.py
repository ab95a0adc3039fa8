"""Loops of trigonometric functions over arrays of intervals."""

from factorloc._jit import exact_kernel
from factorloc.intervals._arithmetic_kernels import ETA, UNIT, add, multiply, subtract
from factorloc.intervals._trigonometric_kernels import arccosine, cosine_sine_arrays, principal_arc

MODERATE = 2.0**900


@exact_kernel(allocates=False)
def arccosine_arrays(al, ah, lo, hi):
    """Write ``acos(a)`` of an array."""
    for i in range(al.size):
        lo[i], hi[i] = arccosine(al[i], ah[i])


@exact_kernel(allocates=False)
def angle_arrays(yl, yh, xl, xh, lo, hi):
    """Write the hull of the angles in (-pi, pi] of an array of boxes."""
    for i in range(xl.size):
        lo[i], hi[i] = principal_arc(yl[i], yh[i], xl[i], xh[i])


@exact_kernel(allocates=False)
def sector_arrays(rl, rh, pl, ph, xl, xh, yl, yh):
    """Write the boxes around sectors of ranges ``r`` and bearings ``p``."""
    cosine_sine_arrays(pl, ph, xl, xh, yl, yh)
    for i in range(rl.size):
        xl[i], xh[i] = multiply(rl[i], rh[i], xl[i], xh[i])
        yl[i], yh[i] = multiply(rl[i], rh[i], yl[i], yh[i])


@exact_kernel(allocates=False)
def largest(lo, hi):
    """Largest magnitude of two bounds; not a number for the empty set."""
    return abs(lo) if abs(lo) > abs(hi) else abs(hi)


@exact_kernel(allocates=False)
def finite_product(al, ah, bl, bh):
    """Least and greatest product of finite bounds, rounded to nearest."""
    p, q, r, s = al * bl, al * bh, ah * bl, ah * bh
    least, less = (p if p < q else q), (r if r < s else s)
    most, more = (p if p > q else q), (r if r > s else s)
    return (least if least < less else less), (most if most > more else more)


@exact_kernel(allocates=False)
def move_arrays(xl, xh, yl, yh, cl, ch, sl, sh, al, ah, bl, bh, ul, uh, vl, vh):
    """Write ``u = c x - s y + a, v = s x + c y + b`` of arrays of x and y, moved by one motion; c and s in [-1, 1].

    A first loop has no branch and shifts a bound once: its two products, two sums and the shift itself err by at most
    ``u (1 + 4u)`` each of ``M = max |x| + max |y| + max |a|``, the products by that together: ``4u M (1 + 4u)`` in all.
    ``5u`` is taken, and ``ETA`` for products that underflow. Operands so large that a sum might overflow, infinite or
    empty ones are left to a second loop, operation by operation.
    """
    shift_u, shift_v = 6.0 * UNIT * max(abs(al), abs(ah)) + ETA, 6.0 * UNIT * max(abs(bl), abs(bh)) + ETA
    usual = shift_u < MODERATE and shift_v < MODERATE
    careful = 0
    for i in range(xl.size):
        p, q = finite_product(xl[i], xh[i], cl, ch)
        r, s = finite_product(yl[i], yh[i], sl, sh)
        reach = largest(xl[i], xh[i]) + largest(yl[i], yh[i])
        shift = 5.0 * UNIT * reach
        ul[i], uh[i] = (p - s + al) - (shift + shift_u), (q - r + ah) + (shift + shift_u)
        p, q = finite_product(xl[i], xh[i], sl, sh)
        r, s = finite_product(yl[i], yh[i], cl, ch)
        vl[i], vh[i] = (p + r + bl) - (shift + shift_v), (q + s + bh) + (shift + shift_v)
        careful += 0 if reach < MODERATE else 1
    if usual and careful == 0:
        return
    for i in range(xl.size):
        if usual and largest(xl[i], xh[i]) + largest(yl[i], yh[i]) < MODERATE:
            continue
        p, q = multiply(xl[i], xh[i], cl, ch)
        r, s = multiply(yl[i], yh[i], sl, sh)
        p, q = subtract(p, q, r, s)
        ul[i], uh[i] = add(p, q, al, ah)
        p, q = multiply(xl[i], xh[i], sl, sh)
        r, s = multiply(yl[i], yh[i], cl, ch)
        p, q = add(p, q, r, s)
        vl[i], vh[i] = add(p, q, bl, bh)
