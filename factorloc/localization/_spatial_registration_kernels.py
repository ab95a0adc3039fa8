"""Levenberg-Marquardt registration of spatial scans, compiled: a whole descent without returning to Python."""

import math

import numpy as np

from factorloc._jit import kernel
from factorloc.factors._spatial_scan_kernels import spatial_scan_cost

_LEAST_GAIN = 1e-5  # of the cost, which grows with the rays
_MOST_DAMPING = 1e20  # a matrix that needs more than this is none


@kernel(allocates=False)
def solve_damped_spatial(hessian, gradient, damping, root, step):
    """Solve ``(H + damping diag(H)) step = -gradient`` by Cholesky; false if the matrix is not positive."""
    n = gradient.shape[0]
    for i in range(n):
        for j in range(i + 1):
            total = hessian[i, j]
            if i == j:
                total += damping * hessian[i, i] + 1e-9
            for k in range(j):
                total -= root[i, k] * root[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                root[i, i] = math.sqrt(total)
            else:
                root[i, j] = total / root[j, j]
    for i in range(n):
        total = -gradient[i]
        for k in range(i):
            total -= root[i, k] * step[k]
        step[i] = total / root[i, i]
    for i in range(n - 1, -1, -1):
        total = step[i]
        for k in range(i + 1, n):
            total -= root[k, i] * step[k]
        step[i] = total / root[i, i]
    return True


@kernel(allocates=False)
def move_spatial(pose, step, scale, turn, out):
    """Write ``pose * exp(scale * step)``, with ``step = [omega, v]``; ``turn`` (3, 3) is scratch."""
    o_x = scale * step[0]
    o_y = scale * step[1]
    o_z = scale * step[2]
    v_x = scale * step[3]
    v_y = scale * step[4]
    v_z = scale * step[5]
    square = o_x * o_x + o_y * o_y + o_z * o_z
    angle = math.sqrt(square)
    if angle < 1e-4:
        a = 1.0 - square / 6.0
        b = 0.5 - square / 24.0
        c = 1.0 / 6.0 - square / 120.0
    else:
        a = math.sin(angle) / angle
        b = (1.0 - math.cos(angle)) / square
        c = (1.0 - a) / square
    # exp(W) = I + a W + b W W, and v goes along by I + b W + c W W, with W W = o o' - square I.
    turn[0, 0] = 1.0 + b * (o_x * o_x - square)
    turn[0, 1] = b * o_x * o_y - a * o_z
    turn[0, 2] = b * o_x * o_z + a * o_y
    turn[1, 0] = b * o_x * o_y + a * o_z
    turn[1, 1] = 1.0 + b * (o_y * o_y - square)
    turn[1, 2] = b * o_y * o_z - a * o_x
    turn[2, 0] = b * o_x * o_z - a * o_y
    turn[2, 1] = b * o_y * o_z + a * o_x
    turn[2, 2] = 1.0 + b * (o_z * o_z - square)
    along = c * (o_x * v_x + o_y * v_y + o_z * v_z)
    keep = 1.0 - c * square
    x = keep * v_x + b * (o_y * v_z - o_z * v_y) + along * o_x
    y = keep * v_y + b * (o_z * v_x - o_x * v_z) + along * o_y
    z = keep * v_z + b * (o_x * v_y - o_y * v_x) + along * o_z
    for i in range(3):
        r_0 = pose[i, 0]
        r_1 = pose[i, 1]
        r_2 = pose[i, 2]
        out[i, 3] = pose[i, 3] + r_0 * x + r_1 * y + r_2 * z
        for j in range(3):
            out[i, j] = r_0 * turn[0, j] + r_1 * turn[1, j] + r_2 * turn[2, j]
        out[3, i] = 0.0
    out[3, 3] = 1.0


@kernel(allocates=False)
def add_spatial_prior(pose, mean, information, gradient, hessian, r, J):
    """Add a Gaussian prior to derivatives in the tangent space of the body; return its cost.

    The residual is the rotation vector from the mean, and the translation in the frame of the mean; ``r`` (6,) and
    ``J`` (6, 6) are scratch. Jacobians of the rotation are those to first order in the residual.
    """
    # Relative rotation, of which the skew part is sin(angle) times the axis.
    for i in range(3):
        total = 0.0
        for k in range(3):
            total += mean[k, i] * (pose[k, 3] - mean[k, 3])
        r[3 + i] = total
        for j in range(3):
            total = 0.0
            for k in range(3):
                total += mean[k, i] * pose[k, j]
            J[3 + i, 3 + j] = total
            J[3 + i, j] = 0.0
            J[i, 3 + j] = 0.0
    s_x = 0.5 * (J[5, 4] - J[4, 5])
    s_y = 0.5 * (J[3, 5] - J[5, 3])
    s_z = 0.5 * (J[4, 3] - J[3, 4])
    sine = math.sqrt(s_x * s_x + s_y * s_y + s_z * s_z)
    angle = math.atan2(sine, 0.5 * (J[3, 3] + J[4, 4] + J[5, 5] - 1.0))
    scale = angle / sine if sine > 1e-9 else 1.0
    r[0] = scale * s_x
    r[1] = scale * s_y
    r[2] = scale * s_z
    if sine <= 1e-9 and angle > 1.0:
        # Half a turn has no skew part: R = 2 a a' - I, and the columns of R + I lie along the axis.
        k = 0
        for i in range(1, 3):
            if J[3 + i, 3 + i] > J[3 + k, 3 + k]:
                k = i
        J[3 + k, 3 + k] += 1.0
        size = math.sqrt(J[3, 3 + k] ** 2 + J[4, 3 + k] ** 2 + J[5, 3 + k] ** 2)
        for i in range(3):
            r[i] = angle * J[3 + i, 3 + k] / size
        J[3 + k, 3 + k] -= 1.0
    J[0, 0] = 1.0
    J[1, 1] = 1.0
    J[2, 2] = 1.0
    J[0, 1] = -0.5 * r[2]
    J[0, 2] = 0.5 * r[1]
    J[1, 0] = 0.5 * r[2]
    J[1, 2] = -0.5 * r[0]
    J[2, 0] = -0.5 * r[1]
    J[2, 1] = 0.5 * r[0]
    cost = 0.0
    for i in range(6):
        for j in range(6):
            cost += 0.5 * r[i] * information[i, j] * r[j]
    for a in range(6):
        for i in range(6):
            pulled = 0.0
            for j in range(6):
                pulled += information[i, j] * J[j, a]
            gradient[a] += pulled * r[i]
            for b in range(6):
                hessian[a, b] += pulled * J[i, b]
    return cost


@kernel(allocates=False)
def copy_square(source, target):
    """Copy a matrix; a slice assignment takes a second longer to compile."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[i, j] = source[i, j]


@kernel
def descend_spatial(
    pose, origins, directions, lengths, first, last, low, directory, primary, secondary, tertiary, numbers, blurs,
    levels, information, mean, prior, limits, scan_hessian,
):  # fmt: skip
    """Minimize scan cost plus prior (a mean and its information) through the levels.

    ``pose`` and ``scan_hessian`` are written.

    ``limits`` holds the most trials a level, the longest translation (m) and rotation (rad) of a step, the least gain,
    the least translation and the initial damping.

    Returns
    -------
    cost : float
    trials : int
    converged : bool
        On the last level.
    """
    gradient = np.empty(6)
    hessian = np.empty((6, 6))
    new_gradient = np.empty(6)
    new_hessian = np.empty((6, 6))
    new_scan_hessian = np.empty((6, 6))
    residual = np.empty(6)
    jacobian = np.empty((6, 6))
    root = np.empty((6, 6))
    step = np.empty(6)
    turn = np.empty((3, 3))
    trial = np.empty((4, 4))
    trials = 0
    cost = math.inf
    converged = False
    # A variable, not a literal: numba compiles kernels once more for a literal.
    want_gradient = limits[0] > 0.0
    for level in levels:
        cost = math.inf
        damping = limits[5]
        least = max(limits[4], 0.01 * blurs[level])
        converged = False
        translation = math.inf
        rotation = math.inf
        copy_square(pose, trial)
        # The first round evaluates where the level starts; each of the others tries a step.
        for attempt in range(int(limits[0]) + 1):
            new_cost = spatial_scan_cost(
                trial, origins, directions, lengths, first, last, low, directory, primary, secondary, tertiary,
                numbers[level], information, want_gradient, new_gradient, new_scan_hessian,
            )  # fmt: skip
            copy_square(new_scan_hessian, new_hessian)
            new_cost += add_spatial_prior(trial, mean, prior, new_gradient, new_hessian, residual, jacobian)
            gain = cost - new_cost
            if gain > 0.0:
                cost = new_cost
                copy_square(trial, pose)
                copy_square(new_hessian, hessian)
                copy_square(new_scan_hessian, scan_hessian)
                for i in range(6):
                    gradient[i] = new_gradient[i]
            elif attempt == 0:  # infinite or not a number: there is nothing to descend from
                cost = new_cost
                break
            if attempt > 0:
                trials += 1
                damping = max(0.1 * damping, 1e-7) if gain > 0.0 else 10.0 * damping
                # Refused or not, a step this short has nowhere left to go.
                if (translation < least and rotation < 0.1 * least) or 0.0 < gain < max(
                    limits[3], _LEAST_GAIN * abs(cost)
                ):
                    converged = True
                    break
            while damping < _MOST_DAMPING and not solve_damped_spatial(hessian, gradient, damping, root, step):
                damping *= 10.0
            if not damping < _MOST_DAMPING:
                break
            rotation = math.sqrt(step[0] * step[0] + step[1] * step[1] + step[2] * step[2])
            translation = math.sqrt(step[3] * step[3] + step[4] * step[4] + step[5] * step[5])
            scale = min(1.0, limits[1] / max(translation, 1e-12), limits[2] / max(rotation, 1e-12))
            move_spatial(pose, step, scale, turn, trial)
    return cost, trials, converged


@kernel(allocates=False)
def register_spatial_batch(
    poses, scan_of_pose, origins, directions, lengths, offsets, low, directory, primary, secondary, tertiary, numbers,
    blurs, levels, information, mean, prior, limits, costs, hessians, trials, converged,
):  # fmt: skip
    """Run :func:`descend_spatial` for N guesses.

    ``poses`` (N, 4, 4) is overwritten, the last four arrays (N, ...) are written.
    """
    for n in range(poses.shape[0]):
        k = scan_of_pose[n]
        costs[n], trials[n], converged[n] = descend_spatial(
            poses[n], origins, directions, lengths, offsets[k], offsets[k + 1], low, directory, primary, secondary,
            tertiary, numbers, blurs, levels, information, mean, prior, limits, hessians[n],
        )  # fmt: skip
