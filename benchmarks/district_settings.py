"""What ``facades_districts.json`` holds."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from benchmarks.district_errors import MapErrors, OdometryErrors
from benchmarks.district_world import WorldSettings
from factorloc.config import Block
from factorloc.simulation import SpatialLidar, hdl_32e, hdl_64e

__all__ = ["SETTINGS", "DistrictSettings"]

SETTINGS = Path(__file__).with_name("facades_districts.json")
"""Everything that was chosen."""


class LidarSettings(Block):
    """The sensor.

    Parameters
    ----------
    model : str
        ``hdl_32e`` or ``hdl_64e``.
    columns : int
        Firings of a turn.
    dropout : float
        Share of reflections that are not noticed.
    unit : float
        Ranges are kept in whole numbers of it, m.
    """

    model: Literal["hdl_32e", "hdl_64e"]
    columns: int = Field(gt=0)
    dropout: float = Field(ge=0, lt=1)
    unit: float = Field(gt=0)

    @property
    def lidar(self) -> SpatialLidar:
        """As it is simulated."""
        make = {"hdl_32e": hdl_32e, "hdl_64e": hdl_64e}[self.model]
        return make(columns=self.columns, dropout=self.dropout)


class BodySettings(Block):
    """How the body stands: roll and pitch up to ``tilt`` (deg), height up to ``height`` (m) off; uniform."""

    tilt: float = Field(ge=0)
    height: float = Field(ge=0)


class DriveSettings(Block):
    """Drives of ``length`` (m) with a scan each ``spacing``, ``lane`` off the middle, ``clearance`` off obstacles."""

    length: float = Field(gt=0)
    spacing: float = Field(gt=0)
    lane: float = Field(ge=0)
    clearance: float = Field(gt=0)


class ShotSettings(Block):
    """Single poses up to ``lateral`` (m) off the middle, headings off by ``heading_sigma`` (deg) of the street's.

    They are ``clearance`` off obstacles, and ``within`` of some building, m.
    """

    lateral: float = Field(ge=0)
    heading_sigma: float = Field(ge=0)
    clearance: float = Field(gt=0)
    within: float = Field(gt=0)


class TownShape(Block):
    """Generated towns: blocks along either axis, and their sizes, m."""

    blocks: int = Field(gt=0)
    block_length: float = Field(gt=0)
    block_depth: float = Field(gt=0)


class Split(Block):
    """How many shots and drives are in the extract and in each of the towns, which are named by their seeds."""

    extract_shots: int = Field(ge=0)
    town_shots: int = Field(ge=0)
    extract_drives: int = Field(ge=0)
    town_drives: int = Field(ge=0)
    towns: tuple[int, ...]


class DistrictSettings(Block):
    """What ``facades_districts.json`` holds: ``seed`` of everything, and the blocks above.

    ``splits`` are apart: no pose of one is in another, and towns are others. What is tuned is tuned on ``tuning``.
    """

    seed: int = Field(ge=0)
    lidar: LidarSettings
    body: BodySettings
    world: WorldSettings
    maps: dict[str, MapErrors]
    odometry: OdometryErrors
    drives: DriveSettings
    shots: ShotSettings
    towns: TownShape
    splits: dict[str, Split]
