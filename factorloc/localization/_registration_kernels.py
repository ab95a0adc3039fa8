"""Levenberg-Marquardt registration of planar scans, compiled: a whole descent without returning to Python."""

import math

import numpy as np

from factorloc._jit import kernel
from factorloc.factors._scan_kernels import scan_cost


@kernel
def solve_damped(hessian, gradient, damping, step):
    """Solve ``(H + damping diag(H)) step = -gradient`` by Cholesky; false if the matrix is not positive."""
    d_0 = hessian[0, 0] * (1.0 + damping) + 1e-9
    d_1 = hessian[1, 1] * (1.0 + damping) + 1e-9
    d_2 = hessian[2, 2] * (1.0 + damping) + 1e-9
    if not d_0 > 0.0:
        return False
    l_00 = math.sqrt(d_0)
    l_10 = hessian[1, 0] / l_00
    l_20 = hessian[2, 0] / l_00
    r_1 = d_1 - l_10 * l_10
    if not r_1 > 0.0:
        return False
    l_11 = math.sqrt(r_1)
    l_21 = (hessian[2, 1] - l_20 * l_10) / l_11
    r_2 = d_2 - l_20 * l_20 - l_21 * l_21
    if not r_2 > 0.0:
        return False
    l_22 = math.sqrt(r_2)
    y_0 = -gradient[0] / l_00
    y_1 = (-gradient[1] - l_10 * y_0) / l_11
    y_2 = (-gradient[2] - l_20 * y_0 - l_21 * y_1) / l_22
    step[2] = y_2 / l_22
    step[1] = (y_1 - l_21 * step[2]) / l_11
    step[0] = (y_0 - l_10 * step[1] - l_20 * step[2]) / l_00
    return True


@kernel
def move(pose, step, scale, out):
    """Write ``pose * exp(scale * step)``."""
    angle = scale * step[2]
    if abs(angle) < 1e-4:
        a = 1.0 - angle * angle / 6.0
        b = 0.5 * angle
    else:
        a = math.sin(angle) / angle
        b = (1.0 - math.cos(angle)) / angle
    x = scale * (a * step[0] - b * step[1])
    y = scale * (b * step[0] + a * step[1])
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    out[0] = pose[0] + c * x - s * y
    out[1] = pose[1] + s * x + c * y
    theta = pose[2] + angle
    out[2] = theta - 2.0 * math.pi * math.floor((theta + math.pi) / (2.0 * math.pi))


@kernel
def add_prior(pose, mean, world, gradient, hessian):
    """Add a Gaussian prior, quadratic in world coordinates, to derivatives in the tangent space; return its cost."""
    d_0 = pose[0] - mean[0]
    d_1 = pose[1] - mean[1]
    d_2 = pose[2] - mean[2]
    d_2 -= 2.0 * math.pi * math.floor((d_2 + math.pi) / (2.0 * math.pi))
    p_0 = world[0, 0] * d_0 + world[0, 1] * d_1 + world[0, 2] * d_2
    p_1 = world[1, 0] * d_0 + world[1, 1] * d_1 + world[1, 2] * d_2
    p_2 = world[2, 0] * d_0 + world[2, 1] * d_1 + world[2, 2] * d_2
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    gradient[0] += c * p_0 + s * p_1
    gradient[1] += -s * p_0 + c * p_1
    gradient[2] += p_2
    w_xx = world[0, 0]
    w_xy = world[0, 1]
    w_yy = world[1, 1]
    hessian[0, 0] += c * c * w_xx + 2.0 * c * s * w_xy + s * s * w_yy
    hessian[0, 1] += c * s * (w_yy - w_xx) + (c * c - s * s) * w_xy
    hessian[1, 1] += s * s * w_xx - 2.0 * c * s * w_xy + c * c * w_yy
    hessian[0, 2] += c * world[0, 2] + s * world[1, 2]
    hessian[1, 2] += -s * world[0, 2] + c * world[1, 2]
    hessian[2, 2] += world[2, 2]
    hessian[1, 0] = hessian[0, 1]
    hessian[2, 0] = hessian[0, 2]
    hessian[2, 1] = hessian[1, 2]
    return 0.5 * (d_0 * p_0 + d_1 * p_1 + d_2 * p_2)


