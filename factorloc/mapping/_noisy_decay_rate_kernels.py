"""Likelihoods of rays whose range is measured with noise, under constant decay rates (what thesis, 7.7, leaves open).

A ray is reflected at t with density ``rate(t) S(t)``, where ``S(t) = exp(-integral of the rate to t)``, and measured at
``z = t + noise``, ``noise ~ N(0, sigma^2)``. With ``phi`` the density of the noise,

    p(z)     = integral of rate(t) S(t) phi(z - t)  over t > 0,
    P(z > m) = integral of S(t) phi(m - t)          over all t, with S = 1 before the sensor,
    P(z < m) = integral of (1 - S(t)) phi(m - t)    over t > 0;

the last two are the first one's integral over z, by parts. In a cell from ``a`` to ``b`` all three are made of

    pass = integral from a to b of exp(-rate (t - a)) phi(z - t) dt,

a difference of exponentially modified Gaussians. In units of sigma, ``alpha = (a - z) / sigma``, ``beta`` alike,
``kappa = rate sigma``, ``u = alpha + kappa``, ``v = beta + kappa``, it is (complete the square)

    exp((u^2 - alpha^2) / 2) (Phi(v) - Phi(u)).

Where u > 0 the exponent may be huge and the difference tiny: ``exp(x^2) erfc(x)`` holds both. Where the integrand
hardly changes along the cell the difference cancels, and five points of Gauss and Legendre are exact instead. The noise
ends at 8 sigma: what lies farther has a weight of 1e-15.
"""

import math

import numpy as np

from factorloc._jit import kernel
from factorloc.mapping._spatial_forward_kernels import integrate_spatial
from factorloc.mapping._spatial_traversal_kernels import address, clip_axis

_REACH = 8.0  # sigmas
_STOPPED = 80.0  # integral of rates after which rays that are left weigh nothing against those stopped before
_HALF = math.sqrt(0.5)
_PEAK = 1.0 / math.sqrt(2.0 * math.pi)
_NODE_1 = math.sqrt(5.0 - 2.0 * math.sqrt(10.0 / 7.0)) / 3.0
_NODE_2 = math.sqrt(5.0 + 2.0 * math.sqrt(10.0 / 7.0)) / 3.0
_WEIGHT_0 = 128.0 / 225.0
_WEIGHT_1 = (322.0 + 13.0 * math.sqrt(70.0)) / 900.0
_WEIGHT_2 = (322.0 - 13.0 * math.sqrt(70.0)) / 900.0


@kernel(allocates=False)
def scaled_erfc(x):
    """``exp(x^2) erfc(x)`` for x >= 0; a continued fraction where erfc runs out of numbers."""
    if x < 5.0:
        return math.exp(x * x) * math.erfc(x)
    tail = x
    for k in range(24, 0, -1):
        tail = x + 0.5 * k / tail
    return 1.0 / (math.sqrt(math.pi) * tail)


@kernel(allocates=False)
def smooth_pass(alpha, beta, kappa):
    """Integral from alpha to beta of ``exp(-kappa (x - alpha))`` times the standard normal density."""
    width = beta - alpha
    u = alpha + kappa
    v = beta + kappa
    if width * max(max(abs(u), abs(v)), 1.0) < 0.5:
        half = 0.5 * width
        total = 0.0
        for weight, node in (
            (_WEIGHT_2, -_NODE_2),
            (_WEIGHT_1, -_NODE_1),
            (_WEIGHT_0, 0.0),
            (_WEIGHT_1, _NODE_1),
            (_WEIGHT_2, _NODE_2),
        ):
            way = half * (1.0 + node)
            total += weight * math.exp(-kappa * way - 0.5 * (alpha + way) ** 2)
        return _PEAK * half * total
    if u >= 0.0:
        at_end = math.exp(-kappa * width - 0.5 * beta * beta)
        return 0.5 * (math.exp(-0.5 * alpha * alpha) * scaled_erfc(u * _HALF) - at_end * scaled_erfc(v * _HALF))
    if v <= 0.0:
        at_end = math.exp(-kappa * width - 0.5 * beta * beta)
        return 0.5 * (at_end * scaled_erfc(-v * _HALF) - math.exp(-0.5 * alpha * alpha) * scaled_erfc(-u * _HALF))
    return 0.5 * math.exp(0.5 * (u - alpha) * (u + alpha)) * (math.erf(v * _HALF) - math.erf(u * _HALF))


