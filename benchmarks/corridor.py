"""A corridor of voxels: true maps, what mapping observes of them, and the beliefs that follow from it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from benchmarks._corridor_kernels import GAMMA, RATE, TABLE, fire, traverse
from factorloc._jit import in_threads
from factorloc.config import Block

__all__ = [
    "ALGORITHMS",
    "CONJUGATE",
    "DECAY",
    "MAXIMUM",
    "MEASURES",
    "MODELS",
    "REFLECTION",
    "TRUE",
    "UNIFORM",
    "Beliefs",
    "Conventions",
    "Observations",
    "Voxels",
    "beta_by_moments",
    "gamma_by_moments",
    "observe",
    "simulate",
    "voxels",
]

Array = npt.NDArray[np.float64]

REFLECTION, DECAY = MODELS = ("REF", "DEC")
MAXIMUM, UNIFORM, CONJUGATE, TRUE = ALGORITHMS = ("MLM", "FMP uniform", "FMP conjugate", "FMP true prior")
MEASURES = ("rho", "log floored", "log finite", "zero", "reset", "claimed")
"""What is kept of each run, averaged over the voxels: see :func:`benchmarks._corridor_kernels.traverse`."""

_BLOCK = 50  # runs that share a random stream: results depend neither on threads nor on how many runs follow
_NO_STRENGTH = 1e-9  # a prior that counts for fewer observations is none: what is left is rounding


class Conventions(Block):
    """What the published description leaves open.

    Parameters
    ----------
    ray : {"forward", "voxel"}
        Whether rays of the localization go on through the row until something reflects them, or see one voxel only.
    end : {"open", "ring"}
        What becomes of the belief that the robot has left the corridor at its end: it is impossible and dropped, or it
        comes back in at the beginning.
    """

    ray: Literal["forward", "voxel"]
    end: Literal["open", "ring"]


@dataclass(frozen=True)
class Observations:
    """Maps of several runs and what was seen of them.

    Parameters
    ----------
    depths : ndarray, shape (B, N)
        True optical depths: ``-log(1 - mu)``, or the decay rates themselves.
    hits, misses : ndarray, shape (B, N)
        H and M.
    path : ndarray, shape (B, N)
        R, in voxels.
    """

    depths: Array
    hits: Array
    misses: Array
    path: Array


@dataclass(frozen=True)
class Voxels:
    """What one algorithm knows, in the form the kernels take.

    Parameters
    ----------
    form : int
        Of the density of a return: see :func:`benchmarks._corridor_kernels.log_hit`.
    first, second : ndarray, shape (B, N)
        Its parameters.
    miss : ndarray, shape (B, N)
        Log-probability that a ray passes a whole voxel.
    """

    form: int
    first: Array
    second: Array
    miss: Array


@dataclass(frozen=True)
class Beliefs:
    """Outcome of runs.

    Parameters
    ----------
    values : ndarray, shape (runs, algorithms, measures)
        In the order of :data:`ALGORITHMS` and :data:`MEASURES`.
    no_moments : int
        Runs whose map has no moments to fit a prior to; they take the uniform one.
    """

    values: Array
    no_moments: int

    def of(self, algorithm: str, measure: str) -> Array:
        """One measure of one algorithm, a value a run."""
        return self.values[:, ALGORITHMS.index(algorithm), MEASURES.index(measure)]


def observe(model: str, shape: tuple[int, int], visits: int, rng: np.random.Generator) -> Observations:
    """Draw maps from the prior, and ``visits`` observations of every voxel.

    A visit is one ray through one voxel, from face to face: a Bernoulli trial (eq. 8.3), or an exponential path cut
    off at the far face (eq. 8.4).
    """
    if model == REFLECTION:
        mu = rng.random(shape)
        hits = rng.binomial(visits, mu).astype(np.float64)
        return Observations(-np.log1p(-mu), hits, visits - hits, np.full(shape, float(visits)))
    rate = rng.standard_exponential(shape)
    path, hits = np.zeros(shape), np.zeros(shape)
    for _ in range(visits):
        free = rng.standard_exponential(shape) / rate
        hits += free < 1.0
        path += np.minimum(free, 1.0)
    return Observations(rate, hits, visits - hits, path)


def beta_by_moments(mu: Array) -> tuple[Array, Array]:
    """Beta priors with the mean and variance of each row (section 8.5); NaN where a row has no variance.

    The published formulas are ``alpha = E s`` and ``beta = (1 - E) s`` with the strength ``s = E (1 - E) / var - 1``.
    """
    mean, variance = mu.mean(axis=1), mu.var(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        strength = np.where(variance > 0, mean * (1 - mean) / variance - 1, np.nan)
    strength[strength < _NO_STRENGTH] = 0.0
    return mean * strength, (1 - mean) * strength


def gamma_by_moments(rate: Array) -> tuple[Array, Array]:
    """Gamma priors with the mean and variance of each row (section 8.5); NaN where a row has no finite ones."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        mean, variance = rate.mean(axis=1), rate.var(axis=1)
        alpha, beta = mean**2 / variance, mean / variance
    good = np.isfinite(alpha) & np.isfinite(beta) & (alpha > 0) & (beta > 0)
    return np.where(good, alpha, np.nan), np.where(good, beta, np.nan)


