"""Sine, cosine and the angles of vectors with proven bounds, branch-free where loops must vectorize.

``u = 2^-53``; relative errors are first bounded to first order in ``u``, and the margins leave room for the rest.

Reduction. ``k`` is the whole number nearest ``2x/pi`` up to rounding, ``|k| < 2^20`` for ``|x| <= HUGE``. The first
part of ``pi/2`` has 33 bits, so ``k FIRST`` is exact, and so is ``x - k FIRST``: it is below 1 and a multiple of
``2^-53`` for ``|x| >= 0.5``, and ``k = 0`` below. Subtracting ``k SECOND`` (below 7e-5, rounded once, as is ``SECOND``)
leaves ``|r| <= pi/4 + 2^-31`` with an error of at most ``u/2 (1 + 3e-4)``, and none for ``k = 0``.

Series. Alternating with falling terms, they err by less than the first term left out: ``r^19/19! <= 1e-3 u |r|`` and
``r^18/18! <= 0.02 u``. The sine ``r + r z q`` with ``z = r^2``, ``|z q| <= 0.103``, errs by ``5u`` in its second term
(two products and ``z``, ``q`` by ``2u``) and ``u`` in the sum: ``(0.52/0.9 + 1) u |sin r|``, below ``1.7u``. The cosine
``1 - h``, ``h = z/2 - z^2 q <= 0.293`` errs by ``0.31u`` (``z``), ``0.13u`` (second term), ``0.3u`` (difference),
``0.5u`` (last sum) and ``0.02u``: below ``1.3u``, at most ``1.8u |cos r|``. With the subtraction of the margin itself,
``2.8u`` of the value and ``0.51u`` for the reduction are due; ``4u`` of the value and ``u`` where ``k != 0`` are taken.

Arc tangent of ``t`` in [0, 1]: ``atan(c) + atan(d)``, ``c = j/8`` the nearest eighth, ``d = (t - c)/(1 + t c)``. The
numerator is exact, ``|d| <= 1/16``, the series to ``d^13`` leaves out ``0.01u |d|``. Relative to the result, rounding
``t`` costs ``u``, denominator and quotient ``2.5u |d| / atan t <= 2.5u``, the series ``0.1u``, the table ``u``, the
sum ``u``: below ``5.6u``. From that, ``pi/2 - a`` and ``pi - a`` err by ``4.4u`` (``a <= pi/4``), the constants by
``1.2u`` and the sums by ``u`` of the result, of at least ``pi/4``: below ``10u`` of the result. ``16u`` are taken. The
arc cosine is twice the angle of ``(sqrt(1+x), sqrt(1-x))``, whose ratio errs by another ``3u``.
"""

import math

import numpy as np

from factorloc._jit import exact_kernel
from factorloc.intervals._arithmetic_kernels import ETA, UNIT, join, lower, meet, subtract, upper

HUGE = 2.0**20  # rad; sines and cosines of more are not told from [-1, 1]
FIRST = float.fromhex("0x1.921fb544p+0")
SECOND = float.fromhex("0x1.0b4611a626331p-34")
TURNS = 0.5 / math.pi
GUARD = 2.0**-30  # turns; an extremum so near is taken as met, which raises the bound by less than u/2

PI_LOWER = float.fromhex("0x1.921fb54442d18p+1")
PI_UPPER = float.fromhex("0x1.921fb54442d19p+1")
TURN_LOWER, TURN_UPPER = 2.0 * PI_LOWER, 2.0 * PI_UPPER

ANGLE_MARGIN = 16.0 * UNIT
E1, E2, E3, E4, E5, E6, E7, E8 = (math.atan(n / 8) for n in range(1, 9))

_S = [(-1.0) ** n / math.factorial(2 * n + 1) for n in range(9)]
_C = [(-1.0) ** n / math.factorial(2 * n) for n in range(9)]
S1, S2, S3, S4, S5, S6, S7, S8 = _S[1:]
C2, C3, C4, C5, C6, C7, C8 = _C[2:]


@exact_kernel(allocates=False)
def quarter_turns(x):
    """The whole number of quarter turns nearest to ``x``, and the rest."""
    k = np.floor(x * (4.0 * TURNS) + 0.5)
    return k, (x - k * FIRST) - k * SECOND


@exact_kernel(allocates=False)
def sine_series(r, z):
    """Sine of a rest ``r`` with square ``z``."""
    return r + r * (z * (S1 + z * (S2 + z * (S3 + z * (S4 + z * (S5 + z * (S6 + z * (S7 + z * S8))))))))


@exact_kernel(allocates=False)
def cosine_series(z):
    """Cosine of a rest with square ``z``."""
    return 1.0 - (0.5 * z - z * z * (C2 + z * (C3 + z * (C4 + z * (C5 + z * (C6 + z * (C7 + z * C8)))))))


@exact_kernel(allocates=False)
def signed_cosine(k, sine, cosine):
    """Cosine after ``k`` quarter turns, without integers, so that lanes stay full."""
    half, shifted = 0.5 * k, 0.25 * k + 0.25
    odd = half != np.floor(half)
    return (sine if odd else cosine) * (-1.0 if shifted - np.floor(shifted) >= 0.5 else 1.0)


