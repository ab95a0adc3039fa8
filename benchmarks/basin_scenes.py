"""Where scans are registered: a map, scans that did not make it, and where they were taken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from pydantic import Field

from benchmarks.kitti_frames import read_frames
from factorloc.config import Block
from factorloc.geometry import se3
from factorloc.mapping import BrickStatistics
from factorloc.scan import Scan
from factorloc.simulation import SpatialRoute, StreetSettings, hdl_32e, simulate_drive, street_route, street_world

__all__ = ["DRIVE", "STREET", "DriveQueries", "Scene", "StreetQueries", "drive_scene", "street_scene"]

Array = npt.NDArray[np.float64]

STREET, DRIVE = "street", "0005"
"""Names of the scenes."""


class StreetQueries(Block):
    """A simulated street, driven along once with an HDL-32E for the map, and then looked at from elsewhere.

    Parameters
    ----------
    street : StreetSettings
        The street.
    columns : int
        Firings in one turn of the lidar.
    range_limits : (float, float)
        Its minimum and maximum range, m.
    range_sigma : float
        Noise of its ranges, m.
    speed, period : float
        Of the drive that makes the map, in the right-hand lane: m/s, and time between scans, s.
    margin, lateral, heading : float
        Queries stand anywhere on the street, so far from its ends at least, so far from its middle at most (m), and
        turned away from one of its two directions by so much at most (deg).
    queries : int
        How many.
    """

    street: StreetSettings
    columns: int = Field(gt=0)
    range_limits: tuple[float, float]
    range_sigma: float = Field(ge=0)
    speed: float = Field(gt=0)
    period: float = Field(gt=0)
    margin: float = Field(ge=5)
    lateral: float = Field(ge=0)
    heading: float = Field(ge=0)
    queries: int = Field(gt=0)


class DriveQueries(Block):
    """KITTI raw drive 0005: every other frame makes the map, the others are registered.

    Parameters
    ----------
    range_limits : (float, float)
        Minimum and maximum range to use, m.
    draws : int
        Starts from each frame and offset.
    """

    range_limits: tuple[float, float]
    draws: int = Field(gt=0)


@dataclass(frozen=True)
class Scene:
    """A map with queries.

    Parameters
    ----------
    name : str
    truth_is : str
        What the poses are, in words.
    statistics : BrickStatistics
        The map.
    points : ndarray, shape (P, 3)
        All returns it was made of, in its frame, m.
    scans : sequence of Scan
        Queries.
    truth : ndarray, shape (Q, 4, 4)
        Their poses ``T_map_body``.
    """

    name: str
    truth_is: str
    statistics: BrickStatistics
    points: Array
    scans: Sequence[Scan]
    truth: Array

    def __len__(self) -> int:
        return len(self.scans)


def street_scene(settings: StreetQueries, resolution: float, seed: int, quick: bool = False) -> Scene:
    """Simulate the street; drive and queries draw their noise from streams of their own.

    Parameters
    ----------
    settings : StreetQueries
        What to simulate.
    resolution : float
        Edge length of a cell of the map, m.
    seed : int
        Of everything.
    quick : bool
        Whether to make do with every fourth query.
    """
    world = street_world(settings.street, seed)
    route = street_route(settings.street, settings.speed)
    lidar = hdl_32e(columns=settings.columns, range_limits=settings.range_limits, range_sigma=settings.range_sigma)
    mapping = simulate_drive(world, route, lidar, seed=seed, period=settings.period)
    rng = np.random.default_rng([seed, 1])
    n, reach = settings.queries, np.radians(settings.heading)
    x = rng.uniform(settings.margin, settings.street.length - settings.margin, n)
    y = rng.uniform(-settings.lateral, settings.lateral, n)
    heading = rng.choice([0.0, np.pi], n) + rng.uniform(-reach, reach, n)
    truth = SpatialRoute(route).lift(world, np.stack([x, y, heading], -1))[:: 4 if quick else 1]
    scans = lidar.cast_many(world, truth, rng)
    return _scene(STREET, "true", mapping.scans, mapping.truth.poses, scans, truth, resolution)


def drive_scene(data: Path | None, settings: DriveQueries, resolution: float, quick: bool = False) -> Scene:
    """Read the drive: even frames make the map, odd ones are queries (every other of them in a quick run).

    Raises
    ------
    DataError
        If there is no data, or it cannot be read.
    """
    frames = read_frames(data, settings.range_limits)
    even, odd = frames.select(slice(0, None, 2)), frames.select(slice(1, None, 4 if quick else 2))
    draws = 1 if quick else settings.draws
    reference = "scan-to-map GICP of the same drive: a consistency figure, no error against truth"
    scans, truth = tuple(odd.scans) * draws, np.tile(odd.poses, (draws, 1, 1))
    return _scene(DRIVE, reference, even.scans, even.poses, scans, truth, resolution)


def _scene(
    name: str, truth_is: str, mapping: Sequence[Scan], poses: Array, scans: Sequence[Scan], truth: Array, edge: float
) -> Scene:
    statistics = BrickStatistics.from_scans(mapping, poses, resolution=edge)
    points = [
        se3.transform(se3.compose(pose, scan.T_body_sensor), scan.points())
        for scan, pose in zip(mapping, poses, strict=True)
    ]
    return Scene(name, truth_is, statistics, np.concatenate(points), scans, truth)
