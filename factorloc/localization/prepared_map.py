"""PreparedMap: ray statistics made ready for one measurement model, once for all scans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, field_validator

from factorloc.config import Block
from factorloc.errors import MapError
from factorloc.factors.distance_field import DistanceFieldTerm
from factorloc.factors.end_point_levels import EndPointLevels
from factorloc.factors.end_point_term import EndPointTerm, SpatialEndPointTerm, maximum_range_of
from factorloc.factors.grid_scan_term import DecayRateTerm, GridScanTerm, PosteriorTerm
from factorloc.factors.level_tables import LevelTables
from factorloc.factors.spatial_scan_term import SpatialScanTerm
from factorloc.geometry import position_heading
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.distance_table import DistanceTable
from factorloc.mapping.end_point import EndPointModel
from factorloc.mapping.grid import Grid
from factorloc.mapping.posterior_pyramid import PosteriorPyramid
from factorloc.mapping.pyramid import DEFAULT_BLURS, BlurPyramid
from factorloc.mapping.ray_statistics import RayStatistics
from factorloc.mapping.spatial_posterior_pyramid import SpatialPosteriorPyramid
from factorloc.mapping.spatial_pyramid import SPATIAL_BLURS, SpatialPyramid
from factorloc.rays import pack, spread
from factorloc.scan import Scan

__all__ = ["INFORMATION", "MeasurementSettings", "PreparedMap"]

Array = npt.NDArray[np.float64]

INFORMATION = {2: 0.2, 3: 0.5}
"""Weight of the log-likelihood of a scan, by dimension."""

_MAP_HEADING = {2: 0.003, 3: 0.001}  # rad


class MeasurementSettings(Block):
    """How scans are measured against a map.

    Parameters
    ----------
    model : {"decay-rate", "decay-rate-posterior", "end-point", "distance-field"}
        Measurement model: the most likely decay rates, their full posterior, the end-point model (of a standard
        deviation of half a cell), or the robust distance to the nearest reflecting cell. In space a distance field only
        begins a registration. The reflection model is refused: its likelihood jumps where rays change cells and says
        next to nothing in between, and so does its gradient.
    information : float, optional
        Weight of a scan's log-likelihood; by default 0.2 in the plane, where all rays count, and 0.5 in space, where
        some do. Rays are not independent: neighbours share a wall, its errors and the map's.
    blurs : tuple of float, optional
        Blurs of the map pyramid, m, coarse to fine; by default 1, 0.5, 0.25, 0.1, 0 in the plane and 1, 0.5, 0.25, 0
        in space.
    rays : int
        Most rays of a spatial scan, spread over its surroundings.
    map_position, map_heading : float, optional
        Standard deviations of what the map itself is wrong by at any one place, m and rad: its cells, and the poses it
        was built from. No number of rays averages that out, so it is added to every covariance reported. By default
        0.02 m; 0.003 rad in the plane, and in space 0.001 rad, which is 0.02 m seen from 20 m.
    """

    model: Literal["decay-rate", "decay-rate-posterior", "end-point", "distance-field"] = "decay-rate"
    information: float | None = Field(None, gt=0, le=1)
    blurs: tuple[float, ...] | None = None
    rays: int = Field(1000, gt=0)
    map_position: float = Field(0.02, ge=0)
    map_heading: float | None = Field(None, ge=0)

    @field_validator("model", mode="before")
    @classmethod
    def _has_gradient(cls, name: Any) -> Any:
        if isinstance(name, str) and name.startswith("reflection"):
            raise ValueError(
                f"'{name}' jumps where rays change cells and has no gradient to smooth by; use the particle filter "
                "(--method mcl)"
            )
        return name


@dataclass(frozen=True)
class PreparedMap:
    """A map with its levels.

    Parameters
    ----------
    settings : MeasurementSettings
        How it was made.
    statistics : RayStatistics or BrickStatistics
        What it was made of.
    levels : BlurPyramid, PosteriorPyramid, EndPointLevels, LevelTables or None
        Decay rates or their posteriors in the plane, all levels of either in space, or those of an end-point model;
        None where the term makes its own.
    """

    settings: MeasurementSettings
    statistics: RayStatistics | BrickStatistics
    levels: BlurPyramid | PosteriorPyramid | EndPointLevels | LevelTables | None

    @classmethod
    def of(
        cls, statistics: RayStatistics | BrickStatistics, settings: MeasurementSettings | None = None
    ) -> PreparedMap:
        """Blur the counts of a map.

        Raises
        ------
        MapError
            If the map holds nothing to localize in, or there is no such model for it.
        """
        settings = settings or MeasurementSettings()
        model, spatial = settings.model, statistics.grid.dimension == 3
        blurs = _or_default(settings.blurs, SPATIAL_BLURS if spatial else DEFAULT_BLURS)
        if model == "end-point":
            # A field between cells is right to a third of a cell; what is wider only costs precision.
            ends = EndPointModel.from_statistics(statistics, 0.5 * statistics.grid.resolution)
            return cls(settings, statistics, EndPointLevels.of(ends, blurs))
        if spatial:
            if model == "distance-field":
                raise MapError("model: 'distance-field' is for planar maps; use 'decay-rate', which begins with one")
            of_model = SpatialPyramid if model == "decay-rate" else SpatialPosteriorPyramid
            pyramid = of_model.from_statistics(statistics, blurs)
            return cls(settings, statistics, LevelTables.of(pyramid, [DistanceTable.from_statistics(statistics)]))
        if isinstance(statistics, BrickStatistics) or model == "distance-field":
            return cls(settings, statistics, None)
        if model == "decay-rate":
            return cls(settings, statistics, BlurPyramid.from_statistics(statistics, blurs))
        return cls(settings, statistics, PosteriorPyramid.from_statistics(statistics, blurs))

    @property
    def grid(self) -> Grid:
        """Cells of the map."""
        return self.statistics.grid

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return self.grid.dimension

    @property
    def information(self) -> float:
        """Weight of a scan's log-likelihood."""
        chosen = self.settings.information
        return INFORMATION[self.dimension] if chosen is None else chosen

    @property
    def quick_levels(self) -> list[int] | None:
        """Levels of a single registration: in space the distance field, then the finest two and the map."""
        if not isinstance(self.levels, LevelTables):
            return None
        count = len(self.levels.blurs)
        return [0, *range(max(count - 3, 1), count)]

    @property
    def floor(self) -> Array:
        """Covariance of the map's own error, in the tangent space of the body."""
        given = self.settings.map_heading
        heading = _MAP_HEADING[self.dimension] if given is None else given
        sigmas = position_heading(self.dimension, self.settings.map_position, heading)
        return np.diag(sigmas**2)

    def term(self, scans: Sequence[Scan]) -> GridScanTerm | SpatialScanTerm:
        """Measurement model of scans in this map.

        Raises
        ------
        MapError
            If scans and map differ in dimension.
        """
        rays = pack(scans)
        if rays.dimension != self.dimension:
            have, need = rays.dimension, self.dimension
            raise MapError(f"scans: of {have} dimensions, the map has {need}; use a map made for them")
        if isinstance(self.levels, LevelTables):
            return SpatialScanTerm(self.levels, spread(rays, self.settings.rays), self.information)
        if isinstance(self.levels, EndPointLevels):
            most = maximum_range_of(scans)
            if self.dimension == 3:
                return SpatialEndPointTerm(self.levels, spread(rays, self.settings.rays), self.information, most)
            return EndPointTerm(self.levels, rays, self.information, most)
        if isinstance(self.levels, PosteriorPyramid):
            return PosteriorTerm(self.levels, rays, self.information)
        if isinstance(self.levels, BlurPyramid):
            return DecayRateTerm(self.levels, rays, self.information)
        if isinstance(self.statistics, BrickStatistics):
            raise MapError("map: bricks are for spatial maps")
        return DistanceFieldTerm(
            self.statistics, rays, self.information, blurs=_or_default(self.settings.blurs, DEFAULT_BLURS)
        )


def _or_default(blurs: tuple[float, ...] | None, default: tuple[float, ...]) -> tuple[float, ...]:
    return default if blurs is None else blurs
