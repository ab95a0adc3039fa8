"""Likelihood of detected poles in a map of poles: exactly, by a hash of its cells, and by a table to interpolate in."""

import math

from factorloc._jit import kernel


@kernel(allocates=False)
def nearest_pole_sums(starts, poles, shape, low, cell, poses, x, y, gate, variance, peak, epsilon, out):
    """Sum over detections of ``log(peak exp(-d^2 / (2 variance)) + epsilon)``, d to the nearest pole, at most the gate.

    Parameters
    ----------
    starts : (cells + 1,) int64
        First pole of each cell, row by row.
    poles : (L, 2) float64
        Sorted by cell, m.
    shape : (int, int)
        Cells.
    low : (2,) float64
        Lowest corner of the cells, m.
    cell : float
        Edge of a cell, m; at least the gate.
    poses : (P, 3) float64
        T_map_body.
    x, y : (N,) float64
        Detections in the body frame, m.
    gate, variance, peak, epsilon : float
        m, m^2, and densities, 1/m.
    out : (P,) float64
        Written.
    """
    inverse = 1.0 / cell
    scale = -0.5 / variance
    n_x, n_y = shape
    for p in range(poses.shape[0]):
        c = math.cos(poses[p, 2])
        s = math.sin(poses[p, 2])
        product = 1.0
        total = 0.0
        for k in range(x.shape[0]):
            p_x = poses[p, 0] - low[0] + c * x[k] - s * y[k]
            p_y = poses[p, 1] - low[1] + s * x[k] + c * y[k]
            i = math.floor(p_x * inverse)
            j = math.floor(p_y * inverse)
            p_x += low[0]
            p_y += low[1]
            best = gate * gate
            first = int(max(j - 1, 0))
            last = int(min(j + 2, n_y))
            if first < last:
                for row in range(int(max(i - 1, 0)), int(min(i + 2, n_x))):
                    for m in range(starts[row * n_y + first], starts[row * n_y + last]):
                        squared = (poles[m, 0] - p_x) ** 2 + (poles[m, 1] - p_y) ** 2
                        best = min(best, squared)
            product *= peak * math.exp(scale * best) + epsilon
            if product < 1e-200 or product > 1e200:
                total += math.log(product)
                product = 1.0
        out[p] = total + math.log(product)


@kernel(allocates=False)
def pole_field_sums(table, shape, low, resolution, poses, x, y, out):
    """Sum over detections of a table, interpolated between its nodes; beyond them it is what it is at its rim.

    Parameters
    ----------
    table : (nodes,) float32
        Row by row; the same all along the rim.
    shape : (int, int)
        Nodes.
    low : (2,) float64
        First node, m.
    resolution : float
        Distance of nodes, m.
    poses, x, y, out
        As :func:`nearest_pole_sums`.
    """
    inverse = 1.0 / resolution
    high_x = shape[0] - 1.001
    high_y = shape[1] - 1.001
    stride = shape[1]
    for p in range(poses.shape[0]):
        c = math.cos(poses[p, 2]) * inverse
        s = math.sin(poses[p, 2]) * inverse
        t_x = (poses[p, 0] - low[0]) * inverse
        t_y = (poses[p, 1] - low[1]) * inverse
        total = 0.0
        for k in range(x.shape[0]):
            p_x = min(max(c * x[k] - s * y[k] + t_x, 0.0), high_x)
            p_y = min(max(s * x[k] + c * y[k] + t_y, 0.0), high_y)
            i = int(p_x)
            j = int(p_y)
            u = p_x - i
            v = p_y - j
            node = i * stride + j
            near = (1.0 - v) * table[node] + v * table[node + 1]
            far = (1.0 - v) * table[node + stride] + v * table[node + stride + 1]
            total += (1.0 - u) * near + u * far
        out[p] = total


@kernel(allocates=False)
def nearest_distances(poles, low, resolution, gate, out):
    """Distance of every node of a table to its nearest pole, at most the gate.

    Parameters
    ----------
    poles : (L, 2) float64
        m.
    low : (2,) float64
        First node, m.
    resolution : float
        Distance of nodes, m.
    gate : float
        m.
    out : (n_x, n_y) float32
        Holds the gate; written where a pole is nearer.
    """
    n_x, n_y = out.shape
    for m in range(poles.shape[0]):
        i_first = max(math.ceil((poles[m, 0] - gate - low[0]) / resolution), 0)
        i_last = min(math.floor((poles[m, 0] + gate - low[0]) / resolution), n_x - 1)
        j_first = max(math.ceil((poles[m, 1] - gate - low[1]) / resolution), 0)
        j_last = min(math.floor((poles[m, 1] + gate - low[1]) / resolution), n_y - 1)
        for i in range(i_first, i_last + 1):
            for j in range(j_first, j_last + 1):
                d_x = low[0] + i * resolution - poles[m, 0]
                d_y = low[1] + j * resolution - poles[m, 1]
                distance = math.sqrt(d_x * d_x + d_y * d_y)
                if distance < out[i, j]:
                    out[i, j] = distance
