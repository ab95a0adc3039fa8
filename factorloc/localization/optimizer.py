"""Levenberg-Marquardt over a gtsam graph, with scan terms evaluated in one batch per step.

gtsam's own optimizers copy all values for every Python factor they call and weigh metres and radians alike. This loop
calls gtsam only to linearize native factors and to solve, so that its cost a step is gtsam's plus a little.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc.config import Block
from factorloc.errors import OptimizationError
from factorloc.factors.adaptors import hessian_factors
from factorloc.factors.native import pose_array
from factorloc.factors.scan_term import ScanCosts, ScanTerm
from factorloc.localization.feasible_poses import FeasiblePoses
from factorloc.result import Bounds, Iteration, StopReason

__all__ = ["Optimized", "OptimizerSettings", "ScanFactors", "optimize"]

Array = npt.NDArray[np.float64]


class OptimizerSettings(Block):
    """How a graph is optimized.

    Parameters
    ----------
    max_iterations : int
        Accepted steps on each level.
    relative_tolerance, absolute_tolerance : float
        A level ends when a step lowers the cost by less than either.
    initial_damping : float
        First damping; the least that is ever used.
    damping_factor : float
        Growth of the damping after a refused step.
    max_damping : float
        A level ends when this is not enough.
    lever_arm : float
        Distance at which a rotation counts as much as a translation, m: the damping of angles is its square.
    """

    max_iterations: int = Field(100, gt=0)
    relative_tolerance: float = Field(1e-5, ge=0)
    absolute_tolerance: float = Field(1e-3, ge=0)
    initial_damping: float = Field(1e-4, gt=0)
    damping_factor: float = Field(10.0, gt=1)
    max_damping: float = Field(1e10, gt=0)
    lever_arm: float = Field(3.0, gt=0)


@dataclass(frozen=True)
class ScanFactors:
    """Scans attached to poses of a graph.

    Parameters
    ----------
    term : ScanTerm
        Measurement model, one scan a key.
    keys : sequence of int
        Their poses, increasing.
    """

    term: ScanTerm
    keys: Sequence[int]


@dataclass(frozen=True)
class Optimized:
    """Where an optimization ended.

    Parameters
    ----------
    values : gtsam.Values
        Estimate.
    cost : float
        Cost of the native factors plus the scans'.
    scan_costs : ScanCosts or None
        Costs of the scans at the estimate.
    linear : gtsam.GaussianFactorGraph
        The graph linearized there.
    history : tuple of Iteration
        Accepted steps.
    stop : StopReason
        Why the last level ended.
    """

    values: gtsam.Values
    cost: float
    scan_costs: ScanCosts | None
    linear: gtsam.GaussianFactorGraph
    history: tuple[Iteration, ...]
    stop: StopReason


class _Damping:
    """Damping factors, which do not depend on the estimate: one cached graph for each step of the damping."""

    def __init__(self, keys: Sequence[int], dimension: int, settings: OptimizerSettings) -> None:
        self._keys, self._dimension, self._settings = keys, dimension, settings
        lever = settings.lever_arm
        self._roots = np.array([1.0, 1.0, lever] if dimension == 3 else [lever] * 3 + [1.0] * 3)
        self._graphs: dict[int, gtsam.GaussianFactorGraph] = {}

    def value(self, step: int) -> float:
        return self._settings.initial_damping * self._settings.damping_factor**step

    def graph(self, step: int) -> gtsam.GaussianFactorGraph:
        if step not in self._graphs:
            A = np.asfortranarray(np.diag(np.sqrt(self.value(step)) * self._roots))
            zero, unit = np.zeros(self._dimension), gtsam.noiseModel.Unit.Create(self._dimension)
            graph = gtsam.GaussianFactorGraph()
            for key in self._keys:
                graph.push_back(gtsam.JacobianFactor(key, A, zero, unit))
            self._graphs[step] = graph
        return self._graphs[step]


def optimize(
    graph: gtsam.NonlinearFactorGraph,
    initial: gtsam.Values,
    scans: ScanFactors | None = None,
    *,
    levels: Sequence[int] = (-1,),
    settings: OptimizerSettings | None = None,
    progress: Callable[[Iteration], None] | None = None,
    bounds: Mapping[int, Bounds] | None = None,
) -> Optimized:
    """Minimize a graph and its scans, through the levels of the map for the whole graph at once.

    A straggler cannot be pulled in by the finest map alone, nor by its neighbours alone; on a blurred level it can,
    and the rest of the graph holds what is right already.

    Parameters
    ----------
    graph : gtsam.NonlinearFactorGraph
        Native factors.
    initial : gtsam.Values
        Start, all of Pose2 or all of Pose3.
    scans : ScanFactors, optional
        Scan terms.
    levels : sequence of int
        Levels of the map, in order; ignored without scans.
    settings : OptimizerSettings, optional
        Steps and tolerances.
    progress : callable, optional
        Called after every accepted step.
    bounds : mapping of int to Bounds, optional
        Feasible sets of some poses, which hold the start and are never left: steps slide along their borders, and what
        would still leave them is recomputed with a higher damping.

    Raises
    ------
    OptimizationError
        If there is nothing to optimize, poses and factors do not fit, the start has no finite cost, or a pose begins
        outside of its bounds.
    """
    settings = settings or OptimizerSettings()
    if initial.size() == 0:
        raise OptimizationError("graph: no poses to optimize")
    keys = initial.keys()
    dimension = initial.zeroVectors().at(keys[0]).size
    if dimension not in (3, 6) or initial.dim() != dimension * len(keys):
        raise OptimizationError("graph: its variables are not all of Pose2 or all of Pose3")
    _check_keys(set(graph.keyVector()) | set(scans.keys if scans else ()), set(keys))
    damping = _Damping(keys, dimension, settings)
    feasible = FeasiblePoses(bounds or {})
    feasible.require(initial)
    state = _Descent(graph, gtsam.Values(initial), scans, damping, settings, progress, feasible)
    for level in levels if scans else (None,):
        state.run(level)
    return Optimized(state.values, state.cost, state.scan_costs, state.linearize(), tuple(state.history), state.stop)


def _check_keys(used: set[int], given: set[int]) -> None:
    for keys, lack in ((given - used, "are in no factor"), (used - given, "are in factors but have no start")):
        if keys:
            first = gtsam.DefaultKeyFormatter(min(keys))
            raise OptimizationError(f"graph: {len(keys)} of its poses {lack}, the first is {first}")


class _Descent:
    """The estimate on its way down."""

    def __init__(
        self,
        graph: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
        scans: ScanFactors | None,
        damping: _Damping,
        settings: OptimizerSettings,
        progress: Callable[[Iteration], None] | None,
        feasible: FeasiblePoses,
    ) -> None:
        self.feasible = feasible
        self.graph, self.values, self.scans = graph, values, scans
        self.damping, self.settings, self.progress = damping, settings, progress
        self.history: list[Iteration] = []
        self.stop = StopReason.MAX_ITERATIONS
        self.cost = np.inf
        self.scan_costs: ScanCosts | None = None
        self._ordering: Any = None
        self._step = 0

    def evaluate(self, values: gtsam.Values, level: int | None) -> tuple[float, ScanCosts | None]:
        cost = float(self.graph.error(values))
        if self.scans is None or level is None:
            return cost, None
        scan_costs = self.scans.term.batch(pose_array(values, self.scans.keys), level)
        return cost + float(scan_costs.cost.sum()), scan_costs

    def linearize(self) -> gtsam.GaussianFactorGraph:
        linear = self.graph.linearize(self.values)
        if self.scans is not None and self.scan_costs is not None:
            for factor in hessian_factors(self.scans.keys, self.scan_costs):
                linear.push_back(factor)
        return linear

    def run(self, level: int | None) -> None:
        """Descend on one level."""
        blur = 0.0 if self.scans is None or level is None else self.scans.term.blurs[level]
        self.cost, self.scan_costs = self.evaluate(self.values, level)
        if not np.isfinite(self.cost):
            raise OptimizationError(f"graph: the cost at the start is {self.cost}; check the initial poses")
        for _ in range(self.settings.max_iterations):
            linear = self.linearize()
            if self._ordering is None:
                self._ordering = gtsam.Ordering.ColamdGaussianFactorGraph(linear)
            before = self.cost
            trials = self._try_steps(linear, level)
            if trials == 0:
                return
            iteration = Iteration(blur, self.cost, self.damping.value(self._step), trials)
            self.history.append(iteration)
            if self.progress:
                self.progress(iteration)
            if trials == 1:  # a step that had to be damped asks for no less next time
                self._step = max(self._step - 1, 0)
            gain = before - self.cost
            if gain < max(self.settings.absolute_tolerance, self.settings.relative_tolerance * abs(before)):
                self.stop = StopReason.CONVERGED
                return
        self.stop = StopReason.MAX_ITERATIONS

    def _try_steps(self, linear: gtsam.GaussianFactorGraph, level: int | None) -> int:
        """Raise the damping until a step lowers the cost; the number of systems solved, 0 if none did."""
        trials = 0
        first_error: RuntimeError | None = None
        while self.damping.value(self._step) <= self.settings.max_damping:
            damped = gtsam.GaussianFactorGraph()
            damped.push_back(linear)
            damped.push_back(self.damping.graph(self._step))
            trials += 1
            try:
                delta = damped.optimize(self._ordering)
                if self.feasible.bounds:
                    delta = self.feasible.slide(damped, self._ordering, self.values, delta)
            except RuntimeError as error:  # gtsam's name for an indeterminate system
                first_error = first_error or error
                self._step += 1
                continue
            values = self.values.retract(delta)
            if self.feasible.bounds and not self.feasible.hold(values):
                self._step += 1
                continue
            cost, scan_costs = self.evaluate(values, level)
            if cost <= self.cost:
                self.values, self.cost, self.scan_costs = values, cost, scan_costs
                return trials
            if delta.norm() < 1e-6 * np.sqrt(self.values.size()):  # at the minimum, as far as it can be told
                self.stop, self._step = StopReason.SMALL_STEP, 0
                return 0
            self._step += 1
        self.stop, self._step = StopReason.MAX_DAMPING, 0
        if first_error is not None and not self.history:
            reason = " ".join(str(first_error).split()).partition(". ")[0]
            raise OptimizationError(f"graph: cannot be solved ({reason})")
        return 0
