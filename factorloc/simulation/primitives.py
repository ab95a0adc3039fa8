"""Primitives: the closed meshes a world is made of.

All are in metres, z up, with faces outwards. Their vertices are shared, so that each is watertight by itself;
:func:`joined` puts several into one mesh without welding them, which keeps it watertight.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import shapely

from factorloc.errors import SimulationError

if TYPE_CHECKING:
    import trimesh

__all__ = [
    "box",
    "boxes",
    "cone",
    "convex",
    "cylinder",
    "joined",
    "mesh_of",
    "placed",
    "prism",
    "sphere",
    "triangulated",
    "welded",
]

Array = npt.NDArray[np.float64]

_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float64)
_BOX_FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip


def box(size: npt.ArrayLike, base: npt.ArrayLike = (0.0, 0.0, 0.0), yaw: float = 0.0) -> trimesh.Trimesh:
    """Return a box of size (3,) that stands on the centre of its bottom (3,), turned by yaw about it."""
    size = _positive("size", size, 3)
    return placed(boxes(np.array([[[-0.5, -0.5, 0.0], [0.5, 0.5, 1.0]]]) * size), base, yaw)


def boxes(corners: npt.ArrayLike) -> trimesh.Trimesh:
    """Return axis-parallel boxes between lowest and highest corners, shape (N, 2, 3), in one mesh."""
    ends = np.asarray(corners, np.float64).reshape(-1, 2, 3)
    if not (ends[:, 1] > ends[:, 0]).all():
        raise SimulationError("boxes: a highest corner is not above its lowest; order them")
    vertices = ends[:, :1] + _CORNERS * (ends[:, 1:] - ends[:, :1])
    faces = _BOX_FACES + 8 * np.arange(len(ends))[:, None, None]
    return mesh_of(vertices.reshape(-1, 3), faces.reshape(-1, 3))


def cylinder(
    diameter: float, height: float, base: npt.ArrayLike = (0.0, 0.0, 0.0), sections: int = 16
) -> trimesh.Trimesh:
    """Return an upright cylinder on the centre of its bottom (3,); see :func:`cone` for what its diameter means."""
    return cone(diameter, diameter, height, base, sections)


def cone(
    diameter: float,
    top_diameter: float,
    height: float,
    base: npt.ArrayLike = (0.0, 0.0, 0.0),
    sections: int = 16,
) -> trimesh.Trimesh:
    """Return an upright cone or frustum on the centre of its bottom.

    Parameters
    ----------
    diameter, top_diameter : float
        Mean widths of its lowest and highest horizontal section, m: that of a convex outline, over all directions, is
        its perimeter divided by pi (Cauchy), so that the polygons are a little wider at corners and narrower between.
        A frustum has a positive top, a cone one of 0.
    height : float
        Height, m.
    base : array_like, shape (3,)
        Centre of its bottom, m.
    sections : int
        Sides of the polygon, at least 3.

    Raises
    ------
    SimulationError
        If a size is not positive.
    """
    _positive("diameter, height", (diameter, height), 2)
    if not 0 <= top_diameter < np.inf or sections < 3:
        raise SimulationError(f"cone: top diameter {top_diameter} m, {sections} sections; need 0 or more, 3 or more")
    phi = 2 * np.pi * (np.arange(sections) + 0.5) / sections
    ring = np.column_stack([np.cos(phi), np.sin(phi)]) * (np.pi / sections / np.sin(np.pi / sections) / 2)
    low = np.column_stack([ring * diameter, np.zeros(sections)])
    k, after = np.arange(sections), (np.arange(sections) + 1) % sections
    bottom, apex = np.full(sections, 2 * sections), np.full(sections, 2 * sections + 1)
    if top_diameter > 0:
        high = np.column_stack([ring * top_diameter, np.full(sections, height)])
        faces = [(k, after, after + sections), (k, after + sections, k + sections)]
        faces += [(after, k, bottom), (k + sections, after + sections, apex)]
    else:
        high, apex, bottom = np.zeros((0, 3)), apex - sections, bottom - sections
        faces = [(k, after, apex), (after, k, bottom)]
    vertices = np.concatenate([low, high, [[0, 0, 0], [0, 0, height]]])
    return placed(mesh_of(vertices, np.concatenate([np.column_stack(f) for f in faces])), base)


def sphere(size: npt.ArrayLike, centre: npt.ArrayLike = (0.0, 0.0, 0.0), subdivisions: int = 2) -> trimesh.Trimesh:
    """Return an ellipsoid of full axes (3,), m, about a centre (3,): an icosahedron subdivided."""
    vertices, faces = _unit_sphere(subdivisions)
    return mesh_of(vertices * _positive("size", size, 3) + np.asarray(centre, np.float64), faces)


def prism(polygon: shapely.Polygon, bottom: float, top: float) -> trimesh.Trimesh:
    """Extrude a polygon, which may have holes, between two heights.

    Raises
    ------
    SimulationError
        If the polygon is empty or not valid, or the top is not above the bottom.
    """
    if not top > bottom:
        raise SimulationError(f"prism: top {top} m is not above bottom {bottom} m")
    points, triangles, rings = triangulated(polygon)
    n = len(points)
    vertices = np.concatenate([np.column_stack([points, np.full(n, z)]) for z in (bottom, top)])
    sides = [_skirt(ring) for ring in rings]
    walls = np.concatenate([[(a, b, b + n), (a, b + n, a + n)] for side in sides for a, b in side])
    return mesh_of(vertices, np.concatenate([triangles[:, ::-1], triangles + n, walls]))


def convex(points: npt.ArrayLike) -> trimesh.Trimesh:
    """Return the convex hull of points (N, 3)."""
    import trimesh

    hull: trimesh.Trimesh = trimesh.convex.convex_hull(np.asarray(points, np.float64))
    return hull


def triangulated(
    polygon: shapely.Polygon,
) -> tuple[Array, npt.NDArray[np.int64], list[npt.NDArray[np.int64]]]:
    """Cut a polygon into triangles between its own corners.

    Returns
    -------
    points : ndarray, shape (P, 2)
        Its corners, each once.
    triangles : ndarray, shape (T, 3)
        Indices of corners, counter-clockwise.
    rings : list of ndarray
        Indices of the corners of the outline, counter-clockwise, and of each hole, clockwise.

    Raises
    ------
    SimulationError
        If the polygon is empty or not valid.
    """
    if not isinstance(polygon, shapely.Polygon) or polygon.is_empty or not polygon.is_valid:
        raise SimulationError(f"polygon: {shapely.is_valid_reason(polygon)}; expected one valid polygon with an area")
    polygon = shapely.orient_polygons(shapely.remove_repeated_points(polygon))
    loops = [shapely.get_coordinates(ring)[:-1] for ring in (polygon.exterior, *polygon.interiors)]
    corners = shapely.get_coordinates(shapely.constrained_delaunay_triangles(polygon)).reshape(-1, 4, 2)[:, :3]
    points, index = np.unique(np.concatenate([*loops, corners.reshape(-1, 2)]), axis=0, return_inverse=True)
    index = index.reshape(-1).astype(np.int64)
    *rings, flat = np.split(index, np.cumsum([len(loop) for loop in loops]))
    triangles = flat.reshape(-1, 3)
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    clockwise = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0] < 0
    triangles[clockwise] = triangles[clockwise][:, ::-1]
    return points, triangles, rings


def placed(mesh: trimesh.Trimesh, base: npt.ArrayLike, yaw: float = 0.0) -> trimesh.Trimesh:
    """Return a mesh turned by yaw about the vertical, rad, and moved by base (3,), m."""
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return mesh_of(np.asarray(mesh.vertices) @ turn.T + np.asarray(base, np.float64), np.asarray(mesh.faces))


def joined(parts: Iterable[trimesh.Trimesh]) -> trimesh.Trimesh:
    """Put meshes side by side into one; vertices are not welded."""
    parts = tuple(parts)
    if not parts:
        raise SimulationError("joined: no mesh; give at least one")
    offsets = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    faces = [np.asarray(part.faces) + offset for part, offset in zip(parts, offsets, strict=True)]
    return mesh_of(np.concatenate([np.asarray(part.vertices) for part in parts]), np.concatenate(faces))


def mesh_of(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> trimesh.Trimesh:
    """Make a mesh of exactly these vertices (V, 3), m, and triangles (T, 3): nothing is merged, sorted or dropped."""
    import trimesh

    return trimesh.Trimesh(np.asarray(vertices, np.float64), np.asarray(faces), process=False, validate=False)


def welded(triangles: npt.ArrayLike) -> trimesh.Trimesh:
    """Make a mesh of triangles (T, 3, 3) that share the corners they have in common to the last bit."""
    corners = np.asarray(triangles, np.float64).reshape(-1, 3)
    order = np.lexsort(corners.T)
    ordered = corners[order]
    first = np.concatenate([[True], (ordered[1:] != ordered[:-1]).any(axis=1)])
    index = np.empty(len(corners), np.int64)
    index[order] = np.cumsum(first) - 1
    return mesh_of(ordered[first], index.reshape(-1, 3))


@functools.cache
def _unit_sphere(subdivisions: int) -> tuple[Array, npt.NDArray[np.int64]]:
    import trimesh

    unit = trimesh.creation.icosphere(subdivisions=subdivisions, radius=0.5)
    return np.array(unit.vertices, np.float64), np.array(unit.faces, np.int64)


def _skirt(ring: npt.NDArray[np.int64]) -> list[tuple[int, int]]:
    return list(zip(ring.tolist(), np.roll(ring, -1).tolist(), strict=True))


def _positive(name: str, values: npt.ArrayLike, count: int) -> Array:
    array = np.asarray(values, np.float64)
    if array.shape != (count,) or not ((array > 0) & np.isfinite(array)).all():
        raise SimulationError(f"{name}: {array.tolist()}; expected {count} positive, finite numbers, m")
    return array
