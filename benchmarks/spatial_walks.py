"""The walks through space that :mod:`benchmarks.raycast` compares, bound to the returns they walk.

``factorloc`` walks a dense grid, ``factorloc bricks`` bricks of 16 x 16 x 16 cells, after it has marked them. Both add
to arrays that are kept from call to call, as the references do. The calls of the package lay out new arrays each time,
and so pay for memory that the system hands out page by page: they are a kind of their own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
import numpy.typing as npt

from benchmarks._spatial_plain_kernels import plain_accumulate, plain_forward, plain_gradient
from benchmarks._spatial_walk_kernels import forward, gradient
from benchmarks.reference import CompiledReference
from benchmarks.spatial_returns import SpatialReturns
from benchmarks.walks import ACCUMULATION, FORWARD, GRADIENT, Walk
from factorloc._jit import in_threads
from factorloc.mapping._traversal_kernels import FIXED_POINT, MISS_BITS
from factorloc.mapping.bricks import BRICK, CELLS, BrickLayout
from factorloc.mapping.grid import require_memory
from factorloc.mapping.spatial_accumulation import accumulate_bricks, accumulate_dense, touched_bricks, walk_spatial

__all__ = ["BYTES_AT_REST", "BYTES_A_CELL", "NEW_ARRAYS", "all_spatial_walks"]

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]

BYTES_AT_REST = 16
"""Bytes a cell of a dense map: hits and misses in 4 each, the path length in 8."""

BYTES_A_CELL = 36
"""Bytes a cell of all dense arrays in memory at a time: the references share 8, kept and new statistics take 12 each,
rates 4."""

NEW_ARRAYS = "accumulation, new arrays"

Packed = tuple[Index, npt.NDArray[np.uint32]]
_PLAIN, _CPP = "plain numba", "plain C++"
_DENSE, _BRICKS = "factorloc", "factorloc bricks"
_BRICKS_TO_DENSE = 1.6


def all_spatial_walks(returns: SpatialReturns, reference: CompiledReference | None, threads: int) -> list[Walk]:
    """Every competitor; the first of a kind is the one that the others must agree with.

    Parameters
    ----------
    returns : SpatialReturns
        What to walk.
    reference : CompiledReference or None
        The C++ walk, if it could be compiled.
    threads : int
        Threads of the parallel walks; with 1 they are left out.

    Raises
    ------
    MapError
        If the dense arrays do not fit into memory.
    """
    require_memory(BYTES_A_CELL * returns.dense_size, f"a dense grid of {returns.dense_size / 1e6:.0f} million cells")
    cpp, plain, dense = f"{ACCUMULATION}: {_CPP}", f"{FORWARD}: {_PLAIN}", f"{ACCUMULATION}: {_DENSE}, 1 thread"
    shared = np.zeros(returns.dense_size, np.float32), np.zeros(returns.dense_size, np.uint32)
    kept = _Kept(returns)
    walks = [
        _plain_accumulation(_PLAIN, plain_accumulate, returns, shared),
        kept.dense(1, {cpp: 1.6}),
        kept.bricks(1, {dense: _BRICKS_TO_DENSE}),
        *_new_arrays(returns, 1),
        _plain_likelihoods(FORWARD, plain_forward, returns),
        *_likelihoods(FORWARD, forward, returns, 1, {plain: 0.8}),
        _plain_likelihoods(GRADIENT, plain_gradient, returns),
        *_likelihoods(GRADIENT, gradient, returns, 1, {plain: 1.2}),
    ]
    if threads > 1:
        walks += [
            kept.dense(threads, {cpp: 1.0}),
            kept.bricks(threads, {}),
            *_new_arrays(returns, threads),
            *_likelihoods(FORWARD, forward, returns, threads, {}),
            *_likelihoods(GRADIENT, gradient, returns, threads, {}),
        ]
    if reference is not None:
        walks.insert(0, _plain_accumulation(_CPP, reference.accumulate_spatial, returns, shared))
    return walks


def _label(layout: str, threads: int) -> str:
    return f"{layout}, {threads} thread{'s' if threads > 1 else ''}"


def _plain_accumulation(
    label: str,
    kernel: Callable[..., int],
    returns: SpatialReturns,
    shared: tuple[npt.NDArray[np.float32], npt.NDArray[np.uint32]],
) -> Walk:
    run = partial(kernel, *returns.rays, returns.low, returns.grid.resolution, *returns.strides[:2], *shared)

    def results() -> tuple[Array, ...]:
        path, hits = shared
        path[:], hits[:] = 0, 0
        run()
        totals = (np.array([values.sum(dtype=np.float64)]) for values in shared)
        return path[returns.dense_cells].astype(float), hits[returns.dense_cells].astype(float), *totals

    return Walk(ACCUMULATION, label, run, results)


class _Kept:
    """The package's walks of all returns, into arrays that are kept and shared.

    Parameters
    ----------
    returns : SpatialReturns
        What to walk.
    """

    def __init__(self, returns: SpatialReturns) -> None:
        self._rays, self._grid = _all_return(returns), returns.grid
        self._layout = touched_bricks(*self._rays, self._grid, 1)
        self._dense = _zeros(returns.dense_size)
        self._pool = _zeros((len(self._layout.bricks) + 1) * CELLS)
        self._dense_cells, self._places = returns.dense_cells, _places(returns, self._layout)

    def dense(self, threads: int, goals: Mapping[str, float]) -> Walk:
        """Walk the dense grid."""
        run = partial(walk_spatial, *self._rays, self._grid, None, *self._dense, threads)
        return self._competitor(_DENSE, run, self._dense, self._dense_cells, threads, goals)

    def bricks(self, threads: int, goals: Mapping[str, float]) -> Walk:
        """Mark the bricks that are met, and walk them."""

        def run() -> None:
            layout = touched_bricks(*self._rays, self._grid, threads)
            walk_spatial(*self._rays, self._grid, layout.directory, *self._pool, threads)

        return self._competitor(_BRICKS, run, self._pool, self._places, threads, goals)

    @staticmethod
    def _competitor(
        layout: str, run: Callable[[], None], kept: Packed, cells: Index, threads: int, goals: Mapping[str, float]
    ) -> Walk:
        def results() -> tuple[Array, ...]:
            for array in kept:
                array[:] = 0
            run()
            return _statistics(kept, (cells,))

        return Walk(ACCUMULATION, _label(layout, threads), run, results, threads, goals)


def _new_arrays(returns: SpatialReturns, threads: int) -> list[Walk]:
    """The calls of the package as it makes them."""
    rays, grid, keys = _all_return(returns), returns.grid, returns.statistics.keys
    dense = partial(accumulate_dense, *rays, grid, threads)

    def bricks() -> Packed:
        return accumulate_bricks(*rays, touched_bricks(*rays, grid, threads), threads)

    def dense_results() -> tuple[Array, ...]:
        return _statistics(dense(), tuple(returns.layout.cells(keys).T))

    def brick_results() -> tuple[Array, ...]:
        places = _places(returns, touched_bricks(*rays, grid, threads))
        walked, hits = bricks()
        return _statistics((walked.ravel(), hits.ravel()), (places,))

    return [
        Walk(NEW_ARRAYS, _label(_DENSE, threads), dense, dense_results, threads),
        Walk(NEW_ARRAYS, _label(_BRICKS, threads), bricks, brick_results, threads),
    ]


def _all_return(returns: SpatialReturns) -> tuple[Array, Array, Array, npt.NDArray[np.bool_]]:
    return (*returns.rays, np.ones(len(returns.lengths), np.bool_))


def _places(returns: SpatialReturns, layout: BrickLayout) -> Index:
    """Where the visited cells of the map lie in a pool; those whose brick is not there, in the spare one."""
    keys = returns.statistics.keys
    return np.where(np.isin(keys // CELLS, layout.bricks), layout.places(keys), 0)


def _zeros(cells: int) -> Packed:
    return np.zeros(cells, np.int64), np.zeros(cells, np.uint32)


def _statistics(packed: Packed, cells: tuple[Index, ...]) -> tuple[Array, ...]:
    """Path lengths and hits in the visited cells of the map; and in all cells together, that none are elsewhere."""
    path, hits = packed[0] >> MISS_BITS, packed[1]
    totals = np.array([path.sum()]) / FIXED_POINT, np.array([hits.sum()], np.float64)
    return path[cells] / FIXED_POINT, hits[cells].astype(np.float64), *totals


def _plain_likelihoods(kind: str, kernel: Callable[..., None], returns: SpatialReturns) -> Walk:
    written = _written(kind, returns)
    grid = (returns.low, returns.grid.resolution, *returns.strides[:2], returns.dense_rates)
    return Walk(kind, _PLAIN, partial(kernel, *returns.rays, *grid, *written), lambda: written)


def _likelihoods(
    kind: str, kernel: Callable[..., None], returns: SpatialReturns, threads: int, goals: Mapping[str, float]
) -> list[Walk]:
    """Through the dense grid, with its goals, and through bricks, which may take so many times what the grid takes."""
    dense = (None, returns.dense_rates, returns.strides, 1.0)
    bricks = (returns.layout.directory, returns.brick_rates, returns.layout.strides, float(BRICK))
    return [
        _likelihood(kind, _label(layout, threads), kernel, returns, model, threads, wanted)
        for layout, model, wanted in (
            (_DENSE, dense, goals),
            (_BRICKS, bricks, {f"{kind}: {_label(_DENSE, threads)}": _BRICKS_TO_DENSE} if goals else {}),
        )
    ]


def _likelihood(
    kind: str,
    label: str,
    kernel: Callable[..., None],
    returns: SpatialReturns,
    model: tuple[object, ...],
    threads: int,
    goals: Mapping[str, float],
) -> Walk:
    written = _written(kind, returns)
    rays = (*returns.rays, returns.low, returns.grid.resolution)

    def walk(first: int, last: int) -> None:
        kernel(*rays, *model, first, last, *written)

    return Walk(kind, label, partial(in_threads, walk, len(returns.lengths)), lambda: written, threads, goals)


def _written(kind: str, returns: SpatialReturns) -> tuple[Array, ...]:
    count = len(returns.lengths)
    return (np.empty(count),) if kind == FORWARD else (np.empty(count), np.empty((count, 6)))
