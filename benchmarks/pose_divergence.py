"""How far the likelihood of poses is from the truth: the divergences of thesis, sections 7.6.2 and 8.5.2.

Three choices the text leaves open, or makes in a way that cannot be followed with few samples:

- ``D(h || g)`` (7.29) is summed as printed: ``h`` is normalized over the samples, ``g`` is a density. In proper units
  every value would be larger by ``log(M / area)``, for all models alike. Sigma is not given; it is a setting.
- The Monte-Carlo form of (8.24) leaves out the weight ``p_gt`` of the integral and samples a region that is not named.
  Unweighted, over a circle of 2.5 m, ``log p_gt`` alone (sigma 0.05 m) is below -1000 on most of it, and every ratio is
  near one. Here each sample has its weight, and the circle is as small as ``p_gt``.
- A measurement is a scan, and its likelihood the product over its rays.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pydantic import Field
from scipy.special import logsumexp

from benchmarks.sensor_model_scenes import Index, Scene, thinned
from factorloc.config import Block
from factorloc.mapping.sensor_model import SensorModel

__all__ = ["DivergenceSettings", "Divergences", "disc", "diverge", "from_truth", "moved", "to_truth"]

Array = npt.NDArray[np.float64]


class DivergenceSettings(Block):
    """Where poses are sampled.

    Parameters
    ----------
    wide_samples, wide_radius : int, float
        Samples for ``D(h || g)``, uniform in a horizontal circle around the true pose (m), headings kept.
    wide_sigma : float
        Standard deviation of ``g`` along each axis, m.
    narrow_samples, narrow_radius, narrow_sigma
        The same for the divergence from ``p_gt``.
    """

    wide_samples: int = Field(gt=1)
    wide_radius: float = Field(gt=0)
    wide_sigma: float = Field(gt=0)
    narrow_samples: int = Field(gt=1)
    narrow_radius: float = Field(gt=0)
    narrow_sigma: float = Field(gt=0)


@dataclass(frozen=True)
class Divergences:
    """Divergences of each scan, nats.

    Parameters
    ----------
    to_truth : list of float
        ``D(h || g)`` (7.29); NaN where no sample is possible.
    from_truth : list of float
        ``D(p_gt || p)`` (8.24); infinite where a sample is impossible, NaN where all are.
    """

    to_truth: list[float]
    from_truth: list[float]


def disc(count: int, radius: float, rng: np.random.Generator) -> Array:
    """Points uniform in a circle about the origin, shape (count, 2)."""
    distance, angle = radius * np.sqrt(rng.random(count)), rng.uniform(-np.pi, np.pi, count)
    return np.stack([distance * np.cos(angle), distance * np.sin(angle)], -1)


def moved(pose: Array, offsets: Array) -> Array:
    """Move a pose horizontally in the map, its heading kept, shape (count, 3) or (count, 4, 4)."""
    poses = np.repeat(pose[None], len(offsets), 0)
    if pose.ndim == 1:
        poses[:, :2] += offsets
    else:
        poses[:, :2, 3] += offsets
    return poses


def to_truth(logs: Array, offsets: Array, sigma: float) -> float:
    """``D(h || g)`` of likelihoods (as logarithms) at offsets from the truth, with normal ``g`` (7.29)."""
    if not np.isfinite(logs).any():
        return float("nan")
    h = logs - logsumexp(logs)
    weights = np.exp(h)
    g = _log_normal(offsets, sigma)
    some = weights > 0
    return float(weights[some] @ (h[some] - g[some]))


def from_truth(logs: Array, offsets: Array, sigma: float) -> float:
    """``D(p_gt || p)``, both normalized over the samples (8.24, weighted)."""
    if not np.isfinite(logs).any():
        return float("nan")
    g = _log_normal(offsets, sigma)
    g -= logsumexp(g)
    return float(np.exp(g) @ (g - (logs - logsumexp(logs))))


def diverge(
    model: SensorModel, scene: Scene, rows: Index, settings: DivergenceSettings, rays: int, seed: int, pool: Executor
) -> Divergences:
    """Divergences of held-out scans; the samples of a scan are the same for all models."""

    def of_scan(row: int) -> tuple[float, float]:
        rng = np.random.default_rng([seed, row])
        wide = disc(settings.wide_samples, settings.wide_radius, rng)
        narrow = disc(settings.narrow_samples, settings.narrow_radius, rng)
        poses = moved(scene.poses[row], np.concatenate([wide, narrow]))
        logs = model.scan_log_likelihoods(thinned(scene.held_out[row], rays), poses)
        return (
            to_truth(logs[: len(wide)], wide, settings.wide_sigma),
            from_truth(logs[len(wide) :], narrow, settings.narrow_sigma),
        )

    first, second = zip(*pool.map(of_scan, rows.tolist()), strict=True)
    return Divergences(list(first), list(second))


def _log_normal(offsets: Array, sigma: float) -> Array:
    """Log density of a normal distribution about the origin of the plane."""
    return np.asarray(-0.5 * (offsets**2).sum(-1) / sigma**2 - np.log(2 * np.pi * sigma**2))
