"""Outer walls: the edges of outlines as straight pieces, without the walls that buildings share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import shapely

__all__ = ["exposed_parts", "straight_walls"]

Array = npt.NDArray[np.float64]

_SLIVER = 1e-3  # m; what rounding leaves of a wall stands free of nothing


def straight_walls(polygon: shapely.Polygon, tolerance: float) -> tuple[Array, Array]:
    """Walls of an outline and its courtyards, with nodes on a straight wall left out.

    Parameters
    ----------
    polygon : shapely.Polygon
        Outline, m.
    tolerance : float
        How far a corner may be from the wall that replaces it, m.

    Returns
    -------
    walls : ndarray, shape (W, 2, 2)
        Start and end of each, m, the building on the left.
    deviations : ndarray, shape (W,)
        How far left-out corners are from each, m.
    """
    walls, deviations = [], []
    for ring in shapely.get_rings(shapely.orient_polygons(polygon)):
        corners = shapely.get_coordinates(ring)[:-1]
        corners = corners[(corners != np.roll(corners, 1, 0)).any(1)]
        kept = _kept_corners(corners, tolerance)
        for start, end in zip(kept, np.roll(kept, -1), strict=True):
            between = np.arange(start + 1, end + (len(corners) if end <= start else 0)) % len(corners)
            walls.append((corners[start], corners[end]))
            deviations.append(_heights(corners[between], corners[start], corners[end]).max(initial=0.0))
    return np.reshape(walls, (-1, 2, 2)), np.array(deviations, np.float64)


def _kept_corners(corners: Array, tolerance: float) -> npt.NDArray[np.int64]:
    """Leave out the flattest corner, as long as all that were left out between its neighbours stay near."""
    kept = list(range(len(corners)))
    barred: set[int] = set()
    while len(kept) > 3:
        before, after = np.roll(kept, 1), np.roll(kept, -1)
        heights = _heights(corners[kept], corners[before], corners[after])
        heights[[k in barred for k in kept]] = np.inf
        flattest = int(np.argmin(heights))
        if not heights[flattest] <= tolerance:
            break
        start, end = int(before[flattest]), int(after[flattest])
        between = np.arange(start + 1, end + (len(corners) if end <= start else 0)) % len(corners)
        if _heights(corners[between], corners[start], corners[end]).max() > tolerance:
            barred.add(kept[flattest])
        else:
            del kept[flattest]
    return np.array(kept, np.int64)


def _heights(points: Array, starts: Array, ends: Array) -> Array:
    """Distances of points from segments."""
    along = ends - starts
    length2 = np.maximum((along**2).sum(-1), 1e-300)
    share = np.clip(((points - starts) * along).sum(-1) / length2, 0.0, 1.0)
    off = points - starts - share[..., None] * along
    return np.asarray(np.hypot(off[..., 0], off[..., 1]))


def exposed_parts(walls: Array, polygons: Sequence[shapely.Polygon], gap: float) -> list[Array]:
    """Parts of walls before which no building stands.

    A neighbour may be drawn some way off the wall that both share, or overlap: what counts is whether it covers the
    line at a distance before the wall.

    Parameters
    ----------
    walls : ndarray, shape (W, 2, 2)
        Building on the left, m.
    polygons : sequence of shapely.Polygon
        All buildings, m.
    gap : float
        That distance, m.

    Returns
    -------
    list of ndarray, shape (P, 2)
        For each wall, where its exposed parts begin and end, as shares of its length.
    """
    along = walls[:, 1] - walls[:, 0]
    length = np.hypot(along[:, 0], along[:, 1])
    outward = np.column_stack([along[:, 1], -along[:, 0]]) / length[:, None]
    lines = shapely.linestrings(walls + gap * outward[:, None])
    whole = np.array([[0.0, 1.0]])
    parts = [whole] * len(walls)
    which, covering = shapely.STRtree(polygons).query(lines, predicate="intersects")
    covers: dict[int, list[shapely.Polygon]] = {}
    for row, number in zip(which.tolist(), covering.tolist(), strict=True):
        covers.setdefault(row, []).append(polygons[number])
    for row, over in covers.items():
        rest = lines[row].difference(shapely.union_all(over))
        pieces = [shapely.get_coordinates(piece) for piece in shapely.get_parts(rest) if piece.length > _SLIVER]
        start = walls[row, 0] + gap * outward[row]
        shares = [np.clip((piece[[0, -1]] - start) @ along[row] / length[row] ** 2, 0.0, 1.0) for piece in pieces]
        parts[row] = np.sort(np.reshape(shares, (-1, 2)), axis=0)
    return parts
