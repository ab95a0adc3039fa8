"""Facade: a planar wall with recessed windows and doors, balconies and ornaments."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np
import numpy.typing as npt
import shapely
from pydantic import Field, model_validator

from factorloc.config import Block
from factorloc.simulation.primitives import boxes, mesh_of, triangulated

if TYPE_CHECKING:
    import trimesh

__all__ = ["Facade", "FacadeSettings", "openings_of", "ornaments", "wall_triangles"]

Array = npt.NDArray[np.float64]

_EMBED = 0.02  # m; what is mounted on a wall reaches into it
_DOOR = (1.1, 2.2)  # width, height, m
_STRING_COURSE = (0.18, 0.08)  # height, depth, m
_BALCONY = (0.12, 1.0, 0.06)  # thickness of the slab, height and thickness of the parapet, m


class FacadeSettings(Block):
    """How walls that face a street are built; lengths in m.

    Parameters
    ----------
    storey_height : float
        Height of a storey.
    window_width, window_height, window_pitch, sill_height : float
        Size of windows, distance between their axes, and height of their lower edge above the floor.
    recess : float
        Depth of windows and doors behind the facade.
    margin : float
        Least distance between a window and an edge of the facade.
    balcony_share : float
        Share of window axes with balconies from the first floor on.
    balcony_depth, cornice_depth, plinth_depth : float
        How far they stand out; 0 leaves them away.
    plinth_height, cornice_height : float
        Heights of the two.
    """

    storey_height: float = Field(3.1, gt=2.4)
    window_width: float = Field(1.2, gt=0)
    window_height: float = Field(1.5, gt=0)
    window_pitch: float = Field(2.4, gt=0)
    sill_height: float = Field(0.85, gt=0)
    recess: float = Field(0.18, gt=0)
    margin: float = Field(0.6, gt=0)
    balcony_share: float = Field(0.15, ge=0, le=1)
    balcony_depth: float = Field(1.0, ge=0)
    cornice_depth: float = Field(0.3, ge=0)
    cornice_height: float = Field(0.35, gt=0)
    plinth_depth: float = Field(0.05, ge=0)
    plinth_height: float = Field(0.6, gt=0)

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.window_width >= self.window_pitch:
            raise ValueError("windows overlap: window_width must be below window_pitch")
        if self.sill_height + self.window_height >= self.storey_height:
            raise ValueError("windows reach the next storey: sill_height + window_height must be below storey_height")
        if self.recess > self.margin:
            raise ValueError("windows meet around the corner: recess must not exceed margin")
        return self


@dataclass(frozen=True)
class Facade:
    """The exact plane of a wall: all of its mesh but windows, doors and what is mounted on it lies there.

    Parameters
    ----------
    start, end : (float, float)
        Its lower corners, m; seen from outside, the start is on the left.
    bottom, top : float
        Heights of its edges, m.
    """

    start: tuple[float, float]
    end: tuple[float, float]
    bottom: float
    top: float

    @property
    def length(self) -> float:
        """Horizontal extent, m."""
        return float(np.hypot(self.end[0] - self.start[0], self.end[1] - self.start[1]))

    @property
    def normal(self) -> Array:
        """Unit vector that points outwards, shape (2,)."""
        along = (np.array(self.end) - self.start) / self.length
        return np.array([along[1], -along[0]])

    def world_points(self, points: npt.ArrayLike) -> Array:
        """Map (along from the start, height, outwards) (..., 3), m, into the world; both ends are met exactly."""
        u, z, out = np.moveaxis(np.asarray(points, np.float64), -1, 0)
        start, end = np.array(self.start), np.array(self.end)
        share = (u / self.length)[..., None]
        # Neighbouring walls share their corner to the last bit.
        flat = np.where(share == 1, end, start + share * (end - start)) + out[..., None] * self.normal
        return np.concatenate([flat, z[..., None]], -1)


def openings_of(facade: Facade, bottom: float, settings: FacadeSettings, rng: np.random.Generator) -> Array:
    """Windows and one door as (left, right, lower, upper), shape (N, 4), m; storeys from the ground, left to right."""
    room = facade.length - 2 * settings.margin - settings.window_width
    columns = int(room / settings.window_pitch + 1) if room >= 0 else 0
    # A storey counts when its windows end below the cornice.
    rise = facade.top - bottom - settings.sill_height - settings.window_height - settings.cornice_height
    storeys = int(rise / settings.storey_height + 1) if rise >= 0 else 0
    if columns == 0 or storeys == 0:
        return np.zeros((0, 4))
    axes = facade.length / 2 + settings.window_pitch * (np.arange(columns) - (columns - 1) / 2)
    sills = bottom + settings.sill_height + settings.storey_height * np.arange(storeys)
    u, z = np.tile(axes, storeys), np.repeat(sills, columns)
    half = settings.window_width / 2
    openings = np.column_stack([u - half, u + half, z, z + settings.window_height])
    door = int(rng.integers(columns))
    half = min(_DOOR[0], settings.window_pitch * 0.9, settings.window_width + settings.margin) / 2
    upper = min(bottom + _DOOR[1], facade.top - settings.cornice_height)
    openings[door] = axes[door] - half, axes[door] + half, bottom + 0.02, upper
    return openings


def wall_triangles(facade: Facade, openings: Array, recess: float) -> Array:
    """Triangles (T, 3, 3) of a wall whose openings are pockets."""
    length, low, high = facade.length, facade.bottom, facade.top
    frame = np.array([(0, low), (length, low), (length, high), (0, high)])
    if not len(openings):
        corners = facade.world_points(np.pad(frame, ((0, 0), (0, 1))))
        return np.stack([corners[:3], corners[[0, 2, 3]]])
    pockets = openings[:, [[0, 2], [0, 3], [1, 3], [1, 2]]]  # corners of each, clockwise as a hole is
    points, triangles, _ = triangulated(shapely.Polygon(frame, list(pockets)))
    front = facade.world_points(np.pad(pockets, ((0, 0), (0, 0), (0, 1))))
    back = facade.world_points(np.pad(pockets, ((0, 0), (0, 0), (0, 1)), constant_values=-recess))
    front_next, back_next = np.roll(front, -1, 1), np.roll(back, -1, 1)
    return np.concatenate(
        [
            facade.world_points(np.pad(points, ((0, 0), (0, 1))))[triangles],
            np.stack([front_next, front, back], 2).reshape(-1, 3, 3),
            np.stack([front_next, back, back_next], 2).reshape(-1, 3, 3),
            back[:, [[0, 2, 1], [0, 3, 2]]].reshape(-1, 3, 3),
        ]
    )


def ornaments(
    facade: Facade, openings: Array, bottom: float, settings: FacadeSettings, rng: np.random.Generator
) -> trimesh.Trimesh:
    """Cornice, string course, plinth, sills and balconies, as boxes on the wall."""
    length, top = facade.length, facade.top
    is_door = openings[:, 2] < bottom + settings.sill_height / 2
    rows: list[tuple[float, float, float, float, float]] = []  # left, right, lower, upper, depth
    if settings.cornice_depth:
        rows.append((0, length, top - settings.cornice_height, top, settings.cornice_depth))
    first_floor = bottom + settings.storey_height
    if first_floor + settings.storey_height < top:
        rows.append((0, length, first_floor - _STRING_COURSE[0], first_floor, _STRING_COURSE[1]))
    if settings.plinth_depth:
        ends = [0.0, *openings[is_door][:, :2].ravel().tolist(), length]
        plinth = min(settings.plinth_height, settings.sill_height)
        spans = zip(ends[::2], ends[1::2], strict=True)
        rows += [(left, right, facade.bottom, bottom + plinth, settings.plinth_depth) for left, right in spans]
    windows = openings[~is_door]
    rows += [(left - 0.05, right + 0.05, low - 0.06, low, 0.09) for left, right, low, _ in windows.tolist()]
    mounted = [((left, low, -_EMBED), (right, high, depth)) for left, right, low, high, depth in rows]
    upper = windows[windows[:, 2] > first_floor]
    chosen = upper[rng.random(len(upper)) < settings.balcony_share] if settings.balcony_depth else upper[:0]
    slab, parapet, thin = _BALCONY
    reach = min(0.4, settings.margin, 0.45 * (settings.window_pitch - settings.window_width))
    for left, right, low, _ in chosen.tolist():
        floor, a, b, depth = low - settings.sill_height, left - reach, right + reach, settings.balcony_depth
        mounted.append(((a, floor - slab, -_EMBED), (b, floor, depth)))
        mounted.append(((a, floor, depth - thin), (b, floor + parapet, depth)))
        mounted.append(((a, floor, -_EMBED), (a + thin, floor + parapet, depth - thin)))
        mounted.append(((b - thin, floor, -_EMBED), (b, floor + parapet, depth - thin)))
    shape = boxes(mounted)
    vertices = facade.world_points(np.asarray(shape.vertices))
    return mesh_of(vertices, np.asarray(shape.faces))
