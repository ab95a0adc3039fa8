"""Sweeps: the scans of a drive through space, cast when they are asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import overload

import numpy as np
import numpy.typing as npt

from factorloc.scan import Scan
from factorloc.simulation.spatial_lidar import SpatialLidar
from factorloc.simulation.streams import stream
from factorloc.simulation.world import World
from factorloc.trajectory import Trajectory

__all__ = ["Sweeps"]


@dataclass(frozen=True, eq=False)
class Sweeps(Sequence[Scan]):
    """A sequence of scans that takes no memory: each is cast anew whenever it is asked for, and always the same.

    Sweep ``k`` draws from a random stream of its own, so that it does not depend on which others were cast.

    Parameters
    ----------
    world : World
        Spatial surroundings.
    lidar : SpatialLidar
        The sensor.
    motion : Trajectory
        True poses ``T_world_body``, from before the first sweep begins until after the last ends.
    stamps : ndarray, shape (N,)
        Middle of each sweep, s.
    numbers : ndarray of int64, shape (N,)
        Number of each sweep in its drive.
    seed : int
        Of the drive.
    """

    world: World
    lidar: SpatialLidar
    motion: Trajectory
    stamps: npt.NDArray[np.float64]
    numbers: npt.NDArray[np.int64]
    seed: int

    def __len__(self) -> int:
        return len(self.stamps)

    @overload
    def __getitem__(self, index: int) -> Scan: ...

    @overload
    def __getitem__(self, index: slice) -> Sweeps: ...

    def __getitem__(self, index: int | slice) -> Scan | Sweeps:
        """Cast one sweep, or choose some without casting them."""
        if isinstance(index, slice):
            return replace(self, stamps=self.stamps[index], numbers=self.numbers[index])
        rng = stream(self.seed, "lidar", int(self.numbers[index]))
        return self.lidar.sweep(self.world, self.motion, rng, float(self.stamps[index]))
