"""A crossing with four blocks of houses, its true shifted walls, and points on them."""

import numpy as np

from factorloc.geometry import se2
from factorloc.intervals import Box
from factorloc.mapping.facade_points import FacadePoints
from factorloc.mapping.facades import Facades

SHIFT, VERTEX = 0.5, 0.05


def crossing(rng):
    """Facades as mapped, and the true segments, shape (F, 2, 2)."""
    mapped, true, owners, number = [], [], [], 0
    for sign_x in (-1, 1):
        for sign_y in (-1, 1):
            for k in range(3):
                for axis in (0, 1):
                    if axis == 1 and k == 0:
                        continue
                    at = 8.0 + 13.0 * k
                    low, high = (np.array([at, 7.0]), np.array([at + 12.0, 17.0]))
                    if axis:
                        low, high = low[::-1], high[::-1]
                    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]]) * [sign_x, sign_y]
                    if sign_x * sign_y < 0:
                        corners = corners[::-1]
                    moved = corners + rng.uniform(-SHIFT, SHIFT, 2) + rng.uniform(-VERTEX, VERTEX, (4, 2))
                    for i in range(4):
                        mapped.append(corners[[i, (i + 1) % 4]])
                        true.append(moved[[i, (i + 1) % 4]])
                        owners.append(number)
                    number += 1
    count = len(mapped)
    facades = Facades(np.array(mapped), np.array(owners), np.full(count, SHIFT), np.full(count, VERTEX))
    return facades, np.array(true)


def points_on(true, rows, pose, rng, error=0.05, spacing=0.2):
    """Points of true walls in the frame of the body, with errors in their boxes, and the wall of each."""
    along, of = [], []
    for row in rows:
        start, end = true[row]
        share = np.arange(0.0, 1.0, spacing / np.hypot(*(end - start)))[:, None]
        along.append(start + share * (end - start))
        of.append(np.full(len(share), row))
    exact = se2.transform(se2.inverse(pose), np.concatenate(along))
    measured = exact + rng.uniform(-error, error, exact.shape)
    return FacadePoints(measured, Box.around(measured.T, error), np.arange(len(exact)), {}), np.concatenate(of)
