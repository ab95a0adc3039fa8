"""Ray casting by shapely's own intersections, one ray at a time: slow, and without a grid, orientation or winding."""

import numpy as np
import shapely

from factorloc.simulation import FloorPlan, Surface

FAR = 500.0


def _distances(geometry, origin, direction):
    """Sorted distances along the ray at which an intersection begins or ends."""
    coordinates = shapely.get_coordinates(geometry)
    return sorted(float((c - origin) @ direction) for c in coordinates)


def _inside(polygon, ray, origin, direction):
    """Stretches of a ray inside a polygon."""
    parts = shapely.get_parts(shapely.intersection(ray, polygon))
    stretches = [_distances(part, origin, direction) for part in parts]
    return [(s[0], s[-1]) for s in stretches if len(s) > 1]


def cast_one(plan: FloorPlan, origin, direction, draw):
    """Range and surface of one ray whose optical depth may reach ``draw``."""
    ray = shapely.LineString([origin, origin + FAR * direction])
    ends = [np.inf]
    for wall in plan.walls:
        solid = wall.boundary if wall.geom_type == "Polygon" else wall
        ends += _distances(shapely.intersection(ray, solid), origin, direction)
    wall_at = min(ends)
    events = [(wall_at, Surface.WALL, np.inf)] if wall_at < np.inf else []
    for pane in plan.panes:
        crossings = _distances(shapely.intersection(ray, pane.line), origin, direction)
        events += [(t, Surface.GLASS, -np.log(1 - pane.reflection)) for t in crossings]
    stretches = [
        (a, b, foliage.decay_rate)
        for foliage in plan.foliage
        for a, b in _inside(foliage.polygon, ray, origin, direction)
    ]
    events += [(t, Surface.NOTHING, 0.0) for a, b, _ in stretches for t in (a, b)]
    before = 0.0
    for t, surface, depth in sorted(events):
        rate = sum(r for a, b, r in stretches if a <= (before + t) / 2 <= b)
        if rate * (t - before) >= draw:
            return before + draw / rate, Surface.FOLIAGE
        draw -= rate * (t - before)
        if surface != Surface.NOTHING and depth >= draw:
            return t, surface
        draw, before = draw - depth, t
    return np.inf, Surface.NOTHING
