"""The walks that :mod:`benchmarks.raycast` compares, bound to the returns they walk."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import numpy.typing as npt

from benchmarks._plain_kernels import plain_accumulate, plain_forward, plain_gradient
from benchmarks._walk_kernels import forward, gradient
from benchmarks.reference import CompiledReference
from benchmarks.returns import Returns
from factorloc._jit import in_threads
from factorloc.mapping._likelihood_kernels import decay_log_likelihoods
from factorloc.mapping._traversal_kernels import FIXED_POINT
from factorloc.mapping.accumulation import accumulate_rays
from factorloc.scan import RayStatus

__all__ = ["ACCUMULATION", "FORWARD", "GRADIENT", "Walk", "all_walks"]

Array = npt.NDArray[np.float64]

ACCUMULATION, FORWARD, GRADIENT = "accumulation", "forward", "forward + gradient"

_PLAIN, _CPP = "plain numba", "plain C++"


@dataclass(frozen=True)
class Walk:
    """One competitor.

    Parameters
    ----------
    kind, label : str
        What it computes, and who.
    run : callable
        Walk all returns once.
    results : callable
        What ``run`` has left behind, in arrays that all walks of a kind have in common.
    threads : int
        Threads it may use.
    goals : mapping of str to float
        The most time it may take, as a multiple of the time of the walk of that name.
    """

    kind: str
    label: str
    run: Callable[[], object]
    results: Callable[[], tuple[Array, ...]]
    threads: int = 1
    goals: Mapping[str, float] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Kind and label."""
        return f"{self.kind}: {self.label}"


def all_walks(returns: Returns, reference: CompiledReference | None, threads: int) -> list[Walk]:
    """Every competitor; the first of a kind is the one that the others must agree with.

    Parameters
    ----------
    returns : Returns
        What to walk.
    reference : CompiledReference or None
        The C++ walk, if it could be compiled.
    threads : int
        Threads of the parallel walks; with 1 they are left out.
    """
    one, many = "factorloc, 1 thread", f"factorloc, {threads} threads"
    cpp, plain = f"{ACCUMULATION}: {_CPP}", f"{FORWARD}: {_PLAIN}"
    walks = [
        _plain_accumulation(_PLAIN, plain_accumulate, returns),
        _accumulation(one, returns, 1, {cpp: 1.6}),
        _plain_likelihoods(FORWARD, plain_forward, returns),
        _likelihoods(FORWARD, one, forward, returns, 1, {plain: 0.8}),
        _clipped_likelihoods("factorloc, clipping", returns),
        _plain_likelihoods(GRADIENT, plain_gradient, returns),
        _likelihoods(GRADIENT, one, gradient, returns, 1, {plain: 1.2}),
    ]
    if threads > 1:
        walks += [
            _accumulation(many, returns, threads, {cpp: 1.0}),
            _likelihoods(FORWARD, many, forward, returns, threads, {}),
            _likelihoods(GRADIENT, many, gradient, returns, threads, {}),
        ]
    if reference is not None:
        walks.insert(0, _plain_accumulation(_CPP, reference.accumulate, returns))
    return walks


def _plain_accumulation(label: str, kernel: Callable[..., int], returns: Returns) -> Walk:
    rim = (returns.shape[0] + 2, returns.stride)
    path, hits = np.zeros(rim, np.float32), np.zeros(rim, np.uint32)
    run = partial(kernel, *returns.rays, returns.low, returns.resolution, returns.stride, path.ravel(), hits.ravel())
    inside = np.s_[1:-1, 1:-1]
    return Walk(ACCUMULATION, label, run, lambda: (path[inside].astype(float), hits[inside].astype(float)))


def _accumulation(label: str, returns: Returns, threads: int, goals: Mapping[str, float]) -> Walk:
    hits, misses = (np.zeros(returns.shape, np.uint32) for _ in range(2))
    path, ends = np.zeros(returns.shape, np.int64), np.ones(len(returns.lengths), np.bool_)
    grid = (returns.low, returns.resolution, returns.shape)
    run = partial(accumulate_rays, *returns.rays, ends, *grid, threads, hits, misses, path)
    return Walk(ACCUMULATION, label, run, lambda: (path / FIXED_POINT, hits.astype(float)), threads, goals)


def _plain_likelihoods(kind: str, kernel: Callable[..., None], returns: Returns) -> Walk:
    model, written = _likelihood_arrays(kind, returns)
    return Walk(kind, _PLAIN, partial(kernel, *model, *returns.rays, *written), lambda: written)


def _likelihoods(
    kind: str, label: str, kernel: Callable[..., None], returns: Returns, threads: int, goals: Mapping[str, float]
) -> Walk:
    model, written = _likelihood_arrays(kind, returns)

    def walk(first: int, last: int) -> None:
        kernel(*model, *returns.rays, first, last, *written)

    return Walk(kind, label, partial(in_threads, walk, len(returns.lengths)), lambda: written, threads, goals)


def _likelihood_arrays(kind: str, returns: Returns) -> tuple[tuple[object, ...], tuple[Array, ...]]:
    """What the kernels read, and what they write."""
    count = len(returns.lengths)
    model = (returns.rates, returns.log_rates, returns.stride, returns.low, returns.resolution)
    return model, (np.empty(count),) if kind == FORWARD else (np.empty(count), np.empty((count, 4)))


def _clipped_likelihoods(label: str, returns: Returns) -> Walk:
    """The kernel behind the maps' own likelihood, which clips rays and knows those without return."""
    count = len(returns.lengths)
    status, each, sums = np.full(count, RayStatus.RETURN, np.uint8), np.empty((1, count)), np.empty(1)
    grid = (returns.shape, returns.rates[0], returns.low, returns.resolution)
    here = np.array([[0.0, 0.0, 1.0, 0.0]])
    run = partial(decay_log_likelihoods, returns.rates, *grid, here, 1, *returns.rays, status, each, sums)
    return Walk(FORWARD, label, run, lambda: (each[0],))
