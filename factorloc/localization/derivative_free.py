"""Refinement without derivatives: one scan brought into a map by any sensor model, also one that has no gradient.

The likelihood of the reflection model, and of every model that looks up the cell a ray ends in, jumps where a ray
changes cells and says next to nothing in between; so does its gradient. Its values say much. Beginning with the prior,
poses are drawn from a Gaussian and weighed by

    likelihood(pose)^step,

and the Gaussian of the next round has the mean and covariance of the weighted poses. A step is as long as leaves enough
poses a part in the weight; the steps add up to the weight of a scan's log-likelihood. For a likelihood that is Gaussian
the last round has exactly the posterior; of a rough one the roughness averages out, as every round looks at hundreds of
poses and trusts none.
"""

from __future__ import annotations

import time

import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc.config import Block
from factorloc.errors import GeometryError, MapError, OptimizationError
from factorloc.factors.prior import PosePrior
from factorloc.geometry import PoseGroup, group_of
from factorloc.localization.prepared_map import INFORMATION
from factorloc.mapping.sensor_model import SensorModel
from factorloc.result import Iteration, Result, StopReason
from factorloc.scan import Scan
from factorloc.trajectory import Trajectory

__all__ = ["RefinementSettings", "refine"]

Array = npt.NDArray[np.float64]

_LEAST_SIGMA = 1e-5  # m, rad: no Gaussian becomes flat


class RefinementSettings(Block):
    """How a pose is refined.

    Parameters
    ----------
    samples : int, optional
        Poses a round; by default 400 in the plane and 1500 in space.
    max_rounds : int
        Most rounds.
    effective : float
        Share of the poses that must keep a part in the weight (Kish's effective sample size).
    search_position, search_heading : float
        Standard deviations of a guess without covariance, m and rad.
    information : float, optional
        Weight of the scan's log-likelihood; by default 0.2 in the plane and 0.5 in space, as everywhere.
    """

    samples: int | None = Field(None, ge=10)
    max_rounds: int = Field(100, gt=0)
    effective: float = Field(0.3, gt=0, lt=1)
    search_position: float = Field(0.3, gt=0)
    search_heading: float = Field(float(np.radians(5.0)), gt=0)
    information: float | None = Field(None, gt=0, le=1)


def refine(
    model: SensorModel,
    scan: Scan,
    guess: npt.ArrayLike | PosePrior,
    *,
    settings: RefinementSettings | None = None,
    seed: int = 0,
) -> Result:
    """Find the most likely pose of a scan around a guess, and how well it is known, by likelihoods alone.

    Parameters
    ----------
    model : SensorModel
        Any.
    scan : Scan
        Of the model's dimension.
    guess : array_like, shape (3,) or (4, 4), or PosePrior
        About where the body is, ``T_map_body``; a prior brings its own standard deviations.
    settings : RefinementSettings, optional
        Rounds and samples.
    seed : int
        Of the samples; the same seed gives the same result.

    Returns
    -------
    Result
        One pose with the covariance of the weighted samples; the cost is the scan's, times its information. The pose is
        their mean, or the best of them where the mean is less likely than they are: then it lies between two peaks.

    Raises
    ------
    MapError
        If scan, guess and model differ in dimension.
    GeometryError
        If the guess is not one pose.
    OptimizationError
        If the model excludes the scan everywhere around the guess.
    """
    began = time.perf_counter()
    settings = settings or RefinementSettings()
    dimension = model.grid.dimension
    if not isinstance(guess, PosePrior):
        guess = PosePrior.from_sigmas(guess, settings.search_position, settings.search_heading)
    if not guess.dimension == scan.dimension == dimension:
        have = f"scan of {scan.dimension} dimensions and guess of {guess.dimension}"
        raise MapError(f"{have}: the map has {dimension}; use a map made for them")
    if len(scan) == 0:
        raise GeometryError("scan: it has no rays; there is nothing to refine by")
    search = _Search(model, scan, guess, settings, np.random.default_rng(seed))
    history: list[Iteration] = []
    while not search.done and len(history) < settings.max_rounds:
        search.round()
        history.append(Iteration(0.0, -search.best_target, 0.0, search.samples))
    pose, covariance = search.estimate()
    cost = -search.information * float(model.scan_log_likelihoods(scan, pose[None])[0])
    return Result(
        Trajectory(np.array([scan.stamp]), pose[None], covariance[None], world=model.grid.frame),
        cost,
        tuple(history),
        StopReason.CONVERGED if search.done else StopReason.MAX_ITERATIONS,
        {"scan": np.array([cost])},
        {"poses the model excludes": search.excluded},
        time.perf_counter() - began,
    )


