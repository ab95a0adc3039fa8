"""Who registers scans: factorloc through its levels, and small_gicp with the points of the same map."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import small_gicp
from pydantic import Field

from factorloc.config import Block
from factorloc.factors.level_tables import LevelTables
from factorloc.geometry import se3
from factorloc.localization import PreparedMap, register_many
from factorloc.scan import Scan

__all__ = ["PYRAMID", "REGISTER", "Competitor", "PointMap", "Rivals", "own"]

Array = npt.NDArray[np.float64]
Align = Callable[[Any, Array], Array]

REGISTER, PYRAMID = "factorloc register", "factorloc pyramid"
"""The levels a single registration goes through; and all levels of decay rates, without the distance field."""

_VOXELS = "VGICP"


class Rivals(Block):
    """How small_gicp registers; tolerances are its own.

    Parameters
    ----------
    sampling : float
        Edge length of the voxels that map and scan are thinned by, m.
    neighbours : int
        Points a neighbourhood is made of.
    max_iterations : int
        Steps of each registration.
    reaches : dict of str to tuple of float
        By name, the registrations that follow each other: longest distance of a correspondence; of VGICP, which is
        told by its name, also the edge length of a voxel; m.
    """

    sampling: float = Field(gt=0)
    neighbours: int = Field(ge=5)
    max_iterations: int = Field(gt=0)
    reaches: dict[str, tuple[float, ...]]


@dataclass(frozen=True)
class Competitor:
    """A way of registering a scan in a map.

    Parameters
    ----------
    name : str
    prepare : callable
        Makes of a scan what ``align`` wants; once a scan.
    align : callable
        From that and a start pose ``T_map_body`` to the pose found.
    """

    name: str
    prepare: Callable[[Scan], Any]
    align: Align


def own(prepared: PreparedMap) -> list[Competitor]:
    """factorloc, with the levels of a single registration, and with all levels of decay rates."""
    assert isinstance(prepared.levels, LevelTables)
    every = list(range(1, len(prepared.levels.blurs)))

    def through(levels: list[int] | None) -> Align:
        return lambda term, guess: register_many(term, guess[None], levels=levels).poses[0]

    return [
        Competitor(name, lambda scan: prepared.term([scan]), through(levels))
        for name, levels in ((REGISTER, prepared.quick_levels), (PYRAMID, every))
    ]


class PointMap:
    """Points of a map as small_gicp wants them.

    Parameters
    ----------
    points : ndarray, shape (P, 3)
        In the frame of the map, m.
    settings : Rivals
        How they are thinned, and what they are used for.
    """

    def __init__(self, points: Array, settings: Rivals) -> None:
        self.settings = settings
        # One thread: with more, which points are kept depends on chance.
        self.cloud, self.tree = small_gicp.preprocess_points(points, settings.sampling, settings.neighbours, 1)
        sizes = {reach for name, reaches in settings.reaches.items() if name.startswith(_VOXELS) for reach in reaches}
        self.voxels = {size: small_gicp.GaussianVoxelMap(size) for size in sizes}
        for voxels in self.voxels.values():
            voxels.insert(self.cloud)

    def __len__(self) -> int:
        return int(self.cloud.size())

    def rivals(self) -> list[Competitor]:
        """All of them, on one thread."""
        return [
            Competitor(name, self._thinned, _chain([self._step(name, reach) for reach in reaches]))
            for name, reaches in self.settings.reaches.items()
        ]

    def _thinned(self, scan: Scan) -> Any:
        body = se3.transform(scan.T_body_sensor, scan.points())
        return small_gicp.preprocess_points(body, self.settings.sampling, self.settings.neighbours, 1)[0]

    def _step(self, name: str, reach: float) -> Align:
        options = {
            "max_correspondence_distance": reach,
            "max_iterations": self.settings.max_iterations,
            "num_threads": 1,
        }
        if name.startswith(_VOXELS):
            voxels = self.voxels[reach]
            return lambda source, guess: _pose(small_gicp.align(voxels, source, guess, **options))
        return lambda source, guess: _pose(small_gicp.align(self.cloud, source, self.tree, guess, **options))


def _chain(steps: Sequence[Align]) -> Align:
    def align(source: Any, guess: Array) -> Array:
        for step in steps:
            guess = step(source, guess)
        return guess

    return align


def _pose(result: Any) -> Array:
    return np.asarray(result.T_target_source)
