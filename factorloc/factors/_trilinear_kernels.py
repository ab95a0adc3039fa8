"""Interpolation between the cells of bricks."""

import numpy as np

from factorloc._jit import kernel


@kernel(allocates=False)
def number_of(directory, values, stride_x, stride_y, x, y, z):
    """Number of a cell; coordinates count from the corner of the rim of bricks."""
    place = np.uint64((x >> 4) * stride_x + (y >> 4) * stride_y + (z >> 4))
    cell = ((x & 15) << 8) + ((y & 15) << 4) + (z & 15)
    return np.float64(values[np.uint64((np.int64(directory[place]) << 12) + cell)])


@kernel(allocates=False)
def trilinear(directory, values, stride_x, stride_y, q_x, q_y, q_z):
    """Interpolate between cell centres: value and its derivatives by the cell coordinates.

    ``q`` counts cells from the centre of the first cell of the rim; the caller keeps it inside.
    """
    x = int(q_x)
    y = int(q_y)
    z = int(q_z)
    u = q_x - x
    v = q_y - y
    w = q_z - z
    f_000 = number_of(directory, values, stride_x, stride_y, x, y, z)
    f_001 = number_of(directory, values, stride_x, stride_y, x, y, z + 1)
    f_010 = number_of(directory, values, stride_x, stride_y, x, y + 1, z)
    f_011 = number_of(directory, values, stride_x, stride_y, x, y + 1, z + 1)
    f_100 = number_of(directory, values, stride_x, stride_y, x + 1, y, z)
    f_101 = number_of(directory, values, stride_x, stride_y, x + 1, y, z + 1)
    f_110 = number_of(directory, values, stride_x, stride_y, x + 1, y + 1, z)
    f_111 = number_of(directory, values, stride_x, stride_y, x + 1, y + 1, z + 1)
    f_00 = f_000 + w * (f_001 - f_000)
    f_01 = f_010 + w * (f_011 - f_010)
    f_10 = f_100 + w * (f_101 - f_100)
    f_11 = f_110 + w * (f_111 - f_110)
    f_0 = f_00 + v * (f_01 - f_00)
    f_1 = f_10 + v * (f_11 - f_10)
    by_y = (1.0 - u) * (f_01 - f_00) + u * (f_11 - f_10)
    by_z = (1.0 - u) * ((1.0 - v) * (f_001 - f_000) + v * (f_011 - f_010)) + u * (
        (1.0 - v) * (f_101 - f_100) + v * (f_111 - f_110)
    )
    return f_0 + u * (f_1 - f_0), f_1 - f_0, by_y, by_z
