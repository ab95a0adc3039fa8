"""Feasible poses: sets that poses of a graph must not leave, and steps that slide along their borders.

As published, a step that would leave a feasible set is recomputed with a higher damping. For a graph that alone is not
enough: one pose at its border would hold back all others, and itself along the border. So first, as in a primal-dual
active set method, the half-planes and heading bounds that a step violates are added to it as stiff rows, and rows that
pull a pose back to the border are let go; what then still leaves its set is damped.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import gtsam
import numpy as np
import numpy.typing as npt

from factorloc.errors import OptimizationError
from factorloc.result import Bounds

__all__ = ["FeasiblePoses"]

Array = npt.NDArray[np.float64]
Row = tuple[int, int]

_STIFF = 1e5  # weight of a violated bound; a pose is at its border to a tiny part of its pull
_INSET = 1e-6  # m and rad; stiff rows aim that much inside
_ROUNDS = 12


class FeasiblePoses:
    """Feasible sets of some poses of a graph: of their position in the plane and their heading.

    Parameters
    ----------
    bounds : mapping of int to Bounds
        By key, each with a pose inside.

    Raises
    ------
    OptimizationError
        If a set is empty.
    """

    def __init__(self, bounds: Mapping[int, Bounds]) -> None:
        self.bounds = dict(bounds)
        for key, one in self.bounds.items():
            if one.is_empty:
                name = gtsam.DefaultKeyFormatter(key)
                raise OptimizationError(f"bounds: those of {name} are empty; its assumptions are violated")

    def require(self, values: gtsam.Values) -> None:
        """Check that a start is feasible.

        Raises
        ------
        OptimizationError
            If a pose is missing or outside of its set.
        """
        for key, one in self.bounds.items():
            name = gtsam.DefaultKeyFormatter(key)
            if not values.exists(key):
                raise OptimizationError(f"bounds: {name} is no pose of the graph")
            if not one.contains(_planar(values, key)):
                raise OptimizationError(f"bounds: {name} begins outside of its set; begin at Bounds.nearest")

    def hold(self, values: gtsam.Values) -> bool:
        """Whether all poses are inside."""
        return all(one.contains(_planar(values, key)) for key, one in self.bounds.items())

    def slide(
        self, damped: gtsam.GaussianFactorGraph, ordering: Any, values: gtsam.Values, delta: gtsam.VectorValues
    ) -> gtsam.VectorValues:
        """Change a step so that it stays within the bounds it would violate, as far as they are linear.

        Parameters
        ----------
        damped : gtsam.GaussianFactorGraph
            What the step solves.
        ordering : gtsam.Ordering
            Of its variables.
        values : gtsam.Values
            Where it begins.
        delta : gtsam.VectorValues
            The step.

        Raises
        ------
        RuntimeError
            As gtsam does, if a system is indeterminate.
        """
        rows = dict[int, tuple[Array, Bounds]]()
        active: dict[Row, float] = {}
        for _ in range(_ROUNDS):
            wanted: dict[Row, float] = {}
            inside = True
            for key, one in self.bounds.items():
                held = {number: limit for (other, number), limit in active.items() if other == key}
                step = delta.at(key)
                after = _planar_after(values, key, step)
                if not held and one.contains(after):
                    continue
                inside = inside and one.contains(after)
                if key not in rows:
                    rows[key] = _rows(one, values, key)
                A, piece = rows[key]
                linear, beyond = A @ step, _beyond(piece, after)
                for number in range(len(A)):
                    # Held rows that no longer push are let go. A step on the group is not linear: rows are corrected
                    # by what it makes of the last one.
                    pushes = number in held and linear[number] > held[number]
                    if pushes or (number not in held and beyond[number] > 0.0):
                        wanted[key, number] = float(linear[number] - beyond[number] - _INSET)
            if inside and wanted.keys() == active.keys():
                break
            active = wanted
            system = gtsam.GaussianFactorGraph()
            system.push_back(damped)
            unit = gtsam.noiseModel.Unit.Create(1)
            for (key, number), limit in sorted(active.items()):
                line = np.asfortranarray(_STIFF * rows[key][0][number : number + 1])
                system.push_back(gtsam.JacobianFactor(key, line, np.array([_STIFF * limit]), unit))
            delta = system.optimize(ordering)
        return delta


def _planar(values: gtsam.Values, key: int) -> Array:
    try:
        pose = values.atPose2(key)
        return np.array([pose.x(), pose.y(), pose.theta()])
    except RuntimeError:
        T = values.atPose3(key).matrix()
        return np.array([T[0, 3], T[1, 3], math.atan2(T[1, 0], T[0, 0])])


def _planar_after(values: gtsam.Values, key: int, step: Array) -> Array:
    if len(step) == 3:
        pose = values.atPose2(key).retract(step)
        return np.array([pose.x(), pose.y(), pose.theta()])
    T = values.atPose3(key).retract(step).matrix()
    return np.array([T[0, 3], T[1, 3], math.atan2(T[1, 0], T[0, 0])])


def _beyond(piece: Bounds, pose: Array) -> Array:
    """How far a pose is beyond each edge of a convex set (m), and beyond the bounds of its heading (rad)."""
    polygon = piece.polygons[0]
    edge = np.roll(polygon, -1, 0) - polygon
    length = np.maximum(np.hypot(edge[:, 0], edge[:, 1]), 1e-300)
    away = pose[:2] - polygon
    turn, (low, high) = piece.heading(pose[2]), piece.orientation
    return np.append((edge[:, 1] * away[:, 0] - edge[:, 0] * away[:, 1]) / length, [turn - high, low - turn])


def _rows(bounds: Bounds, values: gtsam.Values, key: int) -> tuple[Array, Bounds]:
    """Derivatives of :func:`_beyond` by a step, and the convex part of the set that holds the pose."""
    x, y, theta = _planar(values, key)
    parts = [Bounds(bounds.orientation, (one,)) for one in bounds.polygons]
    piece = next((part for part in parts if part.contains([x, y, theta])), parts[0])
    polygon = piece.polygons[0]
    edge = np.roll(polygon, -1, 0) - polygon
    normal = np.stack([edge[:, 1], -edge[:, 0]], -1) / np.maximum(np.hypot(edge[:, 0], edge[:, 1]), 1e-300)[:, None]
    try:
        values.atPose2(key)
        c, s = math.cos(theta), math.sin(theta)
        A = np.zeros((len(normal) + 2, 3))
        A[:-2, :2] = normal @ np.array([[c, -s], [s, c]])
        A[-2, 2], A[-1, 2] = 1.0, -1.0
    except RuntimeError:
        R = values.atPose3(key).matrix()[:3, :3]
        A = np.zeros((len(normal) + 2, 6))
        A[:-2, 3:] = normal @ R[:2]
        # The first column of R moves by R (omega x e_x); yaw is its angle in the plane.
        flat = R[0, 0] ** 2 + R[1, 0] ** 2
        first = R[0, 0] * R[1, 1] - R[1, 0] * R[0, 1]
        second = R[0, 0] * R[1, 2] - R[1, 0] * R[0, 2]
        A[-2, 1:3] = -second / flat, first / flat
        A[-1] = -A[-2]
    return A, piece