class _Search:
    """A Gaussian on its way to the peak; tangent vectors are those at its mean."""

    def __init__(
        self, model: SensorModel, scan: Scan, prior: PosePrior, settings: RefinementSettings, rng: np.random.Generator
    ) -> None:
        self.model, self.scan, self.prior, self.settings, self.rng = model, scan, prior, settings, rng
        self.group: PoseGroup = group_of(prior.dimension)
        chosen = settings.information
        self.information = INFORMATION[prior.dimension] if chosen is None else chosen
        self.samples = settings.samples or (400 if prior.dimension == 2 else 1500)
        self.mean, self.covariance = prior.pose, prior.covariance
        self.power = 0.0
        self.done = False
        self.excluded = 0
        self.best: Array = prior.pose
        self.best_target = -np.inf
        self.least_usual = -np.inf

    def round(self) -> None:
        """Draw, weigh, and take the moments."""
        root = np.linalg.cholesky(self.covariance)
        xi = self.rng.standard_normal((self.samples, len(root))) @ root.T
        poses = self.group.compose(self.mean, self.group.exp(xi))
        logs = self.information * self.model.scan_log_likelihoods(self.scan, poses)
        possible = logs > -np.inf
        self.excluded += int((~possible).sum())
        if not possible.any():
            raise OptimizationError(
                "scan: the model excludes it everywhere around the guess; give a better one, or a posterior as model"
            )
        # Shares are of the poses that are possible: what is excluded is excluded by any power.
        xi, poses, logs = xi[possible], poses[possible], logs[possible]
        step, weights = self._step(logs)
        self.power = 1.0 if step >= 1.0 - self.power else self.power + step
        self.done = self.power == 1.0
        targets = logs + self._log_prior(poses)
        top = int(np.argmax(targets))
        if targets[top] > self.best_target:
            self.best, self.best_target = poses[top], float(targets[top])
        usual = float(weights @ targets)
        self.least_usual = usual - 3 * float(np.sqrt(weights @ (targets - usual) ** 2))
        shift = weights @ xi
        spread = xi - shift
        moments = (spread * weights[:, None]).T @ spread / max(1.0 - float(weights @ weights), 0.5)
        self.mean = self.group.compose(self.mean, self.group.exp(shift))
        self.covariance = (moments + moments.T) / 2 + _LEAST_SIGMA**2 * np.eye(len(root))

    def estimate(self) -> tuple[Array, Array]:
        """The mean, or the best pose if the mean is less likely than samples are; and the covariance about it."""
        log_likelihood = self.information * float(self.model.scan_log_likelihoods(self.scan, self.mean[None])[0])
        if log_likelihood + float(self._log_prior(self.mean[None])[0]) >= self.least_usual:
            return self.mean, self.covariance
        away = self.group.log(self.group.between(self.best, self.mean))
        return self.best, self.covariance + np.outer(away, away)

    def _log_prior(self, poses: Array) -> Array:
        xi = self.group.log(self.group.between(self.prior.pose, poses))
        return np.asarray(-0.5 * np.einsum("ni,ij,nj->n", xi, self.prior.information, xi))

    def _step(self, logs: Array) -> tuple[float, Array]:
        """The longest step that leaves enough poses their part, up to what is left; and their weights."""
        low, high = 0.0, 1.0 - self.power
        if _effective(high * logs) >= self.settings.effective:
            return high, _weights(high * logs)
        for _ in range(40):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if _effective(middle * logs) >= self.settings.effective else (low, middle)
        return low, _weights(low * logs)


def _weights(logs: Array) -> Array:
    weights = np.exp(logs - logs.max())
    return np.asarray(weights / weights.sum())


def _effective(logs: Array) -> float:
    """Effective share of the samples (Kish)."""
    weights = _weights(logs)
    return float(1.0 / (len(weights) * (weights @ weights)))
