"""Interpolation between the cells of planar tables."""

from factorloc._jit import kernel


@kernel(allocates=False)
def bilinear(values, stride, q_x, q_y):
    """Interpolate between cell centres: value and its derivatives by the cell coordinates.

    ``q`` counts cells of the rimmed array from the centre of its first; the caller keeps it inside.
    """
    j_x = int(q_x)
    j_y = int(q_y)
    u = q_x - j_x
    v = q_y - j_y
    cell = j_x * stride + j_y
    f_00 = values[cell]
    f_01 = values[cell + 1]
    f_10 = values[cell + stride]
    f_11 = values[cell + stride + 1]
    low = f_00 + v * (f_01 - f_00)
    high = f_10 + v * (f_11 - f_10)
    return low + u * (high - low), high - low, (1.0 - u) * (f_01 - f_00) + u * (f_11 - f_10)


@kernel(allocates=False)
def extended(values, shape, outside, e_x, e_y):
    """Interpolate a rimmed table at a point in cells of its grid; beyond the rim's centres it is constant."""
    n_x, n_y = shape
    q_x = e_x + 0.5
    q_y = e_y + 0.5
    if 0.0 <= q_x < n_x + 1 and 0.0 <= q_y < n_y + 1:
        return bilinear(values, n_y + 2, q_x, q_y)
    return outside, 0.0, 0.0
