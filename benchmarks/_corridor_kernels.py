"""Rays and beliefs in a row of voxels of length 1: what a sensor measures, and how a histogram filter weighs it.

A pose is the voxel whose near face the sensor stands on, looking along the row. Beliefs are kept by the voxel in which
the robot would have started, so that known motion moves no memory: start ``k`` means voxel ``k + step`` now, or, on a
ring, that less the number of voxels. They are logarithms: a most likely map can hold a decay rate of 10,000, which
makes a miss as unlikely as exp(-10,000), but not impossible; only minus infinity is.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from factorloc._jit import kernel

Array = npt.NDArray[np.float64]

TABLE, RATE, GAMMA = 0, 1, 2  # forms of the density of a return: see log_hit


@kernel(allocates=False)
def fire(depths: Array, energies: Array, ahead: bool, passed: Array, lengths: Array, returned: Array) -> None:
    """Fire once from each voxel of a row in turn.

    Parameters
    ----------
    depths : (N,) float
        Optical depth of each voxel: a ray passes it with probability ``exp(-depth)``.
    energies : (N,) float
        Optical depth at which each ray ends; standard exponential variates.
    ahead : bool
        Whether a ray that passes its own voxel goes on through the row.
    passed, lengths, returned : (N,) int64, float, bool
        Written: voxels passed before the one that reflects, share of that one's depth used up, and whether any did.
    """
    N = depths.shape[0]
    for x in range(N):
        left = energies[x]
        last = N if ahead else x + 1
        i = x
        while i < last and left >= depths[i]:
            left -= depths[i]
            i += 1
        passed[x] = i - x
        returned[x] = i < last
        lengths[x] = left / depths[i] if i < last else 1.0


@kernel(allocates=False, inline=True)
def log_hit(form: int, first: float, second: float, length: float) -> float:
    """Log-likelihood that a voxel reflects after ``length``.

    ``TABLE``: ``first``, whatever the length (eq. 8.22 and 8.23). ``RATE``: of the decay rate ``first``, whose
    logarithm is ``second`` (eq. 8.4). ``GAMMA``: of a rate distributed as Gamma(``first``, ``second``) (below 8.22).
    """
    if form == TABLE:
        return first
    if form == RATE:
        return second - first * length
    return math.log(first / (second + length)) - first * math.log1p(length / second)


@kernel(allocates=False)
def weigh(
    belief: Array,
    start: int,
    stop: int,
    offset: int,
    passed: int,
    length: float,
    returned: bool,
    form: int,
    first: Array,
    second: Array,
    miss: Array,
    silent: Array,
) -> None:
    """Add to the log beliefs of starts ``start:stop``, now in voxels ``start + offset`` on, their log-likelihoods.

    Parameters
    ----------
    belief : (N,) float
        Changed.
    start, stop, offset : int
        Starts, and from them to voxels.
    passed, length, returned : int, float, bool
        The ray, as of :func:`fire`, in space: ``length`` of the reflecting voxel.
    form, first, second : int, (N,) float, (N,) float
        See :func:`log_hit`.
    miss, silent : (N,) float
        Log-probability that a ray passes a voxel, and that one from there has no return.
    """
    if not returned:
        for k in range(start, stop):
            belief[k] += silent[k + offset]
        return
    within = max(start, min(stop, first.shape[0] - passed - offset))  # further on, the return would lie behind the row
    for j in range(passed):
        for k in range(start, within):
            belief[k] += miss[k + offset + j]
    for k in range(start, within):
        i = k + offset + passed
        belief[k] += log_hit(form, first[i], second[i], length)
    for k in range(within, stop):
        belief[k] = -np.inf


@kernel(allocates=False)
def traverse(
    belief: Array,
    ring: bool,
    passed: Array,
    lengths: Array,
    returned: Array,
    form: int,
    first: Array,
    second: Array,
    miss: Array,
    silent: Array,
    floor: float,
    out: Array,
) -> None:
    """Follow a robot from the first voxel to the last, one ray and one update in each.

    Parameters
    ----------
    belief : (N,) float
        Overwritten.
    ring : bool
        Whether who leaves at the end enters at the beginning; otherwise that is impossible.
    passed, lengths, returned : (N,) int64, float, bool
        The rays, as of :func:`weigh`.
    form, first, second, miss, silent
        What is known of the row, as of :func:`weigh`.
    floor : float
        What smaller beliefs are raised to before their logarithm is taken.
    out : (6,) float
        Written: belief at the true pose, its logarithm with the floor, and without it where it is not zero, each summed
        over the row; how often it was zero; how often all beliefs were; and the sum of squares of all beliefs, which
        is the belief at the true pose a robot should expect that believes rightly.
    """
    N = first.shape[0]
    log_floor = math.log(floor)
    for m in range(out.shape[0]):
        out[m] = 0.0
    for k in range(N):
        belief[k] = 0.0
    for x in range(N):
        weigh(belief, 0, N - x, x, passed[x], lengths[x], returned[x], form, first, second, miss, silent)
        stop = N if ring else N - x
        if ring:
            weigh(belief, N - x, N, x - N, passed[x], lengths[x], returned[x], form, first, second, miss, silent)
        most = -np.inf
        for k in range(stop):
            most = max(most, belief[k])
        if most == -np.inf:
            out[4] += 1.0
            most = 0.0
            for k in range(stop):
                belief[k] = 0.0
        total = 0.0
        square = 0.0
        for k in range(stop):
            belief[k] -= most
            share = math.exp(belief[k])
            total += share
            square += share * share
        truth = belief[0] - math.log(total)
        out[0] += math.exp(truth)
        out[1] += max(truth, log_floor)
        if truth > -np.inf:
            out[2] += truth
        else:
            out[3] += 1.0
        out[5] += square / (total * total)
