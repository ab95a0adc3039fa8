"""From the costs of scans to factors: Gaussian ones for batch solvers, square-root custom ones for incremental ones."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import gtsam
import numpy as np
import numpy.typing as npt

from factorloc.errors import OptimizationError
from factorloc.factors._custom import custom_factor
from factorloc.factors.scan_term import ScanCosts, ScanTerm

__all__ = ["hessian_factors", "square_root_factor", "square_root_form"]

Array = npt.NDArray[np.float64]


def hessian_factors(keys: Sequence[int], costs: ScanCosts) -> Iterator[gtsam.HessianFactor]:
    """Quadratic models of scan costs at the poses they were evaluated at.

    A Hessian factor's error is ``x'Hx/2 - x'b + f/2``; so ``b`` is the negative gradient and ``f`` twice the cost,
    which may be negative.

    Parameters
    ----------
    keys : sequence of int
        Variable of each pose.
    costs : ScanCosts
        Their costs, gradients and Hessians.

    Yields
    ------
    gtsam.HessianFactor
        One a pose.
    """
    for key, cost, gradient, hessian in zip(keys, costs.cost, costs.gradient, costs.hessian, strict=True):
        yield gtsam.HessianFactor(key, hessian, -gradient, 2 * cost)


def square_root_form(cost: float, gradient: Array, hessian: Array, least_cost: float) -> tuple[Array, Array]:
    """Residual and Jacobian of ``d + 1`` rows that equal a cost to second order.

    With ``H = L L'``: rows ``L'`` with residual ``L^-1 g``, and one row without Jacobian that carries the rest. Then
    ``J'J = H``, ``J'r = g`` and ``|r|^2 / 2 = cost - least_cost``, all exactly. Directions without curvature get a
    little, so that the factor is never singular.

    Parameters
    ----------
    cost : float
        Cost at the pose.
    gradient : ndarray, shape (d,)
    hessian : ndarray, shape (d, d)
        Positive semi-definite.
    least_cost : float
        Lower bound of the cost, the same at every call.

    Returns
    -------
    residual : ndarray, shape (d + 1,)
    jacobian : ndarray, shape (d + 1, d)

    Raises
    ------
    OptimizationError
        If the bound is too high for the quadratic model: ``2 (cost - least_cost) < g' H^-1 g``.
    """
    d = len(gradient)
    values, vectors = np.linalg.eigh(hessian)
    roots = np.sqrt(np.maximum(values, max(1e-9 * values.max(), 1e-9)))
    residual = np.zeros(d + 1)
    jacobian = np.zeros((d + 1, d))
    jacobian[:d] = roots[:, None] * vectors.T
    residual[:d] = (vectors.T @ gradient) / roots
    rest = 2 * (cost - least_cost) - residual[:d] @ residual[:d]
    if rest < 0:
        raise OptimizationError(f"scan factor: least cost {least_cost:.3f} is no bound of cost {cost:.3f}; lower it")
    residual[d] = np.sqrt(rest)
    return residual, jacobian


def square_root_factor(key: int, term: ScanTerm, scan: int, level: int = -1) -> gtsam.CustomFactor:
    """Make a custom factor of one scan for ISAM2 and fixed-lag smoothers.

    Its error is the cost above the least cost of the scan. Never wrap it in robust noise: the rays are weighed inside.
    In gtsam's *batch* optimizers every call of a Python factor copies all values; use :func:`hessian_factors` there.

    Parameters
    ----------
    key : int
        The pose.
    term : ScanTerm
        Model of all scans.
    scan : int
        Which of them.
    level : int
        Level of the map pyramid.
    """
    index = np.array([scan], np.int64)
    # Half the least cost again below: the quadratic model must fit under the bound, too.
    least = float(term.least_cost(level)[scan])
    margin = 1.0 + 0.5 * abs(least)

    def residual(values: gtsam.Values, want_jacobians: bool) -> tuple[Array, list[Array]]:
        pose = values.atPose2(key)
        row = np.array([[pose.x(), pose.y(), pose.theta()]])
        if not want_jacobians:
            error = np.zeros(4)
            error[0] = np.sqrt(2 * (float(term.cost(row, level, index)[0]) - least + margin))
            return error, []
        costs = term.batch(row, level, index)
        error, jacobian = square_root_form(float(costs.cost[0]), costs.gradient[0], costs.hessian[0], least - margin)
        return error, [jacobian]

    return custom_factor(gtsam.noiseModel.Unit.Create(4), [key], [3], 4, residual)
