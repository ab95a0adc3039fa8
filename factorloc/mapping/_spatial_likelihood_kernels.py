"""Log-likelihoods of rays in spatial maps, under known decay rates and under Gamma posteriors of them.

The maps are dense arrays with a rim, or pools of bricks with a directory, as the walks of
:mod:`factorloc.mapping._spatial_forward_kernels` take them; ``rim`` is the width of the rim in cells.
"""

import math

import numpy as np

from factorloc._jit import kernel
from factorloc.mapping._spatial_forward_kernels import integrate_spatial
from factorloc.mapping._spatial_traversal_kernels import address, clip_axis


@kernel(allocates=False)
def spatial_decay_log_likelihoods(
    directory, rates, log_rates, strides, rim, shape, outside, log_outside, low, resolution, origins, directions,
    lengths, status, limits, out,
):  # fmt: skip
    """Log-likelihood of each ray under constant decay rates (thesis, eq. 7.13 to 7.16).

    As :func:`factorloc.mapping._forward_kernels.decay_log_likelihoods`, in space.

    Parameters
    ----------
    directory : None or int32, flat
    rates, log_rates : float, flat
        Decay rates and their logarithms.
    strides : (int, int, int)
        Of the dense array, or of the directory.
    rim : float
        1 for a dense array, 16 for bricks.
    shape : (int, int, int)
        Cells without rim.
    outside, log_outside : float
        Rate outside the grid.
    low : (3,) float64
    resolution : float
    origins, directions : (M, 3) float64
        Rays in the frame of the map.
    lengths : (M,) float64
    status : (M,) uint8
        0 return, 1 below minimum, 2 no return.
    limits : (2,) float64
        Minimum and maximum range, m.
    out : (M,) float64
        Written.
    """
    n_x, n_y, n_z = shape
    inverse = 1.0 / resolution
    for k in range(lengths.shape[0]):
        p_x = (origins[k, 0] - low[0]) * inverse
        p_y = (origins[k, 1] - low[1]) * inverse
        p_z = (origins[k, 2] - low[2]) * inverse
        v_x = directions[k, 0] * inverse
        v_y = directions[k, 1] * inverse
        v_z = directions[k, 2] * inverse
        length = lengths[k]
        if status[k] == 1:
            length = limits[0]
        elif status[k] == 2:
            length = limits[1]
        t_in, t_out = clip_axis(p_x, v_x, float(n_x), 0.0, length)
        t_in, t_out = clip_axis(p_y, v_y, float(n_y), t_in, t_out)
        t_in, t_out = clip_axis(p_z, v_z, float(n_z), t_in, t_out)
        if t_in < t_out:
            integral = integrate_spatial(
                directory, rates, strides, p_x + rim, p_y + rim, p_z + rim, v_x, v_y, v_z, t_in, t_out
            )
            integral += outside * (length - (t_out - t_in))
        else:
            integral = outside * length
        if status[k] == 2:
            out[k] = -integral
        elif status[k] == 1:
            out[k] = math.log(-math.expm1(-integral)) if integral > 0.0 else -math.inf
        else:
            i_x = math.floor(p_x + v_x * length)
            i_y = math.floor(p_y + v_y * length)
            i_z = math.floor(p_z + v_z * length)
            log_rate = log_outside
            if 0 <= i_x < n_x and 0 <= i_y < n_y and 0 <= i_z < n_z:
                log_rate = log_rates[address(i_x, i_y, i_z, strides[0], strides[1], directory)]
            out[k] = log_rate - integral