@kernel
def descend(
    model, pose, origins, directions, lengths, first, last, primary, secondary, numbers, blurs, levels, shape, low,
    resolution, information, mean, world, limits, scan_hessian,
):  # fmt: skip
    """Minimize scan cost plus prior through the levels; ``pose`` and ``scan_hessian`` are written.

    ``limits`` holds the most trials a level, the longest translation (m) and rotation (rad) of a step, the least gain,
    the least translation and the initial damping.

    Returns
    -------
    cost : float
    trials : int
    converged : bool
        On the last level.
    """
    gradient = np.empty(3)
    hessian = np.empty((3, 3))
    new_gradient = np.empty(3)
    new_hessian = np.empty((3, 3))
    new_scan_hessian = np.empty((3, 3))
    step = np.empty(3)
    trial = np.empty(3)
    trials = 0
    cost = 0.0
    converged = False
    # A variable, not a literal: numba compiles kernels once more for a literal.
    want_gradient = limits[0] > 0.0
    for level in levels:
        cost = information * scan_cost(
            model, pose, origins, directions, lengths, first, last, primary[level], secondary[level], numbers[level],
            shape, low, resolution, want_gradient, gradient, scan_hessian,
        )  # fmt: skip
        gradient *= information
        scan_hessian *= information
        hessian[:] = scan_hessian
        cost += add_prior(pose, mean, world, gradient, hessian)
        damping = limits[5]
        least = max(limits[4], 0.01 * blurs[level])
        converged = False
        for _ in range(int(limits[0])):
            if not solve_damped(hessian, gradient, damping, step):
                damping *= 10.0
                continue
            translation = math.hypot(step[0], step[1])
            rotation = abs(step[2])
            scale = min(1.0, limits[1] / max(translation, 1e-12), limits[2] / max(rotation, 1e-12))
            move(pose, step, scale, trial)
            new_cost = information * scan_cost(
                model, trial, origins, directions, lengths, first, last, primary[level], secondary[level],
                numbers[level], shape, low, resolution, want_gradient, new_gradient, new_scan_hessian,
            )  # fmt: skip
            new_gradient *= information
            new_scan_hessian *= information
            new_hessian[:] = new_scan_hessian
            new_cost += add_prior(trial, mean, world, new_gradient, new_hessian)
            trials += 1
            gain = cost - new_cost
            if gain > 0.0:
                pose[:] = trial
                cost = new_cost
                gradient[:] = new_gradient
                hessian[:] = new_hessian
                scan_hessian[:] = new_scan_hessian
                damping = max(0.1 * damping, 1e-7)
            else:
                damping *= 10.0
            # Refused or not, a step this short has nowhere left to go.
            if (translation < least and rotation < 0.5 * least) or 0.0 < gain < limits[3]:
                converged = True
                break
    return cost, trials, converged


@kernel
def register_batch(
    model, poses, scan_of_pose, origins, directions, lengths, offsets, primary, secondary, numbers, blurs, levels,
    shape, low, resolution, information, mean, world, limits, costs, hessians, trials, converged,
):  # fmt: skip
    """Run :func:`descend` for N guesses; ``poses`` (N, 3) is overwritten, the last four arrays (N, ...) are written."""
    for n in range(poses.shape[0]):
        k = scan_of_pose[n]
        costs[n], trials[n], converged[n] = descend(
            model, poses[n], origins, directions, lengths, offsets[k], offsets[k + 1], primary, secondary, numbers,
            blurs, levels, shape, low, resolution, information, mean, world, limits, hessians[n],
        )  # fmt: skip
