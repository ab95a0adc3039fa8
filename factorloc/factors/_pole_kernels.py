"""Detected poles against landmarks: a mixture of which only the likeliest part counts, beside "not in the map"."""

import math

from factorloc._jit import kernel


@kernel(allocates=False)
def best_landmark(
    x, y, variance, width, height, log_null, starts, points, attributes, shape, low, cell, numbers,
):  # fmt: skip
    """Likeliest landmark of a detection at a place of the map.

    Parameters
    ----------
    x, y : float
        Place of the detection, m.
    variance : float
        Of its position, blur included, m^2.
    width, height : float
        m.
    log_null : float
        Log density of detections that are not in the map, 1/m^2.
    starts, points, shape, low, cell
        Landmarks by cells (:class:`factorloc.mapping.point_cells.PointCells`).
    attributes : (L, 4) float64
        Variance, m^2, width and height, m, and log probability to be there, in the order of the points.
    numbers : (3,) float64
        Inverse variances of width and of height, and the most either costs.

    Returns
    -------
    best : int
        Row of the landmark; -1 if the detection is likelier not in the map.
    cost : float
        Negative log-likelihood ratio, at most 0.
    total : float
        Variance of the difference of detection and landmark, m^2.
    """
    best = -1
    least = 0.0
    total = 1.0
    i = math.floor((x - low[0]) / cell)
    j = math.floor((y - low[1]) / cell)
    first = int(max(j - 1, 0))
    last = int(min(j + 2, shape[1]))
    if first < last:
        for row in range(int(max(i - 1, 0)), int(min(i + 2, shape[0]))):
            for m in range(starts[row * shape[1] + first], starts[row * shape[1] + last]):
                d_x = points[m, 0] - x
                d_y = points[m, 1] - y
                v = variance + attributes[m, 0]
                cost = 0.5 * (d_x * d_x + d_y * d_y) / v + math.log(2.0 * math.pi * v) + log_null - attributes[m, 3]
                if cost < least:
                    cost += min(0.5 * numbers[0] * (width - attributes[m, 1]) ** 2, numbers[2])
                    cost += min(0.5 * numbers[1] * (height - attributes[m, 2]) ** 2, numbers[2])
                    if cost < least:
                        best, least, total = m, cost, v
    return best, least, total


@kernel(allocates=False)
def pole_batch(
    poses, index, offsets, detections, places, blur, starts, points, attributes, shape, low, cell, numbers,
    information, cost, gradient, hessian,
):  # fmt: skip
    """Cost, gradient and Hessian of the detections of each pose, in the tangent space of the body.

    Parameters
    ----------
    poses : (N, 3) float64
        T_map_body.
    index : (N,) int64
        Local map of each pose.
    offsets : (S + 1,) int64
        First detection of each local map.
    detections : (K, 4) float64
        Variance, m^2, width and height, m, and log density of null of each detection.
    places : (K, 2) float64
        Detections in the frame of the body, m.
    blur : float
        Added to every standard deviation in quadrature, m.
    starts, points, attributes, shape, low, cell, numbers
        As :func:`best_landmark`.
    information : float
        Factor of all costs.
    cost, gradient, hessian : (N,), (N, 3), (N, 3, 3) float64
        Written.
    """
    for n in range(poses.shape[0]):
        c = math.cos(poses[n, 2])
        s = math.sin(poses[n, 2])
        sum_cost = 0.0
        g_x = g_y = g_t = 0.0
        h_xx = h_xt = h_yt = h_tt = 0.0
        for k in range(offsets[index[n]], offsets[index[n] + 1]):
            b_x = places[k, 0]
            b_y = places[k, 1]
            x = poses[n, 0] + c * b_x - s * b_y
            y = poses[n, 1] + s * b_x + c * b_y
            best, least, total = best_landmark(
                x, y, detections[k, 0] + blur * blur, detections[k, 1], detections[k, 2], detections[k, 3], starts,
                points, attributes, shape, low, cell, numbers,
            )  # fmt: skip
            if best < 0:
                continue
            sum_cost += least
            e_x = x - points[best, 0]
            e_y = y - points[best, 1]
            w = 1.0 / total
            # The difference in the frame of the body: it moves by v, and by omega times [-b_y, b_x].
            r_x = c * e_x + s * e_y
            r_y = -s * e_x + c * e_y
            g_x += w * r_x
            g_y += w * r_y
            g_t += w * (b_x * r_y - b_y * r_x)
            h_xx += w
            h_xt -= w * b_y
            h_yt += w * b_x
            h_tt += w * (b_x * b_x + b_y * b_y)
        cost[n] = information * sum_cost
        gradient[n, 0] = information * g_x
        gradient[n, 1] = information * g_y
        gradient[n, 2] = information * g_t
        hessian[n, 0, 0] = hessian[n, 1, 1] = information * h_xx
        hessian[n, 0, 1] = hessian[n, 1, 0] = 0.0
        hessian[n, 0, 2] = hessian[n, 2, 0] = information * h_xt
        hessian[n, 1, 2] = hessian[n, 2, 1] = information * h_yt
        hessian[n, 2, 2] = information * h_tt


@kernel(allocates=False)
def match_places(detections, places, blur, starts, points, attributes, shape, low, cell, numbers, matches, costs):
    """Likeliest landmark of each detection, whose places (K, 2) are those in the map.

    Parameters
    ----------
    detections, places, blur, starts, points, attributes, shape, low, cell, numbers
        As :func:`pole_batch`.
    matches : (K,) int64
        Row of the landmark, -1 for none; written.
    costs : (K,) float64
        Negative log-likelihood ratios; written.
    """
    for k in range(places.shape[0]):
        matches[k], costs[k], _ = best_landmark(
            places[k, 0], places[k, 1], detections[k, 0] + blur * blur, detections[k, 1], detections[k, 2],
            detections[k, 3], starts, points, attributes, shape, low, cell, numbers,
        )  # fmt: skip