@exact_kernel(allocates=False)
def margin(k, value):
    """Bound of the error of a sine or cosine ``value`` after ``k`` quarter turns."""
    return 4.0 * UNIT * abs(value) + (ETA if k == 0.0 else UNIT)


@exact_kernel(allocates=False)
def crosses(a, b):
    """Whether a whole number of turns lies between two."""
    return np.floor(a) != np.floor(b)


@exact_kernel(allocates=False)
def cosine_sine_arrays(lo, hi, cl, ch, sl, sh):
    """Write bounds of cosine and sine of an array; ``[-1, 1]`` beyond ``HUGE``.

    The one place where they are computed: the parts are small enough to be inlined, so that the loop vectorizes.
    """
    for i in range(lo.size):
        far = (lo[i] < -HUGE) | (hi[i] > HUGE)
        low, high = (0.0 if far else lo[i]), (7.0 if far else hi[i])
        k1, r1 = quarter_turns(low)
        k2, r2 = quarter_turns(high)
        s1, c1 = sine_series(r1, r1 * r1), cosine_series(r1 * r1)
        s2, c2 = sine_series(r2, r2 * r2), cosine_series(r2 * r2)
        p, q = signed_cosine(k1, s1, c1), signed_cosine(k2, s2, c2)
        # The sine is the cosine one quarter turn earlier, where the series change places.
        r, s = signed_cosine(k1 - 1.0, s1, c1), signed_cosine(k2 - 1.0, s2, c2)
        mp, mq, mr, ms = margin(k1, p), margin(k2, q), margin(k1, r), margin(k2, s)
        least_c, most_c = (p - mp if p - mp < q - mq else q - mq), (p + mp if p + mp > q + mq else q + mq)
        least_s, most_s = (r - mr if r - mr < s - ms else s - ms), (r + mr if r + mr > s + ms else s + ms)
        # An extremum lies inside where the whole turns before the two ends differ.
        a, b = low * TURNS - GUARD, high * TURNS + GUARD
        least_c = -1.0 if crosses(a + 0.5, b + 0.5) | (least_c < -1.0) else least_c
        most_c = 1.0 if crosses(a, b) | (most_c > 1.0) else most_c
        least_s = -1.0 if crosses(a + 0.25, b + 0.25) | (least_s < -1.0) else least_s
        most_s = 1.0 if crosses(a - 0.25, b - 0.25) | (most_s > 1.0) else most_s
        # The sum is NaN for the empty set alone: far ends were replaced.
        empty = low + high
        cl[i] = least_c if empty == empty else empty
        ch[i] = most_c if empty == empty else empty
        sl[i] = least_s if empty == empty else empty
        sh[i] = most_s if empty == empty else empty


@exact_kernel(allocates=False, inline=True)
def eighth(j):
    """``atan(j / 8)`` of a whole number from 0 to 8; chosen, not looked up, so that lanes stay full."""
    low = (E1 if j == 1.0 else 0.0) if j < 2.0 else (E3 if j == 3.0 else E2)
    high = (E5 if j == 5.0 else E4) if j < 6.0 else (E7 if j == 7.0 else E6)
    return E8 if j == 8.0 else (low if j < 4.0 else high)


@exact_kernel(allocates=False, inline=True)
def angle(y, x):
    """Angle of a vector with an error below ``ANGLE_MARGIN`` of it; 0 for the zero vector."""
    ax, ay = abs(x), abs(y)
    steep = ay > ax
    long, short = (ay if steep else ax), (ax if steep else ay)
    t = 0.0 if (long == 0.0) | (long == math.inf) else short / long
    j = np.floor(8.0 * t + 0.5)
    c = 0.125 * j
    d = (t - c) / (1.0 + t * c)
    z = d * d
    tail = z * (-1.0 / 3.0 + z * (0.2 + z * (-1.0 / 7.0 + z * (1.0 / 9.0 + z * (-1.0 / 11.0 + z * (1.0 / 13.0))))))
    a = eighth(j) + (d + d * tail)
    a = 0.5 * math.pi - a if steep else a
    a = math.pi - a if x < 0.0 else a
    return -a if y < 0.0 else a