@kernel(allocates=False)
def smooth_loss(alpha, beta, kappa):
    """Integral from alpha to beta of ``1 - exp(-kappa (x - alpha))`` times the standard normal density."""
    width = beta - alpha
    if kappa * width >= 1.0:
        return smooth_pass(alpha, beta, 0.0) - smooth_pass(alpha, beta, kappa)
    # A difference would lose a small chance of reflection.
    pieces = int(4.0 * width) + 1
    half = 0.5 * width / pieces
    total = 0.0
    for piece in range(pieces):
        for weight, node in (
            (_WEIGHT_2, -_NODE_2),
            (_WEIGHT_1, -_NODE_1),
            (_WEIGHT_0, 0.0),
            (_WEIGHT_1, _NODE_1),
            (_WEIGHT_2, _NODE_2),
        ):
            way = half * (2 * piece + 1.0 + node)
            total -= weight * math.expm1(-kappa * way) * math.exp(-0.5 * (alpha + way) ** 2)
    return _PEAK * half * total


@kernel(allocates=False)
def _piece(status, a, b, rate, passed, z, sigma):
    """What a piece of constant rate adds to p(z), P(z < m) or P(z > m); ``passed`` is the integral of rates before."""
    alpha = (a - z) / sigma
    beta = (b - z) / sigma
    kappa = rate * sigma
    if status == 0:
        return rate * math.exp(-passed) * smooth_pass(alpha, beta, kappa) if rate > 0.0 else 0.0
    if status == 2:
        return math.exp(-passed) * smooth_pass(alpha, beta, kappa)
    total = math.exp(-passed) * smooth_loss(alpha, beta, kappa) if rate > 0.0 else 0.0
    return total - math.expm1(-passed) * smooth_pass(alpha, beta, 0.0)


