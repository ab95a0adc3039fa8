"""Monte Carlo localization with each model: the errors of thesis, table 7.2 and figure 8.3.

Filters are plain: neither tempered nor recovered, as the published ones. The settings first had the package's default
tempering. It keeps a share of the particles effective after every scan; where the likelihood of a scan is much narrower
than the spread of the odometry, as that of 60 rays is after 1 to 2 m of driving, no such share of them is near the
pose, and beliefs disperse, the wider the narrower the likelihood. That tells of tempering, not of the models, and is
kept as a study of its own.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from benchmarks.sensor_model_scenes import Index, Scene
from factorloc.config import Block
from factorloc.geometry import group_of
from factorloc.localization import KldSettings, MonteCarloSettings, NormalStart, localize_by_particles
from factorloc.mapping.grid import Grid
from factorloc.mapping.sensor_model import SensorModel
from factorloc.scan import RayStatus, Scan

__all__ = ["FailingLidar", "FilterSettings", "Study", "run_filters", "starts_of"]

Array = npt.NDArray[np.float64]
Sigmas = tuple[float, float, float]


class Study(Block):
    """Runs of one size.

    Parameters
    ----------
    particles : int
    scans : int
        Of a run, at most.
    failures : bool
        Whether some rays fail.
    tempering : float, optional
        As of :class:`~factorloc.localization.MonteCarloSettings`; none, as published, by default.
    """

    particles: int = Field(gt=0)
    scans: int = Field(gt=1)
    failures: bool = False
    tempering: float | None = Field(None, gt=0, lt=1)

    @property
    def name(self) -> str:
        """In words."""
        tempered = "" if self.tempering is None else f", tempering {self.tempering:g}"
        return f"{self.particles} particles" + (", failures" if self.failures else "") + tempered


class FilterSettings(Block):
    """What all filters have in common; all else is the package's default, without recovery.

    Parameters
    ----------
    planar_rays, spatial_rays : int
        Weighed of a scan.
    estimate : {"mean", "best", "mode"}
        What is compared with the truth.
    start : (float, float, float)
        Standard deviations of the first pose: horizontal and vertical (m), and of each angle (rad). Its mean is drawn
        with them too.
    failures : float
        Share of the weighed rays that fail.
    studies : tuple of Study
    """

    planar_rays: int = Field(gt=0)
    spatial_rays: int = Field(gt=0)
    estimate: Literal["mean", "best", "mode"]
    start: Sigmas
    failures: float = Field(gt=0, lt=1)
    studies: tuple[Study, ...] = Field(min_length=1)


@dataclass(frozen=True)
class FailingLidar:
    """A model that sees some rays of every scan fail: they end below the minimum range, and tell no more than that.

    Which ones depends on the seed and the stamp of the scan only, so all models see the same.

    Parameters
    ----------
    model : SensorModel
        What weighs the scans.
    share : float
        Of the rays.
    seed : int
    """

    model: SensorModel
    share: float
    seed: int

    @property
    def grid(self) -> Grid:
        """Of the model."""
        return self.model.grid

    @property
    def normalized(self) -> bool:
        """As the model."""
        return self.model.normalized

    def failed(self, scan: Scan) -> Scan:
        """The scan with failures."""
        rng = np.random.default_rng([self.seed, int(np.float64(scan.stamp).view(np.uint64))])
        status, ranges = scan.status.copy(), scan.ranges.copy()
        some = rng.permutation(len(scan))[: round(self.share * len(scan))]
        status[some], ranges[some] = RayStatus.BELOW_MINIMUM, scan.range_limits[0]
        return replace(scan, status=status, ranges=ranges)

    def log_likelihood(self, scan: Scan, T_map_body: npt.ArrayLike) -> Array:
        """Of the failing scan (SensorModel)."""
        return self.model.log_likelihood(self.failed(scan), T_map_body)

    def scan_log_likelihoods(self, scan: Scan, poses: npt.ArrayLike) -> Array:
        """Of the failing scan (SensorModel)."""
        return self.model.scan_log_likelihoods(self.failed(scan), poses)


def starts_of(count: int, scans: int, runs: int) -> Index:
    """First scans of runs that begin at evenly spread places, the last one at the latest it can."""
    return np.round(np.linspace(0, max(count - scans, 0), runs)).astype(np.int64)


def run_filters(
    model: SensorModel, scene: Scene, study: Study, settings: FilterSettings, sigmas: Sigmas, runs: int, seed: int,
    pool: Executor,
) -> list[list[float]]:  # fmt: skip
    """Localize parts of the held-out drive; starts, odometry and all that is random are the same for all models.

    Returns
    -------
    list of list of float
        Position error of every scan of every run, m.
    """
    group, spatial = group_of(scene.dimension), scene.dimension == 3
    horizontal, vertical, angle = sigmas
    spread = np.array([angle] * 3 + [horizontal, horizontal, vertical] if spatial else [horizontal, horizontal, angle])
    how = MonteCarloSettings(
        rays=settings.spatial_rays if spatial else settings.planar_rays,
        estimate=settings.estimate,
        kld=KldSettings(least=study.particles, most=study.particles),
        recovery=None,
        tempering=study.tempering,
    )
    scans = min(study.scans, len(scene.held_out))

    def run(number: int, first: int) -> list[float]:
        rng = np.random.default_rng([seed, number])
        rows, truth = slice(first, first + scans), scene.poses[first : first + scans]
        mean = group.compose(truth[0], group.exp(rng.standard_normal(len(spread)) * spread))
        odometry = scene.motions(first, first + scans, rng)
        found = localize_by_particles(
            FailingLidar(model, settings.failures, seed + number) if study.failures else model,
            scene.held_out[rows],
            odometry.motions,
            NormalStart.from_sigmas(mean, spread),
            known=odometry.known,
            covariances=odometry.covariances,
            settings=how,
            seed=int(rng.integers(2**31)),
        ).trajectory.poses
        apart = found[:, :3, 3] - truth[:, :3, 3] if spatial else found[:, :2] - truth[:, :2]
        return [float(error) for error in np.linalg.norm(apart, axis=1)]

    return list(pool.map(run, range(runs), starts_of(len(scene.held_out), scans, runs).tolist()))
