"""The own Levenberg-Marquardt loop against gtsam's, on graphs of native factors alone.

Winding chains of poses with odometry, a prior at every tenth pose and a loop closure for every twentieth are optimized
by both from the same start; time per iteration, interleaved. Both must find the same optimum.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np
import numpy.typing as npt

from benchmarks.bars import Bar, plot_bars
from benchmarks.harness import Benchmark, arguments, one_line_errors
from benchmarks.timing import interleave, ratio, spread
from factorloc.localization import OptimizerSettings, optimize

Array = npt.NDArray[np.float64]

ROUNDS = {False: 9, True: 3}
"""Rounds of a full and of a quick run."""

MOST_TIME = 1.6
"""Goal: time per iteration, as a multiple of gtsam's."""

MOST_COST = 1e-6
"""Goal: difference of the costs at the two optima, as a fraction of gtsam's."""

_PRIOR_EVERY, _LOOP_EVERY = 10, 20


@dataclass(frozen=True)
class Space:
    """Where the poses live, with sigmas in the order of its tangent vectors (rad and m).

    Parameters
    ----------
    pose, between, prior : type
        gtsam's classes.
    step : ndarray
        Tangent vector of a step of 1 m, without its turn.
    turning : int
        Which component of it turns.
    odometry, anchor : ndarray
        Sigmas of odometry and loop closures, and of priors.
    """

    pose: Any
    between: Any
    prior: Any
    step: Array
    turning: int
    odometry: Array
    anchor: Array


SPACES = {
    "Pose2": Space(
        gtsam.Pose2,
        gtsam.BetweenFactorPose2,
        gtsam.PriorFactorPose2,
        step=np.array([1.0, 0.0, 0.0]),
        turning=2,
        odometry=np.array([0.05, 0.05, 0.01]),
        anchor=np.array([0.3, 0.3, 0.05]),
    ),
    "Pose3": Space(
        gtsam.Pose3,
        gtsam.BetweenFactorPose3,
        gtsam.PriorFactorPose3,
        step=np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0]),
        turning=2,
        odometry=np.array([0.01, 0.01, 0.01, 0.05, 0.05, 0.05]),
        anchor=np.array([0.05, 0.05, 0.05, 0.3, 0.3, 0.3]),
    ),
}


@one_line_errors
def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; the exit code is 1 if a goal is missed."""
    given = arguments("solver", __doc__ or "", argv, sizes=(1_000, 10_000), rounds=0)
    sizes, rounds = given.options["sizes"], given.options["rounds"] or ROUNDS[given.quick]
    bench = Benchmark("solver", {"poses": sizes, "rounds": rounds, "quick": given.quick})
    bars = {}
    for name, space in SPACES.items():
        for poses in sizes:
            bars[f"{name}, {poses} poses"] = compare(bench, f"{name}, {poses} poses", *chain(space, poses), rounds)
    return bench.finish(given, plot_bars(bars, "ms/iteration", share=False))


def compare(
    bench: Benchmark, name: str, graph: gtsam.NonlinearFactorGraph, initial: gtsam.Values, rounds: int
) -> list[Bar]:
    """Time both optimizers on one graph, add figures and goals, and return the bars of the picture."""
    parameters = gtsam.LevenbergMarquardtParams()
    settings = OptimizerSettings(
        relative_tolerance=parameters.getRelativeErrorTol(), absolute_tolerance=parameters.getAbsoluteErrorTol()
    )
    costs, iterations = {}, {}

    def run_gtsam() -> None:
        optimizer = gtsam.LevenbergMarquardtOptimizer(graph, initial, parameters)
        optimizer.optimize()
        costs["gtsam"], iterations["gtsam"] = optimizer.error(), optimizer.iterations()

    def run_own() -> None:
        optimized = optimize(graph, initial, settings=settings)
        costs["factorloc"], iterations["factorloc"] = optimized.cost, len(optimized.history)

    seconds = interleave({"gtsam": run_gtsam, "factorloc": run_own}, rounds)
    times = {solver: values / max(iterations[solver], 1) for solver, values in seconds.items()}
    bars = []
    for solver, values in times.items():
        median, quartiles = 1e3 * float(np.median(values)), spread(1e3 * values)
        bench.figure(f"{name}: {solver}", median, "ms/iteration", quartiles)
        bench.figure(f"{name}: {solver}, iterations", iterations[solver], "1")
        bound = None if solver == "gtsam" else MOST_TIME * bench.figures[f"{name}: gtsam"][0]
        bars.append(Bar(solver, median, quartiles, bound))
    bench.goal(f"{name}: factorloc / gtsam", ratio(times, "factorloc", "gtsam"), "1", MOST_TIME)
    difference = abs(costs["factorloc"] - costs["gtsam"]) / costs["gtsam"]
    bench.goal(f"{name}: difference of costs", difference, "1", MOST_COST)
    return bars


def chain(space: Space, poses: int, seed: int = 0) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """Make a graph, and a start as far off as three sigmas of its priors."""
    rng = np.random.default_rng(seed)
    odometry, anchor = (gtsam.noiseModel.Diagonal.Sigmas(sigmas) for sigmas in (space.odometry, space.anchor))
    graph, initial = gtsam.NonlinearFactorGraph(), gtsam.Values()
    truth = [space.pose()]
    for k in range(poses - 1):
        step = space.step.copy()
        step[space.turning] = 0.05 * math.sin(k / 50)
        motion = space.pose.Expmap(step)
        truth.append(truth[-1].compose(motion))
        graph.push_back(space.between(k, k + 1, motion.retract(rng.normal(0.0, space.odometry)), odometry))
    for k in range(0, poses, _PRIOR_EVERY):
        graph.push_back(space.prior(k, truth[k].retract(rng.normal(0.0, space.anchor)), anchor))
    for _ in range(poses // _LOOP_EVERY):
        i, j = sorted(int(k) for k in rng.choice(poses, 2, replace=False))
        seen = truth[i].between(truth[j]).retract(rng.normal(0.0, space.odometry))
        graph.push_back(space.between(i, j, seen, odometry))
    for k, pose in enumerate(truth):
        initial.insert(k, pose.retract(rng.normal(0.0, 3.0 * space.anchor)))
    return graph, initial


if __name__ == "__main__":
    sys.exit(main())
