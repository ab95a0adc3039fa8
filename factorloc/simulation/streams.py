"""Random streams by name: what one thing draws never changes what another gets."""

from __future__ import annotations

import zlib

import numpy as np

from factorloc.errors import SimulationError

__all__ = ["stream"]


def stream(seed: int, *path: str | int) -> np.random.Generator:
    """Return the generator of one noun, independent of all others of the same seed.

    Parameters
    ----------
    seed : int
        Seed of the whole world, not negative.
    path : str or int
        What the numbers are for, such as ``"parked cars", 3``: name, number of the session, and so on. Numbers are not
        negative.

    Raises
    ------
    SimulationError
        If the seed or a number is negative.
    """
    if seed < 0 or any(isinstance(part, int) and part < 0 for part in path):
        raise SimulationError(f"random stream {path} of seed {seed}: negative; take 0 or more")
    # A name and the number that happens to be its checksum must not share a stream: names get a mark.
    key = [word for part in path for word in ((1, zlib.crc32(part.encode())) if isinstance(part, str) else (0, part))]
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=tuple(key)))
