"""Plain loops over particles and rays, compiled like the package's own: rivals in weighing particles.

Each computes what a sensor model of the package computes, as it is written down: rays are moved by the pose, cut off at
the map, and walked as Amanatides and Woo (1987) describe it, the nearer of the next two lines first. Numbers of cells
lie in flat arrays with a rim of one cell, as those of the package. One file, however long: numba does not notice
an edit in a kernel that another file calls.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from factorloc._jit import kernel

Array = npt.NDArray[np.float64]
Rates = npt.NDArray[np.float32]
Status = npt.NDArray[np.uint8]
_FIXED_POINT = 2.0**20  # steps a metre; a piece of the way that ends in the step it began in is no visit of a cell


@kernel
def plain_field(
    table: Array, low: Array, resolution: float, outside: float, poses: Array, points: Array, out: Array
) -> None:
    """Sum of a likelihood field at the end points of a scan, for each pose.

    Parameters
    ----------
    table : (n_x, n_y) float64
        Log scores.
    low : (2,) float64
        Lowest corner of the grid, m.
    resolution : float
        Edge of a cell, m.
    outside : float
        Log score outside the grid.
    poses : (P, 3) float64
        T_map_body.
    points : (N, 2) float64
        End points in the body frame, m.
    out : (P,) float64
        Written.
    """
    inverse = 1.0 / resolution
    n_x, n_y = table.shape
    for i in range(poses.shape[0]):
        c = math.cos(poses[i, 2])
        s = math.sin(poses[i, 2])
        total = 0.0
        for k in range(points.shape[0]):
            i_x = math.floor((c * points[k, 0] - s * points[k, 1] + poses[i, 0] - low[0]) * inverse)
            i_y = math.floor((s * points[k, 0] + c * points[k, 1] + poses[i, 1] - low[1]) * inverse)
            if 0 <= i_x < n_x and 0 <= i_y < n_y:
                total += table[i_x, i_y]
            else:
                total += outside
        out[i] = total


@kernel
def outcome(status: int, log_pass: float, density: float) -> float:
    """Log-likelihood of a return (0), of a ray below the minimum (1) and of one without return (2)."""
    if status == 0:
        return math.log(density) + log_pass
    if status == 2:
        return log_pass
    return math.log(-math.expm1(log_pass))


@kernel
def cut(p: float, v: float, n: int, t_in: float, t_out: float) -> tuple[float, float]:
    """Cut a ray off at both ends of an axis of ``n`` cells."""
    if v == 0.0:
        return (t_in, t_out) if 0.0 <= p < n else (t_in, -1.0)
    near = -p / v
    far = (n - p) / v
    if v < 0.0:
        near, far = far, near
    return max(t_in, near), min(t_out, far)


@kernel
def start(p: float, v: float, n: int, t_in: float, t_out: float) -> tuple[float, ...]:
    """First cell along an axis, lines crossed, parameter of the first, distance to the next, and step."""
    i = min(max(math.floor(p + v * t_in), 0), n - 1)
    lines = abs(min(max(math.floor(p + v * t_out), 0), n - 1) - i)
    d = 1.0 / abs(v)
    t = (i + 1.0 - p if v > 0.0 else p - i) * d if lines > 0 else math.inf
    return i, lines, t, d, 1 if v > 0.0 else -1


@kernel
def plain_decay(
    rates: Array,
    shape: tuple[int, int],
    outside: float,
    low: Array,
    resolution: float,
    poses: Array,
    origins: Array,
    directions: Array,
    lengths: Array,
    status: Status,
    out: Array,
) -> None:
    """Log-likelihood of a scan at many poses under decay rates.

    Parameters
    ----------
    rates : (cells with rim,) float64
        1/m.
    shape : (int, int)
        Cells without rim.
    outside : float
        Rate outside the grid, 1/m.
    low : (2,) float64
        Lowest corner of the grid, m.
    resolution : float
        Edge of a cell, m.
    poses : (P, 3) float64
        T_map_body.
    origins, directions : (N, 2) float64
        Rays in the body frame, m and unit vectors.
    lengths : (N,) float64
        m.
    status : (N,) uint8
        0 return, 1 below minimum, 2 no return.
    out : (P,) float64
        Written.
    """
    n_x, n_y = shape
    stride = n_y + 2
    inverse = 1.0 / resolution
    for i in range(poses.shape[0]):
        c = math.cos(poses[i, 2])
        s = math.sin(poses[i, 2])
        total = 0.0
        for k in range(lengths.shape[0]):
            p_x = (c * origins[k, 0] - s * origins[k, 1] + poses[i, 0] - low[0]) * inverse
            p_y = (s * origins[k, 0] + c * origins[k, 1] + poses[i, 1] - low[1]) * inverse
            v_x = (c * directions[k, 0] - s * directions[k, 1]) * inverse
            v_y = (s * directions[k, 0] + c * directions[k, 1]) * inverse
            length = lengths[k]
            e_x = p_x + v_x * length
            e_y = p_y + v_y * length
            ends_inside = 0.0 <= e_x < n_x and 0.0 <= e_y < n_y
            t = 0.0
            t_out = length
            if not (ends_inside and 0.0 <= p_x < n_x and 0.0 <= p_y < n_y):
                t, t_out = cut(p_x, v_x, n_x, t, t_out)
                t, t_out = cut(p_y, v_y, n_y, t, t_out)
            rate = outside
            integral = outside * length
            if t < t_out:
                i_x, lines_x, t_x, d_x, step_x = start(p_x, v_x, n_x, t, t_out)
                i_y, lines_y, t_y, d_y, step_y = start(p_y, v_y, n_y, t, t_out)
                step_x *= stride
                cell = (i_x + 1) * stride + i_y + 1
                integral -= outside * (t_out - t)
                for _ in range(lines_x + lines_y):
                    if t_x < t_y:
                        integral += rates[cell] * (t_x - t)
                        t = t_x
                        t_x += d_x
                        cell += step_x
                    else:
                        integral += rates[cell] * (t_y - t)
                        t = t_y
                        t_y += d_y
                        cell += step_y
                integral += rates[cell] * (t_out - t)
                if ends_inside:
                    rate = rates[cell]
            total += outcome(status[k], -integral, rate)
        out[i] = total


@kernel
def plain_posterior(
    shapes: Array,
    paths: Array,
    shape: tuple[int, int],
    prior_shape: float,
    prior_path: float,
    low: Array,
    resolution: float,
    poses: Array,
    origins: Array,
    directions: Array,
    lengths: Array,
    status: Status,
    out: Array,
) -> None:
    """Log-likelihood of a scan at many poses under Gamma posteriors of the decay rates.

    ``shapes`` and ``paths`` are their parameters, flat with rim; what lies outside the grid is one cell with the prior.
    The other arguments are those of :func:`plain_decay`.
    """
    n_x, n_y = shape
    stride = n_y + 2
    inverse = 1.0 / resolution
    for i in range(poses.shape[0]):
        c = math.cos(poses[i, 2])
        s = math.sin(poses[i, 2])
        total = 0.0
        for k in range(lengths.shape[0]):
            p_x = (c * origins[k, 0] - s * origins[k, 1] + poses[i, 0] - low[0]) * inverse
            p_y = (s * origins[k, 0] + c * origins[k, 1] + poses[i, 1] - low[1]) * inverse
            v_x = (c * directions[k, 0] - s * directions[k, 1]) * inverse
            v_y = (s * directions[k, 0] + c * directions[k, 1]) * inverse
            length = lengths[k]
            t, t_out = cut(p_x, v_x, n_x, 0.0, length)
            t, t_out = cut(p_y, v_y, n_y, t, t_out)
            passed = length - max(t_out - t, 0.0)
            log_pass = -prior_shape * math.log1p(passed / prior_path)
            density = prior_shape / (prior_path + passed)
            if t < t_out:
                i_x, lines_x, t_x, d_x, step_x = start(p_x, v_x, n_x, t, t_out)
                i_y, lines_y, t_y, d_y, step_y = start(p_y, v_y, n_y, t, t_out)
                step_x *= stride
                cell = (i_x + 1) * stride + i_y + 1
                for _ in range(lines_x + lines_y):
                    if t_x < t_y:
                        log_pass -= shapes[cell] * math.log1p((t_x - t) / paths[cell])
                        t = t_x
                        t_x += d_x
                        cell += step_x
                    else:
                        log_pass -= shapes[cell] * math.log1p((t_y - t) / paths[cell])
                        t = t_y
                        t_y += d_y
                        cell += step_y
                log_pass -= shapes[cell] * math.log1p((t_out - t) / paths[cell])
                if 0.0 <= p_x + v_x * length < n_x and 0.0 <= p_y + v_y * length < n_y:
                    density = shapes[cell] / (paths[cell] + t_out - t)
            total += outcome(status[k], log_pass, density)
        out[i] = total


@kernel
def plain_reflection(
    log_misses: Array,
    shape: tuple[int, int],
    outside: float,
    low: Array,
    resolution: float,
    poses: Array,
    origins: Array,
    directions: Array,
    lengths: Array,
    status: Status,
    out: Array,
) -> None:
    """Log-likelihood of a scan at many poses under reflection probabilities ``mu`` of the cells.

    ``log_misses`` are ``log(1 - mu)``, flat with rim, and ``outside`` that of all cells outside the grid, which are
    walked like the others. The other arguments are those of :func:`plain_decay`.
    """
    n_x, n_y = shape
    stride = n_y + 2
    inverse = 1.0 / resolution
    for i in range(poses.shape[0]):
        c = math.cos(poses[i, 2])
        s = math.sin(poses[i, 2])
        total = 0.0
        for k in range(lengths.shape[0]):
            p_x = (c * origins[k, 0] - s * origins[k, 1] + poses[i, 0] - low[0]) * inverse
            p_y = (s * origins[k, 0] + c * origins[k, 1] + poses[i, 1] - low[1]) * inverse
            v_x = (c * directions[k, 0] - s * directions[k, 1]) * inverse
            v_y = (s * directions[k, 0] + c * directions[k, 1]) * inverse
            length = lengths[k]
            i_x = math.floor(p_x)
            i_y = math.floor(p_y)
            lines = abs(math.floor(p_x + v_x * length) - i_x) + abs(math.floor(p_y + v_y * length) - i_y)
            d_x = 1.0 / abs(v_x)
            d_y = 1.0 / abs(v_y)
            step_x = 1 if v_x > 0.0 else -1
            step_y = 1 if v_y > 0.0 else -1
            t_x = (i_x + 1.0 - p_x if v_x > 0.0 else p_x - i_x) * d_x
            t_y = (i_y + 1.0 - p_y if v_y > 0.0 else p_y - i_y) * d_y
            t = 0.0
            before = 0
            log_pass = 0.0
            for _ in range(lines):
                inside = 0 <= i_x < n_x and 0 <= i_y < n_y
                log_miss = log_misses[(i_x + 1) * stride + i_y + 1] if inside else outside
                if t_x < t_y:
                    t = t_x
                    t_x += d_x
                    i_x += step_x
                else:
                    t = t_y
                    t_y += d_y
                    i_y += step_y
                here = math.floor(t * _FIXED_POINT)
                if here > before or not inside:
                    log_pass += log_miss
                before = here
            inside = 0 <= i_x < n_x and 0 <= i_y < n_y
            mu = -math.expm1(log_misses[(i_x + 1) * stride + i_y + 1] if inside else outside)
            chord = max(min(t_x, t_y) - t, 1.0 / _FIXED_POINT)
            if status[k] != 0:
                log_pass += math.log1p(-mu * min(max((length - t) / chord, 0.0), 1.0))
            total += outcome(status[k], log_pass, mu / chord)
        out[i] = total


@kernel
def plain_spatial_decay(
    rates: Rates,
    shape: tuple[int, int, int],
    outside: float,
    low: Array,
    resolution: float,
    poses: Array,
    origins: Array,
    directions: Array,
    lengths: Array,
    status: Status,
    out: Array,
) -> None:
    """As :func:`plain_decay` in space, with poses (P, 4, 4) and a dense array of rates."""
    n_x, n_y, n_z = shape
    stride_y = n_z + 2
    stride_x = (n_y + 2) * stride_y
    inverse = 1.0 / resolution
    for i in range(poses.shape[0]):
        T = poses[i]
        total = 0.0
        for k in range(lengths.shape[0]):
            x = origins[k, 0]
            y = origins[k, 1]
            z = origins[k, 2]
            p_x = (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3] - low[0]) * inverse
            p_y = (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3] - low[1]) * inverse
            p_z = (T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3] - low[2]) * inverse
            x = directions[k, 0]
            y = directions[k, 1]
            z = directions[k, 2]
            v_x = (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z) * inverse
            v_y = (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z) * inverse
            v_z = (T[2, 0] * x + T[2, 1] * y + T[2, 2] * z) * inverse
            length = lengths[k]
            e_x = p_x + v_x * length
            e_y = p_y + v_y * length
            e_z = p_z + v_z * length
            ends_inside = 0.0 <= e_x < n_x and 0.0 <= e_y < n_y and 0.0 <= e_z < n_z
            t = 0.0
            t_out = length
            if not (ends_inside and 0.0 <= p_x < n_x and 0.0 <= p_y < n_y and 0.0 <= p_z < n_z):
                t, t_out = cut(p_x, v_x, n_x, t, t_out)
                t, t_out = cut(p_y, v_y, n_y, t, t_out)
                t, t_out = cut(p_z, v_z, n_z, t, t_out)
            rate = outside
            integral = outside * length
            if t < t_out:
                i_x, lines_x, t_x, d_x, step_x = start(p_x, v_x, n_x, t, t_out)
                i_y, lines_y, t_y, d_y, step_y = start(p_y, v_y, n_y, t, t_out)
                i_z, lines_z, t_z, d_z, step_z = start(p_z, v_z, n_z, t, t_out)
                step_x *= stride_x
                step_y *= stride_y
                cell = (i_x + 1) * stride_x + (i_y + 1) * stride_y + i_z + 1
                integral -= outside * (t_out - t)
                for _ in range(lines_x + lines_y + lines_z):
                    if t_x < t_y and t_x < t_z:
                        integral += rates[cell] * (t_x - t)
                        t = t_x
                        t_x += d_x
                        cell += step_x
                    elif t_y < t_z:
                        integral += rates[cell] * (t_y - t)
                        t = t_y
                        t_y += d_y
                        cell += step_y
                    else:
                        integral += rates[cell] * (t_z - t)
                        t = t_z
                        t_z += d_z
                        cell += step_z
                integral += rates[cell] * (t_out - t)
                if ends_inside:
                    rate = np.float64(rates[cell])
            total += outcome(status[k], -integral, rate)
        out[i] = total