def voxels(model: str, seen: Observations, prior: tuple[Array, Array] | None) -> Voxels:
    """What is known after mapping: with a prior a row its full posterior, without one the most likely map."""
    H, M, R = seen.hits, seen.misses, seen.path
    alpha, beta = (0.0, 0.0) if prior is None else (prior[0][:, None], prior[1][:, None])
    with np.errstate(divide="ignore"):  # log 0 is what makes a pose impossible
        if model == REFLECTION:  # without a prior, (8.22) is (8.23)
            total = H + alpha + M + beta
            return Voxels(TABLE, np.log((H + alpha) / total), H, np.log((M + beta) / total))
        if prior is None:
            return Voxels(RATE, H / R, np.log(H / R), -H / R)
        return Voxels(GAMMA, H + alpha, R + beta, -(H + alpha) * np.log1p(1 / (R + beta)))


def _priors(model: str, seen: Observations) -> tuple[dict[str, tuple[Array, Array] | None], npt.NDArray[np.bool_]]:
    """Priors by algorithm (the true one only where it is not the uniform one), and which rows have no moments."""
    ones = np.ones(len(seen.hits))
    if model == REFLECTION:
        uniform, fitted = (ones, ones), beta_by_moments(seen.hits / (seen.hits + seen.misses))
    else:
        uniform, fitted = (ones, 0 * ones), gamma_by_moments(seen.hits / seen.path)
    without = np.isnan(fitted[0])
    conjugate = np.where(without, uniform[0], fitted[0]), np.where(without, uniform[1], fitted[1])
    priors = {MAXIMUM: None, UNIFORM: uniform, CONJUGATE: conjugate}
    return priors if model == REFLECTION else {**priors, TRUE: (ones, ones)}, without


def _run_block(model: str, seen: Observations, energies: Array, conventions: Conventions, floor: float,
               out: Array) -> npt.NDArray[np.bool_]:  # fmt: skip
    """Localize in every map of a block; returns which have no moments."""
    forward, ring = conventions.ray == "forward", conventions.end == "ring"
    rows, N = seen.depths.shape
    passed, shares, returned = np.zeros((rows, N), np.int64), np.zeros((rows, N)), np.zeros((rows, N), np.bool_)
    for row in range(rows):
        fire(seen.depths[row], energies[row], forward, passed[row], shares[row], returned[row])
    priors, without = _priors(model, seen)
    belief = np.zeros(N)
    for name, prior in priors.items():
        known = voxels(model, seen, prior)
        silent = np.cumsum(known.miss[:, ::-1], axis=1)[:, ::-1].copy() if forward else known.miss
        mine = out[:, ALGORITHMS.index(name)]
        for row in range(rows):
            traverse(belief, ring, passed[row], shares[row], returned[row], known.form, known.first[row],
                     known.second[row], known.miss[row], silent[row], floor, mine[row])  # fmt: skip
    if TRUE not in priors:
        out[:, ALGORITHMS.index(TRUE)] = out[:, ALGORITHMS.index(UNIFORM)]
    out /= N
    return without


def simulate(
    model: str,
    visits: int,
    runs: int,
    count: int,
    seed: int,
    conventions: Conventions,
    floor: float,
) -> Beliefs:
    """Map and localize in ``runs`` new corridors of ``count`` voxels; the first runs of a longer call are the same.

    Parameters
    ----------
    model : {"REF", "DEC"}
    visits : int
        Observations of each voxel while mapping.
    runs, count, seed : int
    conventions : Conventions
    floor : float
        See :func:`benchmarks._corridor_kernels.traverse`.
    """
    values = np.zeros((runs, len(ALGORITHMS), len(MEASURES)))
    without = np.zeros(runs, np.bool_)

    def work(first: int, last: int) -> None:
        for block in range(first, last):
            rng = np.random.default_rng([seed, MODELS.index(model), visits, block])
            seen = observe(model, (_BLOCK, count), visits, rng)
            energies = rng.standard_exponential((_BLOCK, count))
            out = np.zeros((_BLOCK, *values.shape[1:]))
            degenerate = _run_block(model, seen, energies, conventions, floor, out)
            begin, rest = block * _BLOCK, min(_BLOCK, runs - block * _BLOCK)
            values[begin : begin + rest], without[begin : begin + rest] = out[:rest], degenerate[:rest]

    in_threads(work, -(-runs // _BLOCK))
    return Beliefs(values, int(without.sum()))
