"""Scan-to-map costs of planar scans with gradient and Gauss-Newton Hessian.

Models read flat rimmed tables and some numbers a level of the map:

====================  ===========  ==============  ==================================================
model                 primary      secondary       numbers
====================  ===========  ==============  ==================================================
``DECAY_RATE``        rates, 1/m   log rates       rate outside, least NLL, unused
``DISTANCE_FIELD``    distance, m  distance, m     farthest, sigma (m), Huber (sigma)
``POSTERIOR``         shapes       paths, m        prior shape, least NLL, prior path (m)
``END_POINT``         distance, m  distance, m     farthest, sigma (m), floor, log of the peak
====================  ===========  ==============  ==================================================

``POSTERIOR`` has a tertiary table besides, the log effective rates. The others have None there: which walk is compiled
is settled by that type, so that nobody waits for the posterior who does not use it.
"""

import math

from factorloc._jit import kernel
from factorloc.factors._interpolation_kernels import extended
from factorloc.factors._posterior_kernels import posterior_pass
from factorloc.mapping._forward_kernels import integrate, walk_columns
from factorloc.mapping._traversal_kernels import clip_ray

DECAY_RATE = 0
DISTANCE_FIELD = 1
POSTERIOR = 2
END_POINT = 3

LEAST_MARGIN = 0.05  # no ray gets more weight than at this distance from the least possible cost


@kernel(allocates=False)
def hybrid_nll(rates, log_rates, shape, outside, log_outside, p_x, p_y, v_x, v_y, length, inverse, want_gradient):
    """Hybrid negative log-likelihood of one ray: exact integral minus interpolated log rate at the end.

    Returns
    -------
    value : float
    g_x, g_y : float
        Derivative by the ray origin, 1/m.
    m_x, m_y : float
        Derivative by the ray direction (moment about the origin): ``sum t dS/do`` of the crossings plus ``length``
        times the end point's.
    """
    n_x, n_y = shape
    stride = n_y + 2
    g_x = 0.0
    g_y = 0.0
    m_x = 0.0
    m_y = 0.0
    t_in = 0.0
    t_out = length
    e_x = p_x + v_x * length
    e_y = p_y + v_y * length
    clipped = not (0.0 <= p_x < n_x and 0.0 <= p_y < n_y and 0.0 <= e_x < n_x and 0.0 <= e_y < n_y)
    if clipped:
        # Clip in the middle of the rim, whose rate is the one outside: every jump at the border is then walked across.
        t_in, t_out = clip_ray(p_x + 0.5, p_y + 0.5, v_x, v_y, length, n_x + 1, n_y + 1)
    if t_in < t_out:
        if want_gradient:
            value, jump_x, jump_y, moment_x, moment_y = walk_columns(
                rates, stride, p_x + 1.0, p_y + 1.0, v_x, v_y, t_in, t_out
            )
            if v_x != 0.0:
                g_x = jump_x / (v_x / inverse)
                m_x = moment_x / (v_x / inverse)
            if v_y != 0.0:
                g_y = jump_y / (v_y / inverse)
                m_y = moment_y / (v_y / inverse)
        else:
            value = integrate(rates, stride, p_x + 1.0, p_y + 1.0, v_x, v_y, t_in, t_out)
        value += outside * (length - (t_out - t_in))
    else:
        value = outside * length
    log_rate, f_x, f_y = extended(log_rates, shape, log_outside, e_x, e_y)
    f_x *= inverse
    f_y *= inverse
    return value - log_rate, g_x - f_x, g_y - f_y, m_x - length * f_x, m_y - length * f_y


@kernel(allocates=False)
def decay_ray(primary, secondary, numbers, log_outside, shape, p_x, p_y, d_x, d_y, length, inverse, want_gradient):
    """Hybrid NLL of one ray with the weight of its outer product: value, origin and direction derivatives, weight."""
    value, g_x, g_y, m_x, m_y = hybrid_nll(
        primary, secondary, shape, numbers[0], log_outside, p_x, p_y, d_x * inverse, d_y * inverse, length, inverse,
        want_gradient,
    )  # fmt: skip
    return value, g_x, g_y, m_x, m_y, 0.5 / max(value - numbers[1], LEAST_MARGIN)


