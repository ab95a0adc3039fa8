"""ParticleFilter: propagate, reweight, resample, estimate."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc.config import Block
from factorloc.errors import GeometryError, MapError
from factorloc.factors.odometry import OdometryNoise
from factorloc.localization.initialization import Initialization
from factorloc.localization.kld import KldSettings, enough_particles
from factorloc.localization.motion_model import LostMotion, MotionModel, TangentMotion, TurnDriveTurn
from factorloc.localization.particle_estimates import ParticleEstimates
from factorloc.localization.particles import Particles
from factorloc.localization.recovery import Elsewhere, RecoverySettings, look_elsewhere
from factorloc.localization.resampling import RESAMPLING, multinomial
from factorloc.localization.reweighting import Reweighting, choose_rays, tempered_exponent
from factorloc.mapping.sensor_model import SensorModel
from factorloc.scan import Scan

__all__ = ["ParticleFilter", "ParticleFilterSettings"]

Array = npt.NDArray[np.float64]

_RAYS = {2: 60, 3: 300}
_INFORMATION = {2: 0.2, 3: 0.2}


class ParticleFilterSettings(Block):
    """How particles are weighed, drawn and moved.

    Parameters
    ----------
    rays : int, optional
        Most rays of a scan that are weighed, evenly spaced in the plane (60) and spread over the surroundings in space
        (300).
    information : float, optional
        Exponent of a scan's likelihood. Rays are not independent: neighbours share a wall, its errors and the map's.
    tempering : float, optional
        Least share of the particles that may be effective after a scan. Where a likelihood is so peaked that fewer
        would be, its exponent is lowered for that scan until as many are: the belief narrows over some scans instead
        of falling on the one particle that happened to be nearest. None never does.
    resampling : {"systematic", "stratified", "residual", "multinomial"}
        Policy of drawing.
    resample_below : float
        Particles are drawn anew when a smaller share of them is effective; 1 does so after every scan.
    kld : KldSettings
        How many particles.
    recovery : RecoverySettings, optional
        When and how widely to look elsewhere; None never does.
    odometry : OdometryNoise
        Noise of motions that come without covariances.
    lost_position, lost_heading : float
        Standard deviations of a motion nobody measured, m and rad.
    """

    rays: int | None = Field(None, gt=0)
    information: float | None = Field(None, gt=0, le=1)
    tempering: float | None = Field(0.02, gt=0, lt=1)
    resampling: Literal["systematic", "stratified", "residual", "multinomial"] = "systematic"
    resample_below: float = Field(0.5, gt=0, le=1)
    kld: KldSettings = KldSettings()
    recovery: RecoverySettings | None = RecoverySettings()
    odometry: OdometryNoise = OdometryNoise()
    lost_position: float = Field(1.0, gt=0)
    lost_heading: float = Field(0.35, gt=0)


class ParticleFilter:
    """Monte Carlo localization of scans in a map.

    Parameters
    ----------
    model : SensorModel
        Likelihood of scans in the map.
    start : Initialization
        What is believed of the first pose; as many particles are drawn as its spread needs.
    settings : ParticleFilterSettings, optional
        How it works.
    motion_model : MotionModel, optional
        Of measured motions; by default :class:`TurnDriveTurn` in the plane and :class:`TangentMotion` in space, with
        the noise of the settings.
    free_space : Initialization, optional
        Where else the vehicle may be, if the belief does not explain its scans; without, it does not recover.
    seed : int
        Of all that is random: the same seed, the same particles.

    Attributes
    ----------
    particles : Particles
        The belief.
    resamplings, recoveries : int
        How often particles were drawn anew, and how often some of them elsewhere.

    Raises
    ------
    MapError
        If start and map differ in dimension, or all of the start lies outside the map.
    """

    def __init__(
        self,
        model: SensorModel,
        start: Initialization,
        *,
        settings: ParticleFilterSettings | None = None,
        motion_model: MotionModel | None = None,
        free_space: Initialization | None = None,
        seed: int = 0,
    ) -> None:
        self.model, self.free_space = model, free_space
        self.settings = settings = settings or ParticleFilterSettings()
        dimension = model.grid.dimension
        for name, source in (("start", start), ("free_space", free_space)):
            if source is not None and source.dimension != dimension:
                raise MapError(f"{name}: of {source.dimension} dimensions, the map has {dimension}; use the map's")
        by_default = TurnDriveTurn if dimension == 2 else TangentMotion
        self.motion_model: MotionModel = motion_model or by_default(settings.odometry)
        self.lost_motion = LostMotion(settings.lost_position, settings.lost_heading)
        self.rng = np.random.default_rng(seed)
        poses = start.sample(settings.kld.most, self.rng)
        count = enough_particles(settings.kld.bins.number(poses), settings.kld)
        self.particles = Particles.uniform(poses[:count])
        if not model.grid.contains(self.particles.positions).any():
            raise MapError("start: all of it lies outside the map; begin within")
        self.resamplings = self.recoveries = 0
        self._elsewhere: Elsewhere | None = None

    def propagate(self, motion: npt.ArrayLike, *, covariance: npt.ArrayLike | None = None, known: bool = True) -> None:
        """Move each particle by a motion of its own.

        Parameters
        ----------
        motion : array_like, shape (3,) or (4, 4)
            Measured motion of the body since the last scan.
        covariance : array_like, shape (3, 3) or (6, 6), optional
            Of the motion, in the tangent space of the body after it; that of the motion model by default.
        known : bool
            Whether it was measured; else particles spread as :class:`LostMotion` says.

        Raises
        ------
        GeometryError
            If motion and covariance do not fit.
        """
        if np.ndim(motion) != self.particles.dimension - 1:
            raise GeometryError(
                f"motion: shape {np.shape(motion)} in {self.particles.dimension} dimensions; see geometry"
            )
        self._elsewhere = None  # was asked before the motion
        model = self.motion_model if known else self.lost_motion
        self.particles = self.particles.moved(model.sample(motion, len(self.particles), self.rng, covariance))

    def reweight(self, scan: Scan) -> Reweighting:
        """Multiply weights by the likelihood of a scan.

        Particles outside the map have weight 0. A scan without returns (a covered lidar and an open field look alike)
        changes nothing, nor does one that no particle explains; :class:`Reweighting` says so. Poses elsewhere are asked
        as well how they explain the scan (:mod:`~factorloc.localization.recovery`), for the next :meth:`resample`.

        Raises
        ------
        MapError
            If the scan is of another dimension than the map, or the model answers NaN or infinity.
        """
        dimension = self.particles.dimension
        if scan.dimension != dimension:
            raise MapError(f"scan: of {scan.dimension} dimensions, the map has {dimension}; use one made for it")
        self._elsewhere = None
        information = self.settings.information or _INFORMATION[dimension]
        chosen = choose_rays(scan, self.settings.rays or _RAYS[dimension])
        if not chosen.is_return.any():
            return Reweighting(0.0, 0, information)
        logs = self._log_likelihoods(chosen, self.particles.poses)
        self._elsewhere = self._look_elsewhere(chosen, self.particles.log_mean(information * logs), information)
        exponent = tempered_exponent(self.particles, logs, information, self.settings.tempering)
        evidence = self.particles.log_mean(exponent * logs)
        done = Reweighting(evidence, len(chosen), exponent, exponent < information)
        if not done.excluded:
            self.particles = self.particles.reweighted(exponent * logs)
        return done

    def resample(self) -> bool:
        """Draw particles by their weights, if these have become too uneven or others explain the scan better.

        Returns
        -------
        bool
            Whether it did.
        """
        settings, particles = self.settings, self.particles
        elsewhere, self._elsewhere = self._elsewhere, None
        if elsewhere is None and particles.effective_size >= settings.resample_below * len(particles):
            return False
        fresh = np.zeros((0, *particles.poses.shape[1:]))
        if elsewhere is not None:
            fresh = elsewhere.sample(max(round(elsewhere.share * settings.kld.most), 1), self.rng)
            self.recoveries += 1
        count = self._enough(fresh)
        new = 0 if elsewhere is None else min(max(round(elsewhere.share * count), 1), len(fresh))
        kept = RESAMPLING[settings.resampling](particles.weights, count - new, self.rng)
        self.particles = Particles.uniform(np.concatenate([particles.poses[kept], self.rng.permutation(fresh)[:new]]))
        self.resamplings += 1
        return True

    def estimate(self) -> ParticleEstimates:
        """Pose estimates of the particles as they are: best after reweighting, before resampling."""
        return ParticleEstimates.of(self.particles, self.settings.kld.bins)

    def _enough(self, fresh: Array) -> int:
        """How many particles to draw: asked of independent draws, while those that stay are drawn with less noise."""
        kld, weights = self.settings.kld, self.particles.weights
        if kld.least == kld.most:
            return kld.most
        numbers = kld.bins.number(np.concatenate([self.particles.poses, fresh]))
        old, new = numbers[: len(weights)], numbers[len(weights) :]
        wanted = kld.most - len(fresh)
        first = min(max(kld.least, kld.most // 10), wanted)  # most often enough, without drawing the rest
        draws = old[multinomial(weights, first, self.rng)]
        count = enough_particles(draws, kld) if len(fresh) == 0 else kld.most
        if count < kld.most or len(draws) == kld.most:
            return count
        draws = np.concatenate([draws, old[multinomial(weights, wanted - first, self.rng)]])
        return enough_particles(self.rng.permutation(np.concatenate([draws, new])) if len(new) else draws, kld)

    def _look_elsewhere(self, scan: Scan, log_evidence: float, information: float) -> Elsewhere | None:
        settings = self.settings.recovery
        if settings is None or self.free_space is None:
            return None
        return look_elsewhere(
            log_evidence,
            lambda poses: information * self._log_likelihoods(scan, poses),
            self.free_space,
            settings,
            len(self.particles),
            self.rng,
            self.settings.tempering,
        )

    def _log_likelihoods(self, scan: Scan, poses: Array) -> Array:
        inside = self.model.grid.contains(poses[:, :2] if poses.ndim == 2 else poses[:, :3, 3])
        logs = np.full(len(poses), -np.inf)
        if inside.any():
            logs[inside] = self.model.scan_log_likelihoods(scan, poses[inside])
        wrong = int((np.isnan(logs) | (logs == np.inf)).sum())
        if wrong:
            name, count = type(self.model).__name__, len(poses)
            raise MapError(f"{name}: log-likelihood NaN or infinite at {wrong} of {count} poses; is the map damaged?")
        return logs
