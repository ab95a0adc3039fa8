"""FloorPlan: a planar world of walls, glass panes and semi-transparent regions."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
import numpy.typing as npt
import shapely

from factorloc.errors import SimulationError
from factorloc.simulation.segment_grid import SegmentGrid
from factorloc.simulation.world import Hits

__all__ = ["FloorPlan", "Foliage", "Pane"]

Array = npt.NDArray[np.float64]

_SHORTEST = 1e-9  # edges below this length (m) come from rounding in geometry operations


@dataclass(frozen=True)
class Foliage:
    """A region in which the free path of a ray is exponentially distributed (thesis, eq. 3.1).

    Parameters
    ----------
    polygon : shapely.Polygon
        Its outline, m. Where regions overlap, their decay rates add up.
    decay_rate : float
        Inverse of the mean free path, 1/m.

    Raises
    ------
    SimulationError
        If the polygon is empty or not valid, or the rate is not positive and finite.
    """

    polygon: shapely.Polygon
    decay_rate: float

    def __post_init__(self) -> None:
        _check("foliage", self.polygon, "Polygon")
        if not 0 < self.decay_rate < np.inf:
            raise SimulationError(f"decay_rate: {self.decay_rate} 1/m; must be positive and finite")


@dataclass(frozen=True)
class Pane:
    """Thin glass: a ray that meets it is reflected with some probability and passes straight on otherwise.

    Parameters
    ----------
    line : shapely.LineString
        Where it stands, m.
    reflection : float
        Probability of being reflected, at least 0 and below 1.

    Raises
    ------
    SimulationError
        If the line is empty or not valid, or the probability is out of range.
    """

    line: shapely.LineString
    reflection: float

    def __post_init__(self) -> None:
        _check("pane", self.line, "LineString")
        if not 0 <= self.reflection < 1:
            raise SimulationError(f"reflection: {self.reflection}; must be in [0, 1), a wall reflects always")


@dataclass(frozen=True)
class FloorPlan:
    """A building seen from above: the planar :class:`~factorloc.simulation.world.World`.

    Parameters
    ----------
    walls : tuple of shapely geometries
        What is opaque, in the world frame, m: polygons are solid, lines are thin walls. Multi-part geometries and
        collections are taken apart.
    foliage : tuple of Foliage
        Semi-transparent regions.
    panes : tuple of Pane
        Glass.

    Raises
    ------
    SimulationError
        If a geometry is empty, not valid, or neither polygon nor line, or there is nothing at all.
    """

    dimension: ClassVar[int] = 2

    walls: tuple[shapely.Geometry, ...]
    foliage: tuple[Foliage, ...] = ()
    panes: tuple[Pane, ...] = ()

    def __post_init__(self) -> None:
        walls = tuple(part for geometry in self.walls for part in _parts(geometry))
        for part in walls:
            _check("wall", part, "Polygon", "LineString", "LinearRing")
        object.__setattr__(self, "walls", walls)
        if not (self.walls or self.foliage or self.panes):
            raise SimulationError("floor plan: holds no wall, foliage or pane")

    @cached_property
    def bounds(self) -> tuple[float, float, float, float]:
        """Lowest x, lowest y, highest x and highest y of everything in it, m."""
        x_min, y_min, x_max, y_max = shapely.total_bounds(self._solids)
        return float(x_min), float(y_min), float(x_max), float(y_max)

    @cached_property
    def wall_segments(self) -> Array:
        """Opaque line segments, shape (S, 2, 2): both ends, in m."""
        return _edges(self.walls).reshape(-1, 2, 2)

    @cached_property
    def pane_segments(self) -> Array:
        """Segments of the panes, shape (S, 2, 2): both ends, in m."""
        return _edges(pane.line for pane in self.panes).reshape(-1, 2, 2)

    def cast(
        self,
        origins: npt.ArrayLike,
        directions: npt.ArrayLike,
        rng: np.random.Generator | None,
        times: npt.ArrayLike | None = None,
    ) -> Hits:
        """Sample where rays are reflected.

        Parameters
        ----------
        origins : array_like, shape (..., 2)
            Start points in the world, m. They broadcast against the directions: one origin for a whole scan is
            cheaper than its copies.
        directions : array_like, shape (..., 2)
            Unit vectors in the world.
        rng : numpy.random.Generator or None
            One unit exponential number is drawn a ray; without it, rays pass all glass and foliage.
        times : array_like, optional
            Not used: a plan stands still.

        Returns
        -------
        Hits
            Ranges and surfaces of the broadcast shape.

        Raises
        ------
        SimulationError
            If the last axis is not 2 long, or a value is not finite.
        """
        return self._cast(origins, directions, rng)

    def opaque_ranges(self, origins: npt.ArrayLike, directions: npt.ArrayLike) -> Array:
        """Return the exact distances to the first wall behind all glass and foliage, m; infinite if there is none.

        Parameters
        ----------
        origins, directions : array_like, shape (..., 2)
            As of :meth:`cast`.

        Raises
        ------
        SimulationError
            If the last axis is not 2 long, or a value is not finite.
        """
        return self._cast(origins, directions, None).ranges

    def decay_rate_at(self, points: npt.ArrayLike) -> Array:
        """Return the decay rate of the foliage at points (..., 2), 1/m; 0 in the open."""
        xy = _vectors("points", points)
        return self._grid.rates_at(np.ascontiguousarray(xy.reshape(-1, 2))).reshape(xy.shape[:-1])

    def clearance(self, points: npt.ArrayLike) -> Array:
        """Return the distance from points (..., 2) to the nearest wall, pane or foliage, m; 0 inside."""
        return np.asarray(shapely.distance(shapely.points(_vectors("points", points)), self._solid))

    def _cast(self, origins: npt.ArrayLike, directions: npt.ArrayLike, rng: np.random.Generator | None) -> Hits:
        start, direction = _vectors("origins", origins), _vectors("directions", directions)
        try:
            shape = np.broadcast_shapes(start.shape, direction.shape)
        except ValueError as error:
            raise SimulationError(f"directions: shape {direction.shape} does not fit origins {start.shape}") from error
        count = int(np.prod(shape[:-1]))
        draws = np.full(count, np.inf) if rng is None else rng.standard_exponential(count)
        rates = np.broadcast_to(self.decay_rate_at(start), shape[:-1])
        start, direction = (np.ascontiguousarray(np.broadcast_to(v, shape).reshape(-1, 2)) for v in (start, direction))
        ranges, surfaces = self._grid.cast(start, direction, rates.ravel(), draws)
        return Hits(ranges.reshape(shape[:-1]), surfaces.reshape(shape[:-1]))

    @property
    def _solids(self) -> list[shapely.Geometry]:
        return [*self.walls, *(f.polygon for f in self.foliage), *(p.line for p in self.panes)]

    @cached_property
    def _solid(self) -> shapely.Geometry:
        return shapely.GeometryCollection(self._solids)

    @cached_property
    def _grid(self) -> SegmentGrid:
        opaque = self.wall_segments.reshape(-1, 4)
        rows = [(opaque, np.inf, 0.0)]
        rows += [(_edges([pane.line]), -np.log1p(-pane.reflection), 0.0) for pane in self.panes]
        rows += [(_edges([shapely.orient_polygons(f.polygon)]), 0.0, f.decay_rate) for f in self.foliage]
        counts = [len(segments) for segments, _, _ in rows]
        depths, rates = np.repeat([row[1] for row in rows], counts), np.repeat([row[2] for row in rows], counts)
        return SegmentGrid.build(np.concatenate([segments for segments, _, _ in rows]), depths, rates)


def _check(name: str, geometry: shapely.Geometry, *kinds: str) -> None:
    if geometry.geom_type not in kinds or geometry.is_empty:
        raise SimulationError(
            f"{name}: {geometry.geom_type} (empty: {geometry.is_empty}); expected {' or '.join(kinds)}"
        )
    if not geometry.is_valid:
        raise SimulationError(f"{name}: {shapely.is_valid_reason(geometry)}; mend it with shapely.make_valid")


def _parts(geometry: shapely.Geometry) -> Iterable[shapely.Geometry]:
    if isinstance(geometry, shapely.geometry.base.BaseMultipartGeometry):
        return [single for part in geometry.geoms for single in _parts(part)]
    return [geometry]


def _edges(geometries: Iterable[shapely.Geometry]) -> Array:
    """Edges [x_a, y_a, x_b, y_b] of lines and polygon rings, shape (S, 4); regions keep to the left of theirs."""
    rings: list[shapely.Geometry] = []
    for geometry in geometries:
        rings += [geometry.exterior, *geometry.interiors] if geometry.geom_type == "Polygon" else [geometry]
    chains = [shapely.get_coordinates(ring) for ring in rings]
    edges = np.concatenate([np.empty((0, 4)), *(np.hstack([chain[:-1], chain[1:]]) for chain in chains)])
    return np.ascontiguousarray(edges[np.hypot(edges[:, 2] - edges[:, 0], edges[:, 3] - edges[:, 1]) > _SHORTEST])


def _vectors(name: str, values: npt.ArrayLike) -> Array:
    array = np.asarray(values, np.float64)
    if array.ndim == 0 or array.shape[-1] != 2 or not np.isfinite(array).all():
        raise SimulationError(f"{name}: shape {array.shape}; expected finite vectors (..., 2) of the plane")
    return array
