"""Accumulation: rays brought into the frame of a grid and walked through it by several threads."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from functools import partial

import numpy as np
import numpy.typing as npt

from factorloc import _jit
from factorloc.errors import MapError
from factorloc.geometry import se2
from factorloc.mapping._traversal_kernels import MOST_RAYS, accumulate, add_private
from factorloc.rays import Rays

__all__ = ["BYTES_A_THREAD", "accumulate_rays", "rays_in_map"]

Array = npt.NDArray[np.float64]

BYTES_A_THREAD = 12
"""Memory a thread needs for each cell while rays are added."""

_PARTS_A_THREAD = 8  # so that a thread with short rays takes more of them


def rays_in_map(rays: Rays, poses: npt.ArrayLike) -> tuple[Array, Array]:
    """Origins and directions of planar rays in the frame of the map, one pose ``T_map_body`` a scan.

    Parameters
    ----------
    rays : Rays
        Rays in body frames.
    poses : array_like, shape (S, 3)
        One pose a scan.

    Returns
    -------
    origins, directions : ndarray, shape (M, 2)
        Contiguous.

    Raises
    ------
    MapError
        If the rays are not planar, or there is not one planar pose a scan.
    """
    if rays.dimension != 2:
        raise MapError("scans: spatial; this grid of ray statistics is planar")
    array = se2.as_poses(poses)
    if array.shape != (len(rays), 3):
        raise MapError(f"poses: shape {array.shape}; expected one planar pose for each of the {len(rays)} scans")
    each = np.repeat(array, np.diff(rays.offsets), axis=0)
    return se2.transform(each, rays.origins), se2.rotate(each[:, 2], rays.directions)


def accumulate_rays(
    origins: Array,
    directions: Array,
    lengths: Array,
    is_return: npt.NDArray[np.bool_],
    low: Array,
    resolution: float,
    shape: tuple[int, int],
    threads: int,
    hits: npt.NDArray[np.uint32],
    misses: npt.NDArray[np.uint32],
    path: npt.NDArray[np.int64],
) -> None:
    """Walk rays through a planar grid and add what they leave to three arrays.

    Every thread owns a private array and takes parts of the rays until none is left. What it adds up are integers, so
    neither the number of threads nor who took which part leaves a trace. Arguments as
    :func:`factorloc.mapping._traversal_kernels.accumulate`.
    """
    private = np.zeros((threads, (shape[0] + 2) * (shape[1] + 2)), np.int64)
    private_hits = np.zeros(private.shape, np.uint32)

    def walk(waiting: Iterator[tuple[int, int]], first: int, last: int) -> None:
        for own, own_hits in zip(private[first:last], private_hits[first:last], strict=True):
            for part in waiting:
                accumulate(
                    origins, directions, lengths, is_return, *part, low, resolution, shape, own, own_hits
                )  # fmt: skip

    for begin in range(0, len(lengths), MOST_RAYS):
        stop = min(begin + MOST_RAYS, len(lengths))
        if begin:
            private[:], private_hits[:] = 0, 0
        count = _PARTS_A_THREAD * threads if threads > 1 else 1
        edges = [begin + (stop - begin) * part // count for part in range(count + 1)]
        # To take the next is one step of the interpreter: none is taken twice.
        waiting = iter(itertools.pairwise(edges))
        _jit.in_threads(partial(walk, waiting), threads)
        # Bound by memory: a second thread would not make it faster.
        add_private(private, private_hits, shape, hits, misses, path)
