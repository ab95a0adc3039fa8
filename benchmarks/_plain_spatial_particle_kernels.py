"""The plain loop over particles and rays of a map of decay rates in space, as those in the plane beside it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from benchmarks._plain_particle_kernels import cut, outcome, start
from factorloc._jit import kernel

Array = npt.NDArray[np.float64]
Rates = npt.NDArray[np.float32]
Status = npt.NDArray[np.uint8]


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
