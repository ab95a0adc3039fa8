"""The own Levenberg-Marquardt loop against gtsam's optimizer, on graphs of native factors only.

Chains of poses with priors at every tenth and loop closures at every twentieth; time per iteration, interleaved.
"""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X

from benchmarks.harness import Benchmark, arguments
from factorloc.localization import OptimizerSettings, optimize

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST = 1.6
SIZES = (1_000, 10_000)


def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; the exit code is 1 if a goal is missed."""
    given = arguments("solver", __doc__ or "", argv)
    rounds = 3 if given.quick else 9
    bench = Benchmark("solver", {"sizes": SIZES, "rounds": rounds, "quick": given.quick})
    times: dict[str, tuple[float, float]] = {}
    for dimension in (2, 3):
        for poses in SIZES:
            name = f"Pose{dimension}, {poses} poses"
            theirs, ours = _measure(dimension, poses, rounds)
            bench.figure(f"{name}: gtsam", 1e3 * float(np.median(theirs)), "ms/iteration")
            bench.figure(f"{name}: factorloc", 1e3 * float(np.median(ours)), "ms/iteration")
            bench.goal(f"{name}: ratio", float(np.median(ours / theirs)), "1", MOST)
            times[name] = float(np.median(theirs)), float(np.median(ours))
    return bench.finish(given, _picture(times))


def _measure(dimension: int, poses: int, rounds: int) -> tuple[np.ndarray, np.ndarray]:
    graph, initial = chain(dimension, poses)
    theirs, ours = np.empty(rounds), np.empty(rounds)
    tolerances = OptimizerSettings(relative_tolerance=1e-5, absolute_tolerance=1e-5)
    for k in range(rounds):
        began = time.perf_counter()
        optimizer = gtsam.LevenbergMarquardtOptimizer(graph, initial, gtsam.LevenbergMarquardtParams())
        values = gtsam.Values(optimizer.optimize())
        theirs[k] = (time.perf_counter() - began) / optimizer.iterations()
        began = time.perf_counter()
        found = optimize(graph, initial, settings=tolerances)
        ours[k] = (time.perf_counter() - began) / len(found.history)
        reference = graph.error(values)
        if abs(found.cost - reference) > 1e-4 * reference:
            raise AssertionError(f"different optima: {found.cost} and {reference}")
    return theirs, ours


def chain(dimension: int, poses: int, seed: int = 0) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """A chain with noisy odometry, priors at every tenth pose, loops for every twentieth, and a noisy start."""
    rng = np.random.default_rng(seed)
    planar = dimension == 2
    step_sigmas = np.array([0.05, 0.05, 0.01] if planar else [0.01] * 3 + [0.05] * 3)
    prior_sigmas = np.array([0.3, 0.3, 0.05] if planar else [0.05] * 3 + [0.3] * 3)
    pose, between, prior = (
        (gtsam.Pose2, gtsam.BetweenFactorPose2, gtsam.PriorFactorPose2)
        if planar
        else (gtsam.Pose3, gtsam.BetweenFactorPose3, gtsam.PriorFactorPose3)
    )
    step_noise = gtsam.noiseModel.Diagonal.Sigmas(step_sigmas)
    prior_noise = gtsam.noiseModel.Diagonal.Sigmas(prior_sigmas)
    graph, initial = gtsam.NonlinearFactorGraph(), gtsam.Values()
    truth = [pose()]
    for k in range(poses - 1):
        turn = 0.05 * np.sin(k / 50)
        step = gtsam.Pose2(1.0, 0.0, turn) if planar else gtsam.Pose3(gtsam.Rot3.Ypr(turn, 0.0, 0.0), [1.0, 0.0, 0.0])
        truth.append(truth[-1].compose(step))
        graph.add(between(X(k), X(k + 1), step.retract(rng.normal(0, step_sigmas)), step_noise))
    for k in range(0, poses, 10):
        graph.add(prior(X(k), truth[k].retract(rng.normal(0, prior_sigmas)), prior_noise))
    for i, j in np.sort(rng.integers(0, poses, (poses // 20, 2)), axis=1):
        if i != j:
            loop = truth[i].between(truth[j]).retract(rng.normal(0, step_sigmas))
            graph.add(between(X(int(i)), X(int(j)), loop, step_noise))
    for k in range(poses):
        initial.insert(X(k), truth[k].retract(rng.normal(0, 3 * prior_sigmas)))
    return graph, initial


def _picture(times: dict[str, tuple[float, float]]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 3.2), layout="constrained")
    axes = figure.add_subplot()
    places = np.arange(len(times))
    for offset, (label, colour) in enumerate([("gtsam", "#999999"), ("factorloc", "#0072B2")]):
        values = [1e3 * pair[offset] for pair in times.values()]
        bars = axes.barh(places + 0.4 * offset, values, 0.38, color=colour, label=label)
        axes.bar_label(bars, fmt="%.1f", padding=3)
    axes.set_yticks(places + 0.2, list(times))
    axes.invert_yaxis()
    axes.set_xscale("log")
    axes.set_xlabel("ms per iteration")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    return figure


if __name__ == "__main__":
    sys.exit(main())
