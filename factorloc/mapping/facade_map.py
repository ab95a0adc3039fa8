"""FacadeMap: the outer walls of the buildings of a place, with the errors the map is declared to have."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
import shapely

from factorloc.errors import MapError
from factorloc.intervals import Box
from factorloc.mapping.building_outlines import BuildingOutlines
from factorloc.mapping.facade_bounds import FacadeBounds
from factorloc.mapping.facade_visibility import (
    Cores,
    SightLines,
    certain_cores,
    faces_region,
    hidden_from_region,
    outline_edges,
    shares_seen,
)
from factorloc.mapping.facades import Facades
from factorloc.mapping.local_frame import LocalFrame
from factorloc.mapping.outer_walls import exposed_parts, straight_walls

__all__ = ["FacadeMap", "MapUncertainty"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class MapUncertainty:
    """Greatest errors of a building map along x and along y; guarantees hold only as far as they do.

    Parameters
    ----------
    shift : float
        Of a building as a whole, m. OpenStreetMap: 1.5 to 2; a cadastral LOD2 model: 0.2.
    vertex : float
        Of each corner on top of that, m. OpenStreetMap: 0.2 to 0.3; a cadastral LOD2 model: 0.05.

    Raises
    ------
    MapError
        If one is negative or not finite.
    """

    shift: float = 2.0
    vertex: float = 0.3

    def __post_init__(self) -> None:
        for name in ("shift", "vertex"):
            if not 0 <= getattr(self, name) < math.inf:
                raise MapError(f"map uncertainty: {name} {getattr(self, name)} m; must not be negative, and finite")


@dataclass(frozen=True, eq=False)
class FacadeMap:
    """Facades, the buildings they belong to, and where all that is from.

    Parameters
    ----------
    facades : Facades
        Outer walls; ``facades.buildings`` counts into the outlines.
    outlines : tuple of shapely.Polygon
        Buildings, m, as mapped.
    heights : (B,) array_like
        Heights of the buildings, m; NaN where the map does not tell.
    uncertainty : MapUncertainty
        What was declared, without the transformation and without the corners left out on straight walls.
    frame : LocalFrame, optional
        Where it lies on earth.
    attribution : str
        Whom every picture and report has to name; empty if nobody.
    provenance : mapping of str to str
        Where it is from.
    left_out : mapping of str to int
        What was not used, by reason.

    Raises
    ------
    MapError
        If a facade belongs to no outline, or the heights are not one for each outline.
    """

    facades: Facades
    outlines: tuple[shapely.Polygon, ...]
    heights: Array
    uncertainty: MapUncertainty = field(default_factory=MapUncertainty)
    frame: LocalFrame | None = None
    attribution: str = ""
    provenance: Mapping[str, str] = field(default_factory=dict)
    left_out: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        heights = np.asarray(self.heights, np.float64)
        object.__setattr__(self, "heights", heights)
        if heights.shape != (len(self.outlines),):
            raise MapError(f"facade map: heights of shape {heights.shape} for {len(self.outlines)} outlines")
        numbers = self.facades.buildings
        if len(numbers) and not 0 <= numbers.min() <= numbers.max() < len(self.outlines):
            raise MapError("facade map: a facade belongs to a building that is not there")

    @classmethod
    def from_outlines(
        cls,
        buildings: BuildingOutlines,
        uncertainty: MapUncertainty | None = None,
        *,
        least_length: float = 1.0,
        tolerance: float = 0.05,
        gap: float = 0.4,
        progress: Callable[[int], None] | None = None,
    ) -> FacadeMap:
        """Take the outer walls of buildings, without those they share.

        Outlines inside others are left out first (see :meth:`BuildingOutlines.whole`). The stated accuracy of the
        transformation to the local frame is added to the shift of every building. Where corners on a straight wall are
        left out, their distance from it is added to its vertex error, so that every point of the true wall still lies
        on a line that is allowed; a short part of it may have another direction, which a tolerance of 0 rules out.

        A wall that stands free only in parts is cut: the ends of a part are points of the true wall, bounded like its
        corners, though what is seen of it may begin elsewhere if the neighbour is off.

        Parameters
        ----------
        buildings : BuildingOutlines
            What a reader found.
        uncertainty : MapUncertainty, optional
            Declared errors; those of OpenStreetMap by default.
        least_length : float
            Shorter walls, and parts of walls, are left out and counted, m.
        tolerance : float
            How far a corner may be from a straight wall that is put in its place, m; 0 keeps all corners.
        gap : float
            A neighbour closer than that before a wall shares it, m.
        progress : callable, optional
            Called with the number of buildings done.

        Raises
        ------
        MapError
            If there is no building, or a setting is out of its range.
        """
        for name, value in (("least_length", least_length), ("tolerance", tolerance), ("gap", gap)):
            if not 0 <= value < math.inf:
                raise MapError(f"facade map: {name} {value} m; must not be negative, and finite")
        uncertainty = uncertainty or MapUncertainty()
        if not len(buildings):
            raise MapError(f"{buildings.source or 'outlines'}: holds no building; cut out another place")
        whole = buildings.whole()
        polygons = tuple(outline.polygon for outline in whole.outlines)
        accuracy = whole.frame.accuracy if whole.frame is not None else 0.0
        found = []
        for number, polygon in enumerate(polygons):
            found.append(straight_walls(polygon, tolerance))
            if progress is not None:
                progress(number + 1)
        walls = np.concatenate([pieces for pieces, _ in found])
        deviations = np.concatenate([off for _, off in found])
        owners = np.repeat(np.arange(len(found)), [len(pieces) for pieces, _ in found])
        parts = exposed_parts(walls, polygons, gap)
        rows = np.repeat(np.arange(len(walls)), [len(part) for part in parts])
        shares = np.concatenate(parts)
        along = walls[rows, 1] - walls[rows, 0]
        length = np.hypot(along[:, 0], along[:, 1]) * (shares[:, 1] - shares[:, 0])
        kept = (length >= least_length) & (length > 0)
        segments = walls[rows, :1] + shares[:, :, None] * along[:, None]
        # What is whole keeps its corners to the last bit.
        segments[:, 1] = np.where(shares[:, 1:] == 1.0, walls[rows, 1], segments[:, 1])
        errors = uncertainty.vertex + deviations[rows]
        shifts = np.full(len(rows), uncertainty.shift + accuracy)
        facades = Facades(segments[kept], owners[rows][kept], shifts[kept], errors[kept])
        left_out = dict(whole.left_out)
        left_out["walls between buildings"] = sum(len(part) == 0 for part in parts)
        left_out[f"walls shorter than {least_length:g} m"] = int((~kept).sum())
        heights = np.array([math.nan if o.height is None else o.height for o in whole.outlines])
        provenance = {"source": whole.source} if whole.source else {}
        if whole.mended:
            provenance["mended"] = "; ".join(f"{deed} {n}" for deed, n in whole.mended.items())
        if whole.notes:
            provenance["notes"] = "; ".join(whole.notes)
        left_out = {reason: count for reason, count in left_out.items() if count}
        return cls(facades, polygons, heights, uncertainty, whole.frame, whole.attribution, provenance, left_out)

    def __len__(self) -> int:
        return len(self.facades)

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Lowest x, highest x, lowest y and highest y of all buildings, m."""
        x0, y0, x1, y1 = shapely.total_bounds(np.array(self.outlines, dtype=object))
        return float(x0), float(x1), float(y0), float(y1)

    def bounds(self, origin: npt.ArrayLike = (0.0, 0.0)) -> FacadeBounds:
        """Sound bounds of all facades about an origin (x, y), m; see :meth:`FacadeBounds.of`."""
        return FacadeBounds.of(self.facades, origin)

    def within(self, center: npt.ArrayLike, reach: float) -> npt.NDArray[np.int64]:
        """Facades that may be within reach of a point; see :meth:`Facades.within`."""
        return self.facades.within(center, reach)

    def seen_from(self, position: npt.ArrayLike) -> Array:
        """Share of each facade that is seen from a point (x, y), m, if the map is as drawn; (F,).

        Nothing follows from it for the truth: a guarantee needs :meth:`may_be_seen`.
        """
        return shares_seen(position, self.facades, self._edges)

    def may_be_seen(
        self, region: Box, reach: float = math.inf, sight: SightLines | None = None
    ) -> npt.NDArray[np.int64]:
        """Facades that may be seen from somewhere in a region, in ascending order.

        Only what is certain is left out, whatever errors the map has within the declared ones: walls out of reach,
        walls that turn their back to all of the region, and walls hidden wholly by what surely is inside of buildings.
        That takes the buildings of the map for granted: one that was pulled down hides nothing.

        Parameters
        ----------
        region : Box, sides (x, y)
            Where the sensor may be, m; a single bounded box.
        reach : float
            Range of the sensor, m.
        sight : SightLines, optional
            How high the sensor is and how steeply it looks up.

        Raises
        ------
        MapError
            If the region is empty or not bounded.
        """
        if region.bounds.shape != (2,) or not region.bounds.is_bounded.all():
            raise MapError("facade map: the region is no single bounded box (x, y); give one around the sensor")
        center = region.mid
        half = float(np.hypot(*(0.5 * region.width)))
        rows = np.arange(len(self)) if math.isinf(reach) else self.within(center, reach + half)
        facades = self.facades.select(rows)
        front = faces_region(FacadeBounds.of(facades, center), Box(region.bounds - center))
        rows, facades = rows[front], facades.select(front)
        reaches = (sight or SightLines()).blocked_up_to(self.heights[self._cores.owners])
        return np.asarray(rows[~hidden_from_region(facades, region, self._cores, reaches)], np.int64)

    def moved(self, origin: npt.ArrayLike) -> FacadeMap:
        """The same map with its origin at another point (x, y) of the present frame, m; its earthly frame is lost.

        Local frames touch the earth at their origin; convert outlines about the new origin to keep one.
        """
        start = np.asarray(origin, np.float64)
        if start.shape != (2,) or not np.isfinite(start).all():
            raise MapError(f"facade map: origin {start.tolist()}; give a point (x, y), m")
        f = self.facades
        facades = Facades(f.segments - start, f.buildings, f.shifts, f.vertex_errors)
        outlines = tuple(shapely.transform(np.array(self.outlines, dtype=object), lambda xy: xy - start))
        return replace(self, facades=facades, outlines=outlines, frame=None)

    @cached_property
    def _edges(self) -> Array:
        return outline_edges(self.outlines)

    @cached_property
    def _cores(self) -> Cores:
        errors = np.full(len(self.outlines), np.nan)
        np.fmax.at(errors, self.facades.buildings, self.facades.shifts + self.facades.vertex_errors)
        return certain_cores(self.outlines, errors)