@kernel(allocates=False)
def posterior_ray(shapes, paths, log_rates, numbers, shape, p_x, p_y, d_x, d_y, length, inverse):
    """Hybrid NLL of one ray under Gamma posteriors of the rates; returns as :func:`decay_ray`."""
    v_x = d_x * inverse
    v_y = d_y * inverse
    value, jump_x, jump_y, moment_x, moment_y = posterior_pass(
        shapes, paths, shape, numbers[0], numbers[2], p_x, p_y, v_x, v_y, length
    )
    log_outside = math.log(numbers[0] / (numbers[2] + 0.5 / inverse))
    log_rate, f_x, f_y = extended(log_rates, shape, log_outside, p_x + v_x * length, p_y + v_y * length)
    value -= log_rate
    g_x = -f_x * inverse
    g_y = -f_y * inverse
    m_x = length * g_x
    m_y = length * g_y
    if d_x != 0.0:
        g_x += jump_x / d_x
        m_x += moment_x / d_x
    if d_y != 0.0:
        g_y += jump_y / d_y
        m_y += moment_y / d_y
    return value, g_x, g_y, m_x, m_y, 0.5 / max(value - numbers[1], LEAST_MARGIN)


@kernel(allocates=False)
def huber_loss(residual, huber):
    """Huber's loss and its slope."""
    if residual < huber:
        return 0.5 * residual * residual, residual
    return huber * (residual - 0.5 * huber), huber


@kernel(allocates=False)
def mixture_loss(residual, floor, log_peak):
    """Loss ``-log(peak (exp(-r^2 / 2) + floor))`` of a normal error over a floor, and its slope."""
    near = math.exp(-0.5 * residual * residual)
    return -log_peak - math.log(near + floor), residual * near / (near + floor)


@kernel(allocates=False)
def field_ray(model, field, numbers, shape, p_x, p_y, d_x, d_y, length, inverse):
    """Robust cost of one end point's distance; returns as :func:`decay_ray`."""
    e_x = p_x + d_x * length * inverse
    e_y = p_y + d_y * length * inverse
    distance, f_x, f_y = extended(field, shape, numbers[0], e_x, e_y)
    residual = distance / numbers[1]
    if model == END_POINT:
        value, slope = mixture_loss(residual, numbers[2], numbers[3])
    else:
        value, slope = huber_loss(residual, numbers[2])
    # Gauss-Newton on the residual: H = w f f' with w = slope / residual, in terms of g = slope f.
    g_x = slope * f_x * inverse / numbers[1]
    g_y = slope * f_y * inverse / numbers[1]
    weight = 1.0 / (slope * residual) if slope * residual > 1e-18 else 0.0
    return value, g_x, g_y, length * g_x, length * g_y, weight


