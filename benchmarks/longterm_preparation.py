"""Preparation of the long-term sessions: scans cast and poles found, several sessions at a time, into the cache."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from benchmarks.longterm_poles import detect
from benchmarks.longterm_sessions import LongtermWorld, record
from factorloc import set_threads
from factorloc.mapping.pole_settings import PoleSettings

__all__ = ["prepare"]


def prepare(
    numbers: Sequence[int], world: LongtermWorld, poles: PoleSettings, cache: Path, processes: int
) -> Iterator[int]:
    """Record sessions and find the poles along them, so that the cache holds both.

    Processes, not threads: most of it is Python and the ray caster, which hold the interpreter.

    Parameters
    ----------
    numbers : sequence of int
        Which sessions.
    world : LongtermWorld
        What they follow from.
    poles : PoleSettings
        Of the local maps.
    cache : Path
        Folder of all recordings and detections.
    processes : int
        Sessions at a time; with 1 no process is started.

    Yields
    ------
    int
        Number of a session that is done.
    """
    if processes == 1 or len(numbers) < 2:
        for number in numbers:
            yield _prepare(number, world, poles, cache)
        return
    # Spawned: a fork would inherit threads of kernels and locks they hold.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, mp_context=context, initializer=set_threads, initargs=(1,)) as pool:
        waiting = [pool.submit(_prepare, number, world, poles, cache) for number in numbers]
        for done in as_completed(waiting):
            yield done.result()


def _prepare(number: int, world: LongtermWorld, poles: PoleSettings, cache: Path) -> int:
    detect(record(world, number, cache), world, poles, cache)
    return number