@kernel(allocates=False)
def noisy_log_likelihoods(
    directory, rates, strides, rim, shape, outside, low, resolution, pose, origins, directions, lengths, status, limits,
    sigma, log_true, false_density, out,
):  # fmt: skip
    """Log-likelihood of each ray: noise and false detections.

    Parameters
    ----------
    directory, rates, strides, rim, shape, outside, low, resolution
        As :class:`factorloc.mapping.cell_layout.CellLayout`.
    pose : (4, 4) float64
        T_map_body.
    origins, directions : (N, 3) float64
        Rays in the body frame.
    lengths : (N,) float64
    status : (N,) uint8
        0 return, 1 below minimum, 2 no return.
    limits : (2,) float64
        Minimum and maximum range, m.
    sigma : float
        Standard deviation of the range, m.
    log_true, false_density : float
        Logarithm of the share of true measurements; density of the others, 1/m.
    out : (N,) float64
        Written.
    """
    n_x, n_y, n_z = shape
    inverse = 1.0 / resolution
    for k in range(lengths.shape[0]):
        x, y, z = origins[k, 0], origins[k, 1], origins[k, 2]
        p_x = (pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3] - low[0]) * inverse
        p_y = (pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3] - low[1]) * inverse
        p_z = (pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3] - low[2]) * inverse
        x, y, z = directions[k, 0], directions[k, 1], directions[k, 2]
        v_x = (pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z) * inverse
        v_y = (pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z) * inverse
        v_z = (pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z) * inverse
        measured = lengths[k]
        if status[k] == 1:
            measured = limits[0]
        elif status[k] == 2:
            measured = limits[1]
        first = max(measured - _REACH * sigma, 0.0)
        last = measured + _REACH * sigma

        # How many rays come to where the noise begins.
        t_in, t_out = clip_axis(p_x, v_x, float(n_x), 0.0, first)
        t_in, t_out = clip_axis(p_y, v_y, float(n_y), t_in, t_out)
        t_in, t_out = clip_axis(p_z, v_z, float(n_z), t_in, t_out)
        before = outside * first
        if t_in < t_out:
            before = outside * (first - (t_out - t_in)) + integrate_spatial(
                directory, rates, strides, p_x + rim, p_y + rim, p_z + rim, v_x, v_y, v_z, t_in, t_out
            )
        # Densities and survivals are taken as multiples of that, lest they vanish behind a wall.
        passed = before if status[k] == 1 else 0.0
        scale = 0.0 if status[k] == 1 else before
        total = 0.0
        if status[k] == 2 and first == 0.0:
            total = 0.5 * math.erfc(measured / sigma * _HALF)

        t_in, t_out = clip_axis(p_x, v_x, float(n_x), first, last)
        t_in, t_out = clip_axis(p_y, v_y, float(n_y), t_in, t_out)
        t_in, t_out = clip_axis(p_z, v_z, float(n_z), t_in, t_out)
        t = first
        if t_in < t_out:
            if t_in > t:
                total += _piece(status[k], t, t_in, outside, passed, measured, sigma)
                passed += outside * (t_in - t)
                t = t_in
            i_x = min(max(math.floor(p_x + v_x * t_in), 0), n_x - 1)
            i_y = min(max(math.floor(p_y + v_y * t_in), 0), n_y - 1)
            i_z = min(max(math.floor(p_z + v_z * t_in), 0), n_z - 1)
            e_x = min(max(math.floor(p_x + v_x * t_out), 0), n_x - 1)
            e_y = min(max(math.floor(p_y + v_y * t_out), 0), n_y - 1)
            e_z = min(max(math.floor(p_z + v_z * t_out), 0), n_z - 1)
            step_x = 1 if v_x > 0.0 else -1
            step_y = 1 if v_y > 0.0 else -1
            step_z = 1 if v_z > 0.0 else -1
            for left in range(abs(e_x - i_x) + abs(e_y - i_y) + abs(e_z - i_z), -1, -1):
                # A ray along a plane may cross it by its direction and not by its end, which is rounded; the end
                # decides.
                t_x = ((i_x + 1.0 if step_x > 0 else float(i_x)) - p_x) / v_x if i_x != e_x else math.inf
                t_y = ((i_y + 1.0 if step_y > 0 else float(i_y)) - p_y) / v_y if i_y != e_y else math.inf
                t_z = ((i_z + 1.0 if step_z > 0 else float(i_z)) - p_z) / v_z if i_z != e_z else math.inf
                t_next = t_out if left == 0 else max(min(min(min(t_x, t_y), t_z), t_out), t)
                if t_next > t:
                    rate = np.float64(rates[address(i_x, i_y, i_z, strides[0], strides[1], directory)])
                    total += _piece(status[k], t, t_next, rate, passed, measured, sigma)
                    passed += rate * (t_next - t)
                    t = t_next
                if passed > _STOPPED and status[k] != 1:
                    break
                if t_x < t_y and t_x < t_z:
                    i_x += step_x
                elif t_y < t_z:
                    i_y += step_y
                else:
                    i_z += step_z
        if last > t and (passed < _STOPPED or status[k] == 1):
            total += _piece(status[k], t, last, outside, passed, measured, sigma)

        found = log_true - scale + math.log(total) if total > 0.0 else -math.inf
        if status[k] == 0 and false_density > 0.0:
            other = math.log(false_density)
            found = max(found, other) + math.log1p(math.exp(-abs(found - other)))
        out[k] = found
