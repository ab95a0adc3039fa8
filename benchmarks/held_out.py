"""Log-likelihood of scans that did not make the map, and where their rays end."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.stats import ttest_rel

from benchmarks.sensor_model_scenes import Index, Scene
from factorloc.geometry import se2, se3
from factorloc.mapping import BrickStatistics, RayStatistics
from factorloc.mapping.cell_table import CellTable
from factorloc.mapping.sensor_model import SensorModel
from factorloc.scan import Scan

__all__ = ["ENDS", "HeldOut", "ends_of", "paired_p", "weigh"]

Array = npt.NDArray[np.float64]

ENDS = ("ends in a cell with hits", "ends in a seen cell without hits", "ends in unseen space", "no return")
"""Kinds of rays by what the map knows of their ends."""


@dataclass(frozen=True)
class HeldOut:
    """Log-likelihood of held-out scans in one model.

    Parameters
    ----------
    nats : list of float
        Mean over the rays of each scan, of those that are not impossible.
    impossible : list of int
        Rays of each scan with likelihood zero.
    rays : list of int
        Rays of each scan.
    of_ends : list of float
        Sum over all scans of the possible rays of each of the :data:`ENDS`.
    counts : list of int
        Rays of each of the :data:`ENDS`.
    """

    nats: list[float]
    impossible: list[int]
    rays: list[int]
    of_ends: list[float]
    counts: list[int]

    @property
    def mean(self) -> float:
        """Nats per ray over all scans; -inf if one ray is impossible."""
        return -np.inf if any(self.impossible) else self.total / sum(self.rays)

    @property
    def total(self) -> float:
        """Sum over all rays that are not impossible."""
        return float(sum(self.of_ends))


def ends_of(statistics: RayStatistics | BrickStatistics, scan: Scan, pose: Array) -> npt.NDArray[np.int64]:
    """Which of the :data:`ENDS` each ray of a scan has, shape (N,)."""
    group = se2 if scan.dimension == 2 else se3
    points = group.transform(pose, group.transform(scan.T_body_sensor, scan.points()))
    index = statistics.grid.index(points)
    if isinstance(statistics, BrickStatistics):
        kinds = np.where(statistics.hits > 0, 0.0, 1.0)
        found = CellTable.from_cells(statistics, kinds, 2.0).at(index).astype(np.int64)
    else:
        inside = statistics.grid.contains(points)
        at = tuple(np.where(inside[:, None], index, 0).T)
        seen = (statistics.path_fixed[at] > 0) | (statistics.hits[at] > 0)
        found = np.where(inside & seen, np.where(statistics.hits[at] > 0, 0, 1), 2)
    out = np.full(len(scan), 3, np.int64)
    out[scan.is_return] = found
    return out


def weigh(model: SensorModel, scene: Scene, rows: Index, ends: Sequence[Index], pool: Executor) -> HeldOut:
    """Weigh held-out scans at their poses.

    Parameters
    ----------
    model : SensorModel
    scene : Scene
    rows : ndarray of int64
        Which scans.
    ends : sequence of ndarray
        Of each of them, by :func:`ends_of`.
    pool : Executor
    """

    def of_scan(row: int, kinds: Index) -> tuple[float, int, Array]:
        each = model.log_likelihood(scene.held_out[row], scene.poses[row])
        possible = np.isfinite(each)
        sums = np.asarray(np.bincount(kinds[possible], each[possible], len(ENDS)), np.float64)
        return float(each[possible].mean()) if possible.any() else np.nan, int((~possible).sum()), sums

    found = list(pool.map(of_scan, rows.tolist(), ends))
    nats, impossible, sums = zip(*found, strict=True)
    counts = np.sum([np.bincount(kinds, minlength=len(ENDS)) for kinds in ends], axis=0)
    return HeldOut(
        list(nats), list(impossible), [len(kinds) for kinds in ends], np.sum(sums, axis=0).tolist(), counts.tolist()
    )


def paired_p(better: npt.ArrayLike, worse: npt.ArrayLike, block: int = 1) -> float:
    """One-tailed paired t-test of ``better > worse`` over blocks of consecutive rows; NaN where there is none.

    Scans of one drive are not independent: neighbours see the same walls, and the same error of their poses. Means of
    blocks are less dependent than scans; their test is the one to believe.
    """
    difference = np.asarray(better, np.float64) - np.asarray(worse, np.float64)
    count = len(difference) // block
    means = difference[: count * block].reshape(count, block).mean(1)
    if count < 2 or not np.isfinite(means).all() or np.ptp(means) == 0:
        return float("nan")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of differences that are nearly the same
        return float(ttest_rel(means, np.zeros(count), alternative="greater").pvalue)