@exact_kernel(allocates=False, inline=True)
def arc(yl, yh, xl, xh):
    """Angles of the vectors of a box, as one arc from ``lo`` in [-pi, pi] up to ``hi``, perhaps beyond pi.

    The zero vector has no angle and adds none; a box around it has all angles. Without a branch: the arc reaches from
    one corner to another, and these are chosen.
    """
    up, down, right, left = yl >= 0.0, yh <= 0.0, xl >= 0.0, xh <= 0.0
    # A box that touches an axis from above is above; below is what is not, and so on to the left.
    down, right = down & (not up), right & (not (up | down))
    left = left & (not (up | down | right))
    first_x = xh if up | left else xl
    first_y = yl if (up & (xh > 0.0)) | (down & (xl >= 0.0)) | right else yh
    last_x = xh if down | left else xl
    last_y = yh if (up & (xl >= 0.0)) | (down & (xh > 0.0)) | right else yl
    lo, hi = angle(first_y, first_x), angle(last_y, last_x)
    lo, hi = lo - (ANGLE_MARGIN * abs(lo) + ETA), hi + (ANGLE_MARGIN * abs(hi) + ETA)
    lo = 0.0 if up & (lo < 0.0) else lo
    hi = 0.0 if down & (hi > 0.0) else hi
    # The angle of a vector along -x is pi, here -pi.
    lo = -PI_UPPER if down & (yh == 0.0) & (xl < 0.0) else lo
    hi = upper(hi + TURN_UPPER) if left else hi
    around = not (up | down | right | left)
    lo, hi = (-PI_UPPER if around else lo), (PI_UPPER if around else hi)
    empty = (yl != yl) | (xl != xl)
    return (math.nan if empty else lo), (math.nan if empty else hi)


@exact_kernel(allocates=False, inline=True)
def principal_arc(yl, yh, xl, xh):
    """Hull of the angles of a box in (-pi, pi]; all of them if the zero vector is in it, whatever its angle is."""
    lo, hi = arc(yl, yh, xl, xh)
    # Along -x the angle is pi, never -pi.
    beyond = (yl < 0.0) & (yh >= 0.0) & (xl < 0.0)
    origin = (xl <= 0.0) & (xh >= 0.0) & (yl <= 0.0) & (yh >= 0.0)
    every = (lo == lo) & (beyond | origin)
    lo, hi = (-PI_UPPER if lo < -PI_UPPER else lo), (PI_UPPER if hi > PI_UPPER else hi)
    return (-PI_UPPER if every else lo), (PI_UPPER if every else hi)


@exact_kernel(allocates=False, inline=True)
def arccosine(lo, hi):
    """``acos`` over the part of the interval in [-1, 1]."""
    there = (lo <= 1.0) & (hi >= -1.0)
    lo, hi = (lo if lo > -1.0 else -1.0), (hi if hi < 1.0 else 1.0)
    least = 2.0 * angle(math.sqrt(1.0 - hi), math.sqrt(1.0 + hi))
    most = 2.0 * angle(math.sqrt(1.0 - lo), math.sqrt(1.0 + lo))
    least, most = least - (ANGLE_MARGIN * least + ETA), most + (ANGLE_MARGIN * most + ETA)
    least, most = (least if least > 0.0 else 0.0), (most if most < PI_UPPER else PI_UPPER)
    return (least if there else math.nan), (most if there else math.nan)


@exact_kernel(allocates=False, inline=True)
def turned(lo, hi, turns):
    """An arc moved by whole turns."""
    less, more = (TURN_UPPER if turns < 0.0 else TURN_LOWER), (TURN_LOWER if turns < 0.0 else TURN_UPPER)
    least, most = lower(lo + lower(turns * less)), upper(hi + upper(turns * more))
    return (lo if turns == 0.0 else least), (hi if turns == 0.0 else most)


@exact_kernel(allocates=False, inline=True)
def meet_turns(xl, xh, lo, hi):
    """Hull of the part of ``[xl, xh]`` on an arc, repeated every whole turn.

    The copy that ends first at or after ``xl`` is found by rounded division, and moved on if it ends before; the last
    copy alike. A copy skipped by rounding is excluded by the guard, one too many costs nothing.
    """
    turns = np.ceil((xl - hi) * TURNS - GUARD)
    _, end = turned(lo, hi, turns)
    al, _ = turned(lo, hi, turns + (1.0 if end < xl else 0.0))
    turns = np.floor((xh - lo) * TURNS + GUARD)
    begin, _ = turned(lo, hi, turns)
    _, bh = turned(lo, hi, turns - (1.0 if begin > xh else 0.0))
    al, bh = meet(xl, xh, al, bh)
    told = (xl >= -HUGE) & (xh <= HUGE) & (lo >= -HUGE) & (hi <= HUGE)
    al, bh = (al if told else xl), (bh if told else xh)
    empty = (xl != xl) | (lo != lo)
    return (math.nan if empty else al), (math.nan if empty else bh)


@exact_kernel(allocates=False, inline=True)
def cosine_within(yl, yh, xl, xh):
    """Hull of the ``x`` in ``[xl, xh]`` with ``cos x`` in ``y``."""
    lo, hi = arccosine(yl, yh)
    al, ah = meet_turns(xl, xh, lo, hi)
    bl, bh = meet_turns(xl, xh, -hi, -lo)
    return join(al, ah, bl, bh)


@exact_kernel(allocates=False, inline=True)
def sine_within(yl, yh, xl, xh):
    """Hull of the ``x`` in ``[xl, xh]`` with ``sin x`` in ``y``: a cosine a quarter turn later."""
    lo, hi = subtract(xl, xh, 0.5 * PI_LOWER, 0.5 * PI_UPPER)
    lo, hi = cosine_within(yl, yh, lo, hi)
    return meet(xl, xh, lower(lo + 0.5 * PI_LOWER), upper(hi + 0.5 * PI_UPPER))