@kernel(allocates=False)
def spatial_posterior_log_likelihoods(
    directory, shapes, paths, strides, shape, prior_shape, prior_path, low, resolution, origins, directions, lengths,
    status, limits, out,
):  # fmt: skip
    """Log-likelihood of each ray under Gamma posteriors of the rates (thesis, l_dec of section 8.4.5).

    As :func:`factorloc.mapping._forward_kernels.posterior_log_likelihoods`, in space; maps as
    :func:`spatial_decay_log_likelihoods`. What lies outside the grid is one cell with the prior.
    """
    n_x, n_y, n_z = shape
    inverse = 1.0 / resolution
    for k in range(lengths.shape[0]):
        p_x = (origins[k, 0] - low[0]) * inverse
        p_y = (origins[k, 1] - low[1]) * inverse
        p_z = (origins[k, 2] - low[2]) * inverse
        v_x = directions[k, 0] * inverse
        v_y = directions[k, 1] * inverse
        v_z = directions[k, 2] * inverse
        length = lengths[k]
        if status[k] == 1:
            length = limits[0]
        elif status[k] == 2:
            length = limits[1]
        t_in, t_out = clip_axis(p_x, v_x, float(n_x), 0.0, length)
        t_in, t_out = clip_axis(p_y, v_y, float(n_y), t_in, t_out)
        t_in, t_out = clip_axis(p_z, v_z, float(n_z), t_in, t_out)
        through = t_in <= t_out
        passed_outside = length - (t_out - t_in) if through else length
        log_pass = -prior_shape * math.log1p(passed_outside / prior_path)
        end_shape = prior_shape
        end_path = prior_path + passed_outside
        if through:
            i_x = min(max(math.floor(p_x + v_x * t_in), 0), n_x - 1)
            i_y = min(max(math.floor(p_y + v_y * t_in), 0), n_y - 1)
            i_z = min(max(math.floor(p_z + v_z * t_in), 0), n_z - 1)
            e_x = min(max(math.floor(p_x + v_x * t_out), 0), n_x - 1)
            e_y = min(max(math.floor(p_y + v_y * t_out), 0), n_y - 1)
            e_z = min(max(math.floor(p_z + v_z * t_out), 0), n_z - 1)
            step_x = 1 if v_x > 0.0 else -1
            step_y = 1 if v_y > 0.0 else -1
            step_z = 1 if v_z > 0.0 else -1
            t = t_in
            for _ in range(abs(e_x - i_x) + abs(e_y - i_y) + abs(e_z - i_z)):
                # A ray along a plane may cross it by its direction and not by its end, which is rounded; the end
                # decides.
                t_x = ((i_x + 1.0 if step_x > 0 else float(i_x)) - p_x) / v_x if i_x != e_x else math.inf
                t_y = ((i_y + 1.0 if step_y > 0 else float(i_y)) - p_y) / v_y if i_y != e_y else math.inf
                t_z = ((i_z + 1.0 if step_z > 0 else float(i_z)) - p_z) / v_z if i_z != e_z else math.inf
                t_next = max(min(min(min(t_x, t_y), t_z), t_out), t)
                cell = address(i_x, i_y, i_z, strides[0], strides[1], directory)
                log_pass -= np.float64(shapes[cell]) * math.log1p((t_next - t) / np.float64(paths[cell]))
                t = t_next
                if t_x < t_y and t_x < t_z:
                    i_x += step_x
                elif t_y < t_z:
                    i_y += step_y
                else:
                    i_z += step_z
            cell = address(e_x, e_y, e_z, strides[0], strides[1], directory)
            last = max(t_out - t, 0.0)
            log_pass -= np.float64(shapes[cell]) * math.log1p(last / np.float64(paths[cell]))
            end_x = math.floor(p_x + v_x * length)
            end_y = math.floor(p_y + v_y * length)
            end_z = math.floor(p_z + v_z * length)
            if 0 <= end_x < n_x and 0 <= end_y < n_y and 0 <= end_z < n_z:
                end_shape = np.float64(shapes[cell])
                end_path = np.float64(paths[cell]) + last
        if status[k] == 2:
            out[k] = log_pass
        elif status[k] == 1:
            out[k] = math.log(-math.expm1(log_pass)) if log_pass < 0.0 else -math.inf
        else:
            out[k] = math.log(end_shape / end_path) + log_pass
