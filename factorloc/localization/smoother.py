"""Smoothing: all poses of a drive at once, from scans, odometry and a prior."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import gtsam
import numpy as np
import numpy.typing as npt
from gtsam.symbol_shorthand import X

from factorloc.errors import GeometryError
from factorloc.factors.odometry import OdometryNoise, odometry_factors
from factorloc.factors.prior import PosePrior
from factorloc.factors.scan_term import ScanTerm
from factorloc.geometry import se2
from factorloc.localization.optimizer import Optimized, OptimizerSettings, ScanFactors, optimize, pose_array
from factorloc.result import Iteration, Result
from factorloc.trajectory import Trajectory

__all__ = ["marginal_covariances", "smooth"]

Array = npt.NDArray[np.float64]


def smooth(
    term: ScanTerm,
    odometry: npt.ArrayLike,
    initial: npt.ArrayLike,
    *,
    prior: PosePrior | None = None,
    known: npt.ArrayLike | None = None,
    stamps: npt.ArrayLike | None = None,
    noise: OdometryNoise | None = None,
    levels: Sequence[int] | None = None,
    settings: OptimizerSettings | None = None,
    progress: Callable[[Iteration], None] | None = None,
) -> Result:
    """Smooth a whole drive.

    The graph has a variable for each scan, robust odometry factors between neighbours, a prior on the first pose, and
    the scan term; it is solved through the levels of the map, coarse to fine.

    Parameters
    ----------
    term : ScanTerm
        Measurement model of all N scans.
    odometry : array_like, shape (N - 1, 3)
        Motions of the body between scans.
    initial : array_like, shape (N, 3)
        Start, for instance from tracking.
    prior : PosePrior, optional
        What is known of the first pose.
    known : array_like of bool, shape (N - 1,), optional
        Which motions were measured.
    stamps : array_like, shape (N,), optional
        Times; scan numbers by default.
    noise : OdometryNoise, optional
        Noise of the motions.
    levels : sequence of int, optional
        Levels of the map; by default those with a blur of at most 0.25 m.
    settings : OptimizerSettings, optional
        Steps and tolerances.
    progress : callable, optional
        Called after every accepted step.

    Returns
    -------
    Result
        Poses with marginal covariances, and the cost of every factor.

    Raises
    ------
    GeometryError
        If the numbers of scans, motions and poses disagree.
    OptimizationError
        If the graph cannot be solved.
    """
    poses = se2.as_poses(np.reshape(initial, (-1, 3)), "initial")
    motions = se2.as_poses(np.reshape(odometry, (-1, 3)), "odometry")
    if not len(poses) == term.scans == len(motions) + 1:
        raise GeometryError(f"smooth: {term.scans} scans, {len(poses)} poses, {len(motions)} motions do not fit")
    began = time.perf_counter()
    keys = [X(k) for k in range(len(poses))]
    graph = gtsam.NonlinearFactorGraph()
    kinds: list[str] = []
    if prior is not None:
        graph.push_back(prior.factor(keys[0]))
        kinds.append("prior")
    for factor in odometry_factors(keys, motions, noise or OdometryNoise(), known):
        graph.push_back(factor)
        kinds.append("odometry")
    values = gtsam.Values()
    for key, pose in zip(keys, poses, strict=True):
        values.insert(key, gtsam.Pose2(*pose))
    if levels is None:
        levels = [i for i, blur in enumerate(term.blurs) if blur <= 0.25] or [len(term.blurs) - 1]
    found = optimize(graph, values, ScanFactors(term, keys), levels=levels, settings=settings, progress=progress)
    times = np.arange(len(poses), dtype=np.float64) if stamps is None else np.asarray(stamps, np.float64)
    trajectory = Trajectory(times, pose_array(found.values), marginal_covariances(found, keys))
    errors = np.array([graph.at(i).error(found.values) for i in range(graph.size())])
    residuals = {kind: errors[[k == kind for k in kinds]] for kind in dict.fromkeys(kinds)}
    if found.scan_costs is not None:
        residuals["scan"] = found.scan_costs.cost
    missing = 0 if known is None else int((~np.asarray(known, bool)).sum())
    return Result(
        trajectory,
        found.cost,
        found.history,
        found.stop,
        residuals,
        {"motions not measured": missing},
        time.perf_counter() - began,
    )


def marginal_covariances(found: Optimized, keys: Sequence[int]) -> Array:
    """Marginal covariance of each pose, shape (N, d, d), in the tangent space of the body."""
    marginals = gtsam.Marginals(found.linear, found.values)
    return np.array([marginals.marginalCovariance(key) for key in keys])
