"""Levenberg-Marquardt registration of planar scans, compiled: a whole descent without returning to Python."""

import math

import numpy as np

from factorloc._jit import kernel
from factorloc.factors._scan_kernels import scan_cost

_MOST_DAMPING = 1e20  # a matrix that needs more than this is none


@kernel(allocates=False)
def copy_vector(source, target):
    """Copy three numbers; a slice assignment takes a second longer to compile."""
    for i in range(3):
        target[i] = source[i]


@kernel(allocates=False)
def copy_matrix(source, target):
    """Copy three by three numbers."""
    for i in range(3):
        for j in range(3):
            target[i, j] = source[i, j]


@kernel(allocates=False)
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


@kernel(allocates=False)
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


@kernel(allocates=False)
def add_prior(pose, mean, world, gradient, hessian):
    """Add a Gaussian prior, quadratic in world coordinates, to derivatives in the tangent space; return its cost."""
    w_00 = world[0, 0]
    w_01 = world[0, 1]
    w_02 = world[0, 2]
    w_11 = world[1, 1]
    w_12 = world[1, 2]
    w_22 = world[2, 2]
    d_0 = pose[0] - mean[0]
    d_1 = pose[1] - mean[1]
    d_2 = pose[2] - mean[2]
    d_2 -= 2.0 * math.pi * math.floor((d_2 + math.pi) / (2.0 * math.pi))
    p_0 = w_00 * d_0 + w_01 * d_1 + w_02 * d_2
    p_1 = w_01 * d_0 + w_11 * d_1 + w_12 * d_2
    p_2 = w_02 * d_0 + w_12 * d_1 + w_22 * d_2
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    h_01 = hessian[0, 1] + c * s * (w_11 - w_00) + (c * c - s * s) * w_01
    h_02 = hessian[0, 2] + c * w_02 + s * w_12
    h_12 = hessian[1, 2] - s * w_02 + c * w_12
    gradient[0] += c * p_0 + s * p_1
    gradient[1] += -s * p_0 + c * p_1
    gradient[2] += p_2
    hessian[0, 0] += c * c * w_00 + 2.0 * c * s * w_01 + s * s * w_11
    hessian[1, 1] += s * s * w_00 - 2.0 * c * s * w_01 + c * c * w_11
    hessian[2, 2] += w_22
    hessian[0, 1] = hessian[1, 0] = h_01
    hessian[0, 2] = hessian[2, 0] = h_02
    hessian[1, 2] = hessian[2, 1] = h_12
    return 0.5 * (d_0 * p_0 + d_1 * p_1 + d_2 * p_2)


@kernel
def descend(
    model, pose, origins, directions, lengths, first, last, primary, secondary, tertiary, numbers, blurs, levels,
    shape, low, resolution, information, mean, world, limits, scan_hessian,
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
    cost = math.inf
    converged = False
    # A variable, not a literal: numba compiles kernels once more for a literal.
    want_gradient = limits[0] > 0.0
    for level in levels:
        cost = math.inf
        damping = limits[5]
        least = max(limits[4], 0.01 * blurs[level])
        third = None if tertiary is None else tertiary[level]
        converged = False
        translation = math.inf
        rotation = math.inf
        copy_vector(pose, trial)
        # The first round evaluates where the level starts; each of the others tries a step.
        for attempt in range(int(limits[0]) + 1):
            new_cost = scan_cost(
                model, trial, origins, directions, lengths, first, last, primary[level], secondary[level],
                third, numbers[level], shape, low, resolution, information, want_gradient, new_gradient,
                new_scan_hessian,
            )  # fmt: skip
            copy_matrix(new_scan_hessian, new_hessian)
            new_cost += add_prior(trial, mean, world, new_gradient, new_hessian)
            gain = cost - new_cost
            if gain > 0.0:
                cost = new_cost
                copy_vector(trial, pose)
                copy_vector(new_gradient, gradient)
                copy_matrix(new_hessian, hessian)
                copy_matrix(new_scan_hessian, scan_hessian)
            elif attempt == 0:  # infinite or not a number: there is nothing to descend from
                cost = new_cost
                break
            if attempt > 0:
                trials += 1
                damping = max(0.1 * damping, 1e-7) if gain > 0.0 else 10.0 * damping
                # Refused or not, a step this short has nowhere left to go.
                if (translation < least and rotation < 0.5 * least) or 0.0 < gain < limits[3]:
                    converged = True
                    break
            while damping < _MOST_DAMPING and not solve_damped(hessian, gradient, damping, step):
                damping *= 10.0
            if not damping < _MOST_DAMPING:
                break
            translation = math.hypot(step[0], step[1])
            rotation = abs(step[2])
            scale = min(1.0, limits[1] / max(translation, 1e-12), limits[2] / max(rotation, 1e-12))
            move(pose, step, scale, trial)
    return cost, trials, converged


@kernel(allocates=False)
def register_batch(
    model, poses, scan_of_pose, origins, directions, lengths, offsets, primary, secondary, tertiary, numbers, blurs,
    levels, shape, low, resolution, information, mean, world, limits, costs, hessians, trials, converged,
):  # fmt: skip
    """Run :func:`descend` for N guesses; ``poses`` (N, 3) is overwritten, the last four arrays (N, ...) are written."""
    for n in range(poses.shape[0]):
        k = scan_of_pose[n]
        costs[n], trials[n], converged[n] = descend(
            model, poses[n], origins, directions, lengths, offsets[k], offsets[k + 1], primary, secondary, tertiary,
            numbers, blurs, levels, shape, low, resolution, information, mean, world, limits, hessians[n],
        )  # fmt: skip