@kernel(allocates=False)
def scan_cost(
    model, pose, origins, directions, lengths, first, last, primary, secondary, tertiary, numbers, shape, low,
    resolution, information, want_gradient, gradient, hessian,
):  # fmt: skip
    """Sum a model's costs over the rays ``first:last`` of one scan; see :func:`scan_batch`."""
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    inverse = 1.0 / resolution
    log_outside = math.log(numbers[0]) if model == DECAY_RATE else 0.0
    cost = 0.0
    # Gradient and Hessian by world coordinates (x, y, theta); in registers, as nothing proves arrays apart.
    g_0 = g_1 = g_2 = 0.0
    h_00 = h_01 = h_02 = h_11 = h_12 = h_22 = 0.0
    for k in range(first, last):
        # Ray origin relative to the body, and its direction, in the frame of the map.
        a_x = c * origins[k, 0] - s * origins[k, 1]
        a_y = s * origins[k, 0] + c * origins[k, 1]
        d_x = c * directions[k, 0] - s * directions[k, 1]
        d_y = s * directions[k, 0] + c * directions[k, 1]
        p_x = (pose[0] + a_x - low[0]) * inverse
        p_y = (pose[1] + a_y - low[1]) * inverse
        if tertiary is None:
            if model == DECAY_RATE:
                value, g_x, g_y, m_x, m_y, weight = decay_ray(
                    primary, secondary, numbers, log_outside, shape, p_x, p_y, d_x, d_y, lengths[k], inverse,
                    want_gradient,
                )  # fmt: skip
            else:
                value, g_x, g_y, m_x, m_y, weight = field_ray(
                    model, primary, numbers, shape, p_x, p_y, d_x, d_y, lengths[k], inverse
                )
        else:
            value, g_x, g_y, m_x, m_y, weight = posterior_ray(
                primary, secondary, tertiary, numbers, shape, p_x, p_y, d_x, d_y, lengths[k], inverse
            )
        cost += value
        if want_gradient:
            # Turning the body moves the origin by (-a_y, a_x) and the direction by (-d_y, d_x).
            g_t = a_x * g_y - a_y * g_x + d_x * m_y - d_y * m_x
            g_0 += g_x
            g_1 += g_y
            g_2 += g_t
            h_00 += weight * g_x * g_x
            h_01 += weight * g_x * g_y
            h_02 += weight * g_x * g_t
            h_11 += weight * g_y * g_y
            h_12 += weight * g_y * g_t
            h_22 += weight * g_t * g_t
    # Into the tangent space of the body.
    gradient[0] = information * (c * g_0 + s * g_1)
    gradient[1] = information * (-s * g_0 + c * g_1)
    gradient[2] = information * g_2
    hessian[0, 0] = information * (c * c * h_00 + 2.0 * c * s * h_01 + s * s * h_11)
    hessian[1, 1] = information * (s * s * h_00 - 2.0 * c * s * h_01 + c * c * h_11)
    hessian[2, 2] = information * h_22
    hessian[0, 1] = hessian[1, 0] = information * (c * s * (h_11 - h_00) + (c * c - s * s) * h_01)
    hessian[0, 2] = hessian[2, 0] = information * (c * h_02 + s * h_12)
    hessian[1, 2] = hessian[2, 1] = information * (-s * h_02 + c * h_12)
    return information * cost


@kernel(allocates=False)
def scan_batch(
    model, poses, scan_of_pose, origins, directions, lengths, offsets, primary, secondary, tertiary, numbers, shape,
    low, resolution, information, want_gradient, costs, gradients, hessians,
):  # fmt: skip
    """Cost, gradient and Hessian of many scans at many poses.

    Parameters
    ----------
    model : int
        One of those above.
    poses : (N, 3) float64
        ``T_map_body``.
    scan_of_pose : (N,) int64
        The scan each pose is tried for.
    origins, directions : (M, 2) float64
        Rays in body frames.
    lengths : (M,) float64
    offsets : (S + 1,) int64
    primary, secondary : flat rimmed float64
        One level of the map.
    tertiary : None or flat rimmed float64
        A third table of it.
    numbers : (3,) or (4,) float64
        Its numbers.
    shape : (int, int)
        Cells without rim.
    low : (2,) float64
    resolution : float
    information : float
        Factor of all costs.
    want_gradient : bool
    costs : (N,), gradients : (N, 3), hessians : (N, 3, 3)
        Written; derivatives in the tangent space of the body.
    """
    for n in range(poses.shape[0]):
        k = scan_of_pose[n]
        costs[n] = scan_cost(
            model, poses[n], origins, directions, lengths, offsets[k], offsets[k + 1], primary, secondary, tertiary,
            numbers, shape, low, resolution, information, want_gradient, gradients[n], hessians[n],
        )  # fmt: skip
