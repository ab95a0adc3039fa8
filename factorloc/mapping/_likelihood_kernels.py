"""Log-likelihoods of planar scans at many poses, under known decay rates and under Gamma posteriors of them.

Rays come in the frame of the body and are moved inside the kernel. Those out of range have the limit as their length.
"""

import math

from factorloc._jit import kernel
from factorloc.mapping._forward_kernels import integrate
from factorloc.mapping._traversal_kernels import clip_ray


@kernel(allocates=False)
def log_outcome(status, log_pass, density):
    """Log-likelihood of what became of a ray (thesis, eq. 7.14 to 7.16).

    Parameters
    ----------
    status : int
        0 return, 1 below minimum, 2 no return.
    log_pass : float
        Log-probability that the ray reaches its length, never positive but by rounding.
    density : float
        Of a reflection there, for a ray that came so far, 1/m.
    """
    if status == 0:
        return math.log(density) + log_pass if density > 0.0 else -math.inf
    if status == 2:
        return log_pass
    return math.log(-math.expm1(log_pass)) if log_pass < 0.0 else -math.inf


@kernel(allocates=False, inline=True)
def log_kept(a, r, b):
    """Log-probability ``-a log(1 + r / b)`` that a cell with posterior ``Gamma(a, b)`` lets a path ``r`` pass."""
    if r + r < b:
        # log(1 + x) = 2 artanh(x / (2 + x)), a short series where rays have gone further before, as in most cells.
        s = r / (b + b + r)
        u = s * s
        even = 1 / 5 + u * u * (1 / 9 + u * u * (1 / 13 + u * u * (1 / 17)))
        odd = 1 / 3 + u * u * (1 / 7 + u * u * (1 / 11 + u * u * (1 / 15 + u * u * (1 / 19))))
        return -2.0 * a * s * (1.0 + u * (odd + u * even))
    return -a * math.log1p(r / b)


@kernel(allocates=False)
def decay_log_likelihoods(
    rates, shape, outside, low, resolution, poses, group, origins, directions, lengths, status, each, sums
):  # fmt: skip
    """Log-likelihood of a scan at many poses under constant decay rates (thesis, eq. 7.13 to 7.16).

    A return has the density ``rate(end) exp(-integral)``, 1/m; a ray without return the probability
    ``exp(-integral to the maximum)``, one below the minimum ``1 - exp(-integral to the minimum)``. Integrals stop
    exactly at the limits, inside a cell, so that the three add up to one.

    Parameters
    ----------
    rates : (cells with rim,) float64
        Decay rates, 1/m.
    shape : (int, int)
        Cells without rim.
    outside : float
        Rate outside the grid.
    low : (2,) float64
    resolution : float
    poses : (P, 4) float64
        Poses of the body in the map: x, y, and cosine and sine of the heading.
    group : int
        Poses that a ray is weighed at one after the other, before the next ray.
    origins, directions : (N, 2) float64
        Rays in the frame of the body.
    lengths : (N,) float64
    status : (N,) uint8
        0 return, 1 below minimum, 2 no return.
    each : (P, N) or (0, N) float64
        Written: log-likelihoods of the rays, if wanted.
    sums : (P,) float64
        Written: their sums over each pose.
    """
    n_x, n_y = shape
    inverse = 1.0 / resolution
    for first in range(0, poses.shape[0], group):
        last = min(first + group, poses.shape[0])
        for i in range(first, last):
            sums[i] = 0.0
        for k in range(lengths.shape[0]):
            for i in range(first, last):
                x = poses[i, 0] - low[0]
                y = poses[i, 1] - low[1]
                c = poses[i, 2]
                s = poses[i, 3]
                p_x = (c * origins[k, 0] - s * origins[k, 1] + x) * inverse
                p_y = (s * origins[k, 0] + c * origins[k, 1] + y) * inverse
                v_x = (c * directions[k, 0] - s * directions[k, 1]) * inverse
                v_y = (s * directions[k, 0] + c * directions[k, 1]) * inverse
                length = lengths[k]
                e_x = math.floor(p_x + v_x * length)
                e_y = math.floor(p_y + v_y * length)
                ends_inside = 0 <= e_x < n_x and 0 <= e_y < n_y
                t_in = 0.0
                t_out = length
                if not (ends_inside and 0.0 <= p_x < n_x and 0.0 <= p_y < n_y):
                    t_in, t_out = clip_ray(p_x, p_y, v_x, v_y, length, n_x, n_y)
                if t_in < t_out:
                    integral = integrate(rates, n_y + 2, p_x + 1.0, p_y + 1.0, v_x, v_y, t_in, t_out)
                    integral += outside * (length - (t_out - t_in))
                else:
                    integral = outside * length
                rate = rates[(e_x + 1) * (n_y + 2) + e_y + 1] if ends_inside else outside
                value = log_outcome(status[k], -integral, rate)
                if each.shape[0] > 0:
                    each[i, k] = value
                sums[i] += value


