"""Smoothing: all poses of a drive at once, from scans, odometry and a prior."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import gtsam
import numpy as np
import numpy.typing as npt
from gtsam.symbol_shorthand import X

from factorloc.errors import GeometryError, OptimizationError
from factorloc.factors.grid_scan_term import GridScanTerm
from factorloc.factors.native import pose_array, pose_values
from factorloc.factors.odometry import OdometryNoise, known_motions, motion_covariances, odometry_factors
from factorloc.factors.prior import PosePrior
from factorloc.factors.scan_term import ScanTerm
from factorloc.factors.spatial_scan_term import SpatialScanTerm
from factorloc.geometry import group_of
from factorloc.localization.candidates import choose_poses
from factorloc.localization.optimizer import Optimized, OptimizerSettings, ScanFactors, optimize
from factorloc.localization.registration import register_many
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
    covariances: npt.ArrayLike | None = None,
    stamps: npt.ArrayLike | None = None,
    frame: str = "map",
    noise: OdometryNoise | None = None,
    levels: Sequence[int] | None = None,
    settings: OptimizerSettings | None = None,
    progress: Callable[[Iteration], None] | None = None,
) -> Result:
    """Smooth a whole drive.

    The graph has a variable for each scan, robust odometry factors between neighbours, a prior on the first pose, and
    the scan term; it is solved through the levels of the map, coarse to fine. Then every scan takes the best of where
    it started, where the graph left it and where it registers by itself, all scans jointly
    (:mod:`factorloc.localization.candidates`), and the graph is solved once more on the finest level. So the cost is
    never above that of the start.

    Parameters
    ----------
    term : ScanTerm
        Measurement model of all N scans.
    odometry : array_like, shape (N - 1, 3) or (N - 1, 4, 4)
        Motions of the body between scans.
    initial : array_like, shape (N, 3) or (N, 4, 4)
        Start, for instance from tracking.
    prior : PosePrior, optional
        What is known of the first pose.
    known : array_like of bool, shape (N - 1,), optional
        Which motions were measured.
    covariances : array_like, shape (N - 1, 3, 3) or (N - 1, 6, 6), optional
        Of the motions; those of the noise model by default.
    stamps : array_like, shape (N,), optional
        Times; scan numbers by default.
    frame : str
        Name of the map's frame.
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
        If the numbers of scans, motions, flags and poses disagree.
    OptimizationError
        If the graph cannot be solved.
    """
    group = group_of(3 if np.ndim(initial) == 3 else 2)
    poses, motions = group.as_poses(initial, "initial"), group.as_poses(odometry, "odometry")
    if len(poses) != term.scans or motions.shape != (term.scans - 1, *poses.shape[1:]):
        raise GeometryError(f"smooth: {term.scans} scans, poses {poses.shape} and motions {motions.shape} do not fit")
    measured = known_motions(known, len(motions))
    began = time.perf_counter()
    keys = [X(k) for k in range(len(poses))]
    graph = gtsam.NonlinearFactorGraph()
    kinds: list[str] = []
    if prior is not None:
        graph.push_back(prior.factor(keys[0]))
        kinds.append("prior")
    noise = noise or OdometryNoise()
    of_motions = motion_covariances(motions, noise, covariances)
    for factor in odometry_factors(keys, motions, noise, measured, of_motions):
        graph.push_back(factor)
        kinds.append("odometry")
    values = pose_values(keys, poses)
    if levels is None:
        levels = [i for i, blur in enumerate(term.blurs) if blur <= 0.25] or [len(term.blurs) - 1]
    scans = ScanFactors(term, keys)
    coarse = optimize(graph, values, scans, levels=levels, settings=settings, progress=progress)
    smoothed = pose_array(coarse.values)
    candidates = [poses, smoothed]
    if isinstance(term, GridScanTerm | SpatialScanTerm):
        # Each scan alone, from where the graph holds it: a pose that others keep from moving gets its own steps.
        candidates.append(register_many(term, smoothed, np.arange(len(poses)), levels=levels[-2:]).poses)
    chosen = choose_poses(candidates, term, motions, noise, measured, prior, of_motions)
    found = optimize(graph, pose_values(keys, chosen), scans, settings=settings, progress=progress)
    times = np.arange(len(poses), dtype=np.float64) if stamps is None else np.asarray(stamps, np.float64)
    trajectory = Trajectory(times, pose_array(found.values), marginal_covariances(found, keys), world=frame)
    errors = np.array([graph.at(i).error(found.values) for i in range(graph.size())])
    residuals = {kind: errors[[k == kind for k in kinds]] for kind in dict.fromkeys(kinds)}
    if found.scan_costs is not None:
        residuals["scan"] = found.scan_costs.cost
    return Result(
        trajectory,
        found.cost,
        coarse.history + found.history,
        found.stop,
        residuals,
        {"motions not measured": int((~measured).sum())},
        time.perf_counter() - began,
    )


def marginal_covariances(found: Optimized, keys: Sequence[int]) -> Array:
    """Marginal covariance of each pose, shape (N, d, d), in the tangent space of the body.

    Raises
    ------
    OptimizationError
        If nothing determines some pose.
    """
    try:
        marginals = gtsam.Marginals(found.linear, found.values)
        return np.array([marginals.marginalCovariance(key) for key in keys])
    except RuntimeError as error:  # gtsam's name for an indeterminate system
        raise OptimizationError("graph: nothing determines some pose; give a prior, or scans with returns") from error
