"""MeshWorld: a spatial world of triangle meshes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from factorloc.errors import SimulationError
from factorloc.simulation.mesh_forest import MeshForest
from factorloc.simulation.ray_caster import RayCaster, ray_caster
from factorloc.simulation.solid import Canopy, Solid
from factorloc.simulation.world import Hits, Surface

__all__ = ["MeshWorld"]

Array = npt.NDArray[np.float64]

_DIRECTION_TOLERANCE = 1e-6


class MeshWorld:
    """Opaque solids, some of them moving, and semi-transparent canopies, whose decay rates add where they overlap.

    Solids at rest form one scene (see :class:`~factorloc.simulation.ray_caster.EmbreeCaster` for its accuracy); moving
    solids and canopies are met in double precision. A ray that starts inside a solid ends on its surface from within.

    Parameters
    ----------
    solids : sequence of Solid
        What rays end on.
    canopies : sequence of Canopy
        What rays may pass.

    Raises
    ------
    SimulationError
        If there is neither a solid nor a canopy.
    """

    dimension: ClassVar[int] = 3

    def __init__(self, solids: Sequence[Solid], canopies: Sequence[Canopy] = ()) -> None:
        self.solids, self.canopies = tuple(solids), tuple(canopies)
        if not (self.solids or self.canopies):
            raise SimulationError("mesh world: holds no solid and no canopy; add one")

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest corner of everything in it at time 0, m, shapes (3,)."""
        things: list[Solid | Canopy] = [*self.solids, *self.canopies]
        corners = np.array([thing.mesh.bounds for thing in things])
        return corners[:, 0].min(0), corners[:, 1].max(0)

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
        origins, directions : array_like, shape (..., 3)
            Start points (m) and unit vectors in the world; they broadcast.
        rng : numpy.random.Generator or None
            One unit exponential number is drawn a ray, whatever it meets; without it, rays pass all canopies.
        times : array_like, shape (...), optional
            When each ray is sent, s; moving solids are where they are then. 0 by default; broadcasts.

        Returns
        -------
        Hits
            Ranges and surfaces of the broadcast shape.

        Raises
        ------
        SimulationError
            If shapes do not fit, a value is not finite, or a direction is not of unit length.
        """
        start, direction = _vectors("origins", origins), _vectors("directions", directions)
        if np.abs(np.einsum("...i,...i->...", direction, direction) - 1).max(initial=0) > 2 * _DIRECTION_TOLERANCE:
            raise SimulationError("directions: not of unit length; normalize them")
        shape, time = _broadcast(times, start.shape[:-1], direction.shape[:-1])
        start, direction = (
            np.ascontiguousarray(np.broadcast_to(v, (*shape, 3)).reshape(-1, 3)) for v in (start, direction)
        )
        ranges, triangles = self._resting.first_hits(start, direction)
        surfaces = self._resting_surfaces[triangles]
        if self._moving_solids:
            moving = np.full(len(ranges), -1, np.int64)
            self._moving.shorten(start, direction, time, ranges, moving)
            surfaces = np.where(moving >= 0, self._moving_surfaces[moving], surfaces)
        if rng is not None:
            draws = rng.standard_exponential(len(ranges))
            if self.canopies:
                paths = self._foliage.free_paths(start, direction, draws, self._foliage_rates)
                surfaces[paths < ranges] = Surface.FOLIAGE
                ranges = np.minimum(ranges, paths)
        return Hits(ranges.reshape(shape), surfaces.reshape(shape))

    def clearance(self, points: npt.ArrayLike, times: npt.ArrayLike | None = None) -> Array:
        """Exact distance to the nearest solid other than ground; canopies can be driven through.

        Parameters
        ----------
        points : array_like, shape (..., 3)
            m.
        times : array_like, shape (...), optional
            s. With them, moving solids count, where they are then; without, only what is at rest. Broadcasts.

        Returns
        -------
        ndarray, shape (...)
            m; 0 inside of a closed mesh, infinite where there is nothing but ground.

        Raises
        ------
        SimulationError
            If shapes do not fit or a value is not finite.
        """
        place = _vectors("points", points)
        shape, time = _broadcast(times, place.shape[:-1])
        flat = np.ascontiguousarray(np.broadcast_to(place, (*shape, 3)).reshape(-1, 3))
        distances = self._obstacles.clearances(flat, time, np.array([False, True]))
        if times is not None and self._moving_solids:
            closed = np.array([solid.mesh.is_watertight for solid in self._moving_solids])
            distances = np.minimum(distances, self._moving.clearances(flat, time, closed))
        return distances.reshape(shape)

    def ground_height(self, points: npt.ArrayLike) -> Array:
        """Height of the topmost ground at given places.

        Parameters
        ----------
        points : array_like, shape (..., 2)
            x and y, m.

        Returns
        -------
        ndarray, shape (...)
            m; NaN where there is no ground.

        Raises
        ------
        SimulationError
            If the last axis is not 2 long, or a value is not finite.
        """
        place = np.asarray(points, np.float64)
        if place.ndim == 0 or place.shape[-1] != 2 or not np.isfinite(place).all():
            raise SimulationError(f"points: shape {place.shape}; expected finite places (..., 2)")
        top = self._ground.triangles[..., 2].max(initial=0.0) + 1.0
        start = np.concatenate([place, np.full((*place.shape[:-1], 1), top)], -1).reshape(-1, 3)
        down = np.ascontiguousarray(np.broadcast_to([0.0, 0.0, -1.0], start.shape))
        ranges, found = np.full(len(start), np.inf), np.full(len(start), -1, np.int64)
        self._ground.shorten(np.ascontiguousarray(start), down, np.zeros(len(start)), ranges, found)
        return np.where(found >= 0, top - ranges, np.nan).reshape(place.shape[:-1])

    @cached_property
    def _resting_solids(self) -> list[Solid]:
        return [solid for solid in self.solids if not solid.moves]

    @cached_property
    def _moving_solids(self) -> list[Solid]:
        return [solid for solid in self.solids if solid.moves]

    @cached_property
    def _resting(self) -> RayCaster:
        return ray_caster(_triangles(self._resting_solids))

    @cached_property
    def _resting_surfaces(self) -> npt.NDArray[np.uint8]:
        return _surfaces(self._resting_solids)

    @cached_property
    def _moving(self) -> MeshForest:
        groups = [_triangles([solid]) for solid in self._moving_solids]
        return MeshForest.build(groups, [solid.velocity for solid in self._moving_solids])

    @cached_property
    def _moving_surfaces(self) -> npt.NDArray[np.uint8]:
        return _surfaces(self._moving_solids)

    @cached_property
    def _foliage(self) -> MeshForest:
        return MeshForest.build([_triangles(self.canopies)])

    @cached_property
    def _foliage_rates(self) -> Array:
        return np.repeat([c.rate for c in self.canopies], [len(c.mesh.faces) for c in self.canopies])

    @cached_property
    def _obstacles(self) -> MeshForest:
        """What stands on the ground, at rest: open meshes, then closed ones."""
        standing = [solid for solid in self._resting_solids if solid.surface != Surface.GROUND]
        closed = [solid.mesh.is_watertight for solid in standing]
        groups = [[s for s, is_closed in zip(standing, closed, strict=True) if is_closed == g] for g in (False, True)]
        return MeshForest.build([_triangles(group) for group in groups])

    @cached_property
    def _ground(self) -> MeshForest:
        return MeshForest.build([_triangles(s for s in self._resting_solids if s.surface == Surface.GROUND)])


def _triangles(things: Iterable[Solid | Canopy]) -> Array:
    return np.concatenate([np.empty((0, 3, 3)), *(np.asarray(thing.mesh.triangles) for thing in things)])


def _surfaces(solids: Sequence[Solid]) -> npt.NDArray[np.uint8]:
    """Surface of each triangle, and of none, which is the last."""
    each = np.repeat([int(s.surface) for s in solids], [len(s.mesh.faces) for s in solids])
    return np.concatenate([each, [Surface.NOTHING]]).astype(np.uint8)


def _vectors(name: str, values: npt.ArrayLike) -> Array:
    array = np.asarray(values, np.float64)
    if array.ndim == 0 or array.shape[-1] != 3 or not np.isfinite(array).all():
        raise SimulationError(f"{name}: shape {array.shape}; expected finite vectors (..., 3) of space")
    return array


def _broadcast(times: npt.ArrayLike | None, *shapes: tuple[int, ...]) -> tuple[tuple[int, ...], Array]:
    """Fit times and shapes together; returns the common shape and one time for each of its entries."""
    time = np.asarray(0.0 if times is None else times, np.float64)
    if not np.isfinite(time).all():
        raise SimulationError("times: not finite")
    try:
        shape = np.broadcast_shapes(time.shape, *shapes)
    except ValueError as error:
        raise SimulationError(f"shapes {shapes} and times {time.shape} do not fit together") from error
    return shape, np.ascontiguousarray(np.broadcast_to(time, shape).ravel())