@kernel(allocates=False)
def posterior_log_likelihoods(
    shapes, paths, shape, prior_shape, prior_path, low, resolution, poses, group, origins, directions, lengths, status,
    each, sums,
):  # fmt: skip
    """Log-likelihood of a scan at many poses under Gamma posteriors of the rates (thesis, l_dec of section 8.4.5).

    A cell with posterior ``Gamma(a, b)`` lets a path ``r`` pass with probability ``(b / (b + r))^a`` and ends it with
    density ``a / (b + r)`` besides. Arguments as :func:`decay_log_likelihoods`, with ``shapes`` (a = H + alpha) and
    ``paths`` (b = R + beta) instead of rates; what lies outside the grid is one cell with the prior.
    """
    inverse = 1.0 / resolution
    for first in range(0, poses.shape[0], group):
        last = min(first + group, poses.shape[0])
        for i in range(first, last):
            sums[i] = 0.0
        for k in range(lengths.shape[0]):
            for i in range(first, last):
                x = poses[i, 0] - low[0]
                y = poses[i, 1] - low[1]
                c = poses[i, 2]
                s = poses[i, 3]
                p_x = (c * origins[k, 0] - s * origins[k, 1] + x) * inverse
                p_y = (s * origins[k, 0] + c * origins[k, 1] + y) * inverse
                v_x = (c * directions[k, 0] - s * directions[k, 1]) * inverse
                v_y = (s * directions[k, 0] + c * directions[k, 1]) * inverse
                log_pass, density = _pass_posterior(
                    shapes, paths, shape, prior_shape, prior_path, p_x, p_y, v_x, v_y, lengths[k]
                )
                value = log_outcome(status[k], log_pass, density)
                if each.shape[0] > 0:
                    each[i, k] = value
                sums[i] += value


@kernel(allocates=False)
def _pass_posterior(shapes, paths, shape, prior_shape, prior_path, p_x, p_y, v_x, v_y, length):
    """Log-probability that a ray (in cells of the grid) gets so far, and the density of a reflection there."""
    n_x, n_y = shape
    width = n_y + 2
    t_in, t_out = clip_ray(p_x, p_y, v_x, v_y, length, n_x, n_y)
    if t_in > t_out:
        return -prior_shape * math.log1p(length / prior_path), prior_shape / (prior_path + length)
    passed_outside = length - (t_out - t_in)
    log_pass = -prior_shape * math.log1p(passed_outside / prior_path)
    i_x = min(max(math.floor(p_x + v_x * t_in), 0), n_x - 1)
    i_y = min(max(math.floor(p_y + v_y * t_in), 0), n_y - 1)
    e_x = min(max(math.floor(p_x + v_x * t_out), 0), n_x - 1)
    e_y = min(max(math.floor(p_y + v_y * t_out), 0), n_y - 1)
    line_x = i_x + 1.0 if v_x > 0.0 else float(i_x)
    line_y = i_y + 1.0 if v_y > 0.0 else float(i_y)
    step_x = 1 if v_x > 0.0 else -1
    step_y = 1 if v_y > 0.0 else -1
    i_v_x = 1.0 / v_x
    i_v_y = 1.0 / v_y
    # A ray along a line may cross it by its direction and not by its end, which is rounded; the end decides.
    t_x = (line_x - p_x) * i_v_x if i_x != e_x else math.inf
    t_y = (line_y - p_y) * i_v_y if i_y != e_y else math.inf
    cell = (i_x + 1) * width + i_y + 1
    t = t_in
    for _ in range(abs(e_x - i_x) + abs(e_y - i_y)):
        t_next = max(min(min(t_x, t_y), t_out), t)
        log_pass += log_kept(shapes[cell], t_next - t, paths[cell])
        t = t_next
        if t_x < t_y:
            cell += step_x * width
            line_x += step_x
            t_x = (line_x - p_x) * i_v_x
        else:
            cell += step_y
            line_y += step_y
            t_y = (line_y - p_y) * i_v_y
    cell = (e_x + 1) * width + e_y + 1
    last = max(t_out - t, 0.0)
    log_pass += log_kept(shapes[cell], last, paths[cell])
    end_x = math.floor(p_x + v_x * length)
    end_y = math.floor(p_y + v_y * length)
    if 0 <= end_x < n_x and 0 <= end_y < n_y:
        return log_pass, shapes[cell] / (paths[cell] + last)
    return log_pass, prior_shape / (prior_path + passed_outside)
