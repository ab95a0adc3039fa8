"""What :mod:`benchmarks.maps_large` reads, and what it asks of the process that maps."""

from __future__ import annotations

from pydantic import Field

from factorloc.config import Block
from factorloc.simulation import SessionSettings, TownSettings

__all__ = ["Goals", "Job", "LargeSettings"]


class Goals(Block):
    """Bounds.

    Parameters
    ----------
    rays : float
        The least; of a full run.
    peak : float
        The most memory, GB (10^9 bytes).
    """

    rays: float
    peak: float


class LargeSettings(Block):
    """What ``maps_large.json`` holds.

    Parameters
    ----------
    seed : int
        Of town and drives.
    rays, quick_rays : float
        How many to cast at least, in a full run and in a quick one, in the same world.
    resolution : float
        Edge of a cell, m.
    town : TownSettings
        The world.
    sessions : SessionSettings
        What changes in it, and how far each session drives.
    count : int
        Sessions; each makes a partial map.
    faster : float
        How much faster each session is driven than the one before, m/s: else scans of two might be at the same poses.
    period : float
        Time between two scans, s; a quick run takes fewer of them.
    height : (float, float)
        Lowest and highest end of the map, m.
    margin : float
        How far the map reaches beyond the town, m.
    block_rays, part_block_rays : int
        After how many rays the whole map and the partial ones take in what was cast. They differ, so that the two are
        walked in different blocks.
    orders : tuple of tuple of int
        In which partial maps are merged.
    region : (float, float)
        Size of the region in the middle of the town that is read alone, m.
    goals : Goals
    """

    seed: int = Field(ge=0)
    rays: float = Field(gt=0)
    quick_rays: float = Field(gt=0)
    resolution: float = Field(gt=0)
    town: TownSettings
    sessions: SessionSettings
    count: int = Field(gt=0)
    faster: float = Field(ge=0)
    period: float = Field(gt=0)
    height: tuple[float, float]
    margin: float = Field(ge=0)
    block_rays: int = Field(gt=0)
    part_block_rays: int = Field(gt=0)
    orders: tuple[tuple[int, ...], ...]
    region: tuple[float, float]
    goals: Goals


class Job(Block):
    """What ``job.json`` holds.

    Parameters
    ----------
    settings : LargeSettings
    quick : bool
    threads : int
    columns : int
        Firings of the lidar in one turn; as sold if 0.
    """

    settings: LargeSettings
    quick: bool
    threads: int
    columns: int = Field(0, ge=0)
