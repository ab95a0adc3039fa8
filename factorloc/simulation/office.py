"""A built-in world: the ground floor of an office building, and two drives through it.

The building measures 30 m x 20 m. Offices line the north side; a ring of corridors leads around the core with its
stairs and lifts to an atrium behind a glass front, where plants grow. Its origin is the south-west corner, x points
east, y north. What is furniture here is what a lidar at shin height sees of it.
"""

from __future__ import annotations

import numpy as np
import shapely
import shapely.affinity

from factorloc.simulation.floor_plan import FloorPlan, Foliage, Pane
from factorloc.simulation.route import Route

__all__ = ["office_plan", "office_routes"]

_SIZE = (30.0, 20.0)
_SHELL = 0.30  # thickness of the outer wall, m
_PARTITION = 0.12  # thickness of an inner wall, m

# Inner walls: corners of their centre lines, m.
_PARTITIONS = (
    # North offices.
    ((0.15, 13.6), (29.85, 13.6)),
    ((5.2, 13.6), (5.2, 19.85)),
    ((9.6, 13.6), (9.6, 19.85)),
    ((13.4, 13.6), (13.4, 19.85)),
    ((18.4, 13.6), (18.4, 19.85)),
    ((25.0, 13.6), (25.0, 19.85)),
    # West: workshop and library.
    ((0.15, 11.4), (7.0, 11.4), (7.0, 0.15)),
    ((0.15, 6.4), (7.0, 6.4)),
    # Core: stairs, lifts, washrooms, kitchen.
    ((9.0, 11.4), (21.0, 11.4), (21.0, 7.2), (9.0, 7.2), (9.0, 11.4)),
    ((12.2, 7.2), (12.2, 11.4)),
    ((14.4, 7.2), (14.4, 11.4)),
    ((12.2, 9.3), (14.4, 9.3)),
    ((17.2, 7.2), (17.2, 11.4)),
    ((15.8, 8.4), (15.8, 11.4)),
    # East: laboratory and meeting room.
    ((29.85, 11.4), (23.0, 11.4), (23.0, 0.15)),
    ((23.0, 5.4), (29.85, 5.4)),
)

# Doors: hinge, free end of the opening, and how far the leaf stands open (degrees counter-clockwise; None: no leaf).
_DOORS = (
    ((4.6, 13.6), (3.65, 13.6), -95),
    ((6.0, 13.6), (6.95, 13.6), 80),
    ((12.9, 13.6), (11.95, 13.6), -100),
    ((14.0, 13.6), (14.95, 13.6), 85),
    ((20.6, 13.6), (21.55, 13.6), 95),
    ((22.5, 13.6), (21.55, 13.6), -95),
    ((25.5, 13.6), (26.45, 13.6), 60),
    ((7.0, 10.6), (7.0, 9.55), -88),
    ((7.0, 2.4), (7.0, 3.45), 92),
    ((9.4, 11.4), (10.35, 11.4), -35),
    ((15.5, 11.4), (14.65, 11.4), 20),
    ((16.1, 11.4), (16.95, 11.4), -15),
    ((17.9, 7.2), (20.1, 7.2), None),
    ((23.0, 9.9), (23.0, 8.85), 90),
    ((23.0, 6.3), (23.0, 7.35), -80),
    ((23.0, 4.9), (23.0, 3.95), 97),
)

# Glass: both ends and the probability of reflection; the wall is opened for it.
_WINDOWS = (
    *(((x, 19.85), (x + w, 19.85), 0.25) for x, w in ((1.2, 3.0), (6.2, 2.4), (10.4, 2.2), (14.4, 3.0), (26.2, 2.6))),
    *(((x, 19.85), (x + 2.2, 19.85), 0.25) for x in (19.2, 22.2)),
    *(((0.15, y), (0.15, y + 1.8), 0.25) for y in (1.6, 4.0, 7.4, 15.6)),
    *(((29.85, y), (29.85, y + 2.0), 0.25) for y in (1.8, 6.6, 8.9, 15.8)),
    # The front of the atrium, between mullions.
    *(((x, 0.15), (x + 1.86, 0.15), 0.12) for x in np.arange(7.99, 21.0, 2.0)),
    # Library, meeting room and its front to the atrium, ends of the corridor.
    ((1.6, 0.15), (5.2, 0.15), 0.25),
    ((24.6, 0.15), (28.6, 0.15), 0.25),
    ((23.0, 0.7), (23.0, 3.5), 0.15),
    ((29.85, 12.0), (29.85, 13.0), 0.2),
    ((0.15, 12.0), (0.15, 13.0), 0.2),
)

# Glass that stands free: the vestibule.
_SCREENS = (
    ((13.95, 0.15), (13.95, 1.9), 0.15),
    ((16.03, 0.15), (16.03, 1.9), 0.15),
)

# Furniture: x, y of the centre, length, depth in m, turn in degrees.
_FURNITURE = (
    # North offices, from west to east: desk pedestals, cabinets, shelves.
    (1.6, 18.9, 1.6, 0.7, 0), (3.6, 18.9, 1.2, 0.7, 0), (0.55, 16.6, 0.45, 1.6, 0), (4.9, 16.8, 0.4, 2.4, 0),
    (1.1, 14.0, 1.4, 0.45, 0), (6.5, 18.6, 0.8, 1.6, 0), (8.3, 18.6, 0.8, 1.6, 0), (9.3, 15.4, 0.4, 2.0, 0),
    (8.3, 13.95, 1.4, 0.45, 0), (11.5, 18.3, 1.8, 0.8, 20), (9.9, 14.4, 0.4, 1.2, 0), (13.1, 16.4, 0.4, 1.6, 0),
    (14.4, 18.9, 1.6, 0.7, 0), (16.6, 18.9, 1.6, 0.7, 0), (18.1, 16.8, 0.4, 2.8, 0), (16.9, 14.0, 2.2, 0.4, 0),
    (13.75, 16.6, 0.45, 1.4, 0),
    # Seminar room: rows of tables, lectern.
    (20.0, 18.7, 1.8, 0.6, 0), (23.4, 18.7, 1.8, 0.6, 0), (18.8, 16.0, 0.5, 1.6, 0), (24.6, 15.0, 0.5, 1.4, 0),
    (24.2, 17.2, 0.7, 0.5, 30),
    # Corner office.
    (27.6, 17.6, 2.0, 0.9, -25), (29.4, 14.6, 0.45, 1.8, 0), (25.35, 17.6, 0.45, 2.2, 0),
    # Workshop: benches, machines.
    (0.75, 8.4, 0.8, 3.2, 0), (3.0, 6.85, 2.6, 0.7, 0), (3.2, 10.95, 2.0, 0.7, 0), (5.6, 6.95, 0.9, 0.8, 0),
    (3.3, 8.9, 1.5, 0.9, 0),
    # Library: shelves, reading table.
    (1.5, 5.2, 0.4, 2.0, 0), (2.9, 5.2, 0.4, 2.0, 0), (4.3, 5.2, 0.4, 2.0, 0), (6.0, 6.1, 1.6, 0.4, 0),
    (0.55, 2.4, 0.45, 2.4, 0), (3.4, 1.0, 1.8, 0.9, 0), (6.7, 1.2, 0.4, 1.4, 0),
    # Core: stair string, lift cars, basins, kitchen units and table.
    (10.6, 8.6, 0.2, 2.4, 0), (13.3, 8.2, 1.6, 1.5, 0), (13.3, 10.4, 1.6, 1.5, 0), (14.8, 8.6, 0.5, 1.6, 0),
    (16.8, 9.0, 0.5, 1.4, 0), (19.1, 11.05, 3.4, 0.6, 0), (20.65, 9.6, 0.6, 2.0, 0), (18.4, 9.0, 0.9, 0.9, 45),
    # Corridors: copier, lockers, a bench.
    (8.65, 8.4, 0.6, 1.1, 0), (21.35, 8.9, 0.5, 2.2, 0), (17.6, 13.32, 2.0, 0.42, 0), (8.2, 13.36, 0.9, 0.34, 0),
    (28.7, 11.72, 1.2, 0.5, 0), (1.6, 11.7, 1.8, 0.45, 0), (12.6, 11.66, 1.2, 0.38, 0),
    # Laboratory: benches, fume hood.
    (26.9, 8.0, 3.0, 1.0, 0), (26.8, 11.0, 3.2, 0.65, 0), (29.35, 8.6, 0.7, 2.4, 0), (25.6, 5.8, 2.2, 0.65, 0),
    (28.7, 6.0, 1.3, 0.9, 0),
    # Meeting room: table, sideboard.
    (26.6, 2.6, 2.6, 1.1, 0), (26.6, 5.12, 2.4, 0.4, 0),
    # Atrium: reception with its return, benches, display case.
    (15.9, 5.5, 2.6, 0.6, 0), (17.0, 6.1, 0.4, 0.9, 0), (8.5, 0.75, 0.5, 0.5, 0), (12.0, 6.8, 1.8, 0.5, 0),
    (21.9, 0.75, 1.4, 0.5, 0), (20.3, 3.2, 0.5, 1.5, 35),
)  # fmt: skip

# Columns: x, y of the centre, radius, m.
_COLUMNS = (
    (10.6, 1.6, 0.28),
    (10.6, 5.7, 0.28),
    (19.4, 1.6, 0.28),
    (19.4, 5.7, 0.28),
    (12.5, 3.3, 0.09),
    (17.4, 3.0, 0.07),
)

# Plants: x, y of the centre, half axes in m, decay rate in 1/m.
_PLANTS = (
    (12.5, 3.25, 1.1, 0.8, 0.9),
    (17.3, 3.1, 0.95, 0.8, 0.6),
    (11.6, 0.8, 1.3, 0.32, 2.2),
    (17.7, 0.8, 1.2, 0.32, 1.8),
    (9.1, 5.9, 0.45, 0.5, 3.0),
    (20.6, 6.3, 0.5, 0.45, 2.5),
    (22.4, 2.6, 0.4, 0.8, 1.4),
    (7.4, 6.6, 0.26, 0.5, 1.6),
    (0.75, 13.2, 0.3, 0.3, 2.4),
    (29.2, 13.1, 0.36, 0.36, 2.8),
    (19.0, 14.2, 0.4, 0.4, 1.2),
    (29.2, 19.2, 0.45, 0.45, 1.0),
    (23.5, 0.8, 0.35, 0.35, 2.0),
)

# Chairs: x, y, turn in degrees. At shin height they are legs and a swivel base, which most rays pass.
_CHAIRS = (
    (1.5, 18.2, 10), (3.6, 18.2, -15), (7.25, 18.5, 80), (7.5, 17.6, 30), (11.8, 17.5, 25), (14.3, 18.2, 5),
    (16.8, 18.15, -20), (19.6, 18.1, 0), (20.5, 18.15, 10), (23.0, 18.1, -5), (23.8, 18.1, 8), (27.2, 16.8, -30),
    (3.4, 1.8, 5), (1.8, 9.6, 40), (18.4, 8.1, 45), (19.3, 9.4, 20), (15.4, 6.15, 5), (26.0, 9.0, 15), (27.4, 7.1, -10),
    (25.7, 1.75, 0), (26.6, 1.7, 9), (27.5, 1.75, 18), (25.7, 3.45, 27), (26.6, 3.5, 36), (27.5, 3.4, 45),
)  # fmt: skip
_CHAIR_WIDTH, _CHAIR_RATE = 0.42, 1.5  # m, 1/m


def office_plan() -> FloorPlan:
    """Build the floor plan of the office.

    Returns
    -------
    FloorPlan
        30 m x 20 m, with glass that reflects 12 to 25 % of the rays and plants of decay rates from 0.6 to 3 per metre.
    """
    width, height = _SIZE
    outside = shapely.box(0, 0, width, height)
    shell = outside.difference(outside.buffer(-_SHELL, join_style="mitre"))
    inner = [shapely.LineString(corners).buffer(_PARTITION / 2, join_style="mitre") for corners in _PARTITIONS]
    glass = [(shapely.LineString((a, b)), reflection) for a, b, reflection in _WINDOWS]
    openings = [shapely.LineString((hinge, end)) for hinge, end, _ in _DOORS] + [line for line, _ in glass]
    building = shapely.union_all([shell, *inner]).difference(
        shapely.union_all([opening.buffer(_SHELL, cap_style="flat") for opening in openings])
    )
    leaves = [
        shapely.affinity.rotate(shapely.LineString((hinge, end)), angle, origin=hinge)
        for hinge, end, angle in _DOORS
        if angle is not None
    ]
    furniture = [_box(*row) for row in _FURNITURE]
    columns = [shapely.Point(x, y).buffer(radius, quad_segs=4) for x, y, radius in _COLUMNS]
    screens = [(shapely.LineString((a, b)), reflection) for a, b, reflection in _SCREENS]
    return FloorPlan(
        walls=(building, *leaves, *furniture, *columns),
        foliage=(
            *(Foliage(_plant(x, y, a, b), rate) for x, y, a, b, rate in _PLANTS),
            *(Foliage(_box(x, y, _CHAIR_WIDTH, _CHAIR_WIDTH, angle), _CHAIR_RATE) for x, y, angle in _CHAIRS),
        ),
        panes=tuple(Pane(line, reflection) for line, reflection in (*glass, *screens)),
    )


def office_routes() -> tuple[Route, Route]:
    """Two drives through the office: one to map it, another to be localized in that map.

    Returns
    -------
    mapping, localization : Route
        About 110 m and 80 m. The second sets out from the entrance and takes the corridors and rooms of the first in
        another order, most of them in the opposite direction.
    """
    mapping = Route(
        (
            (2.0, 2.9), (8.0, 2.9), (8.0, 10.08), (5.0, 10.08), (5.0, 8.3), (6.2, 8.3), (6.2, 10.08), (8.0, 10.08),
            (8.0, 12.9), (3.2, 13.0), (3.2, 12.0), (7.0, 12.5), (21.55, 12.5), (21.55, 15.2), (20.5, 16.4),
            (21.5, 17.6), (22.7, 16.4), (21.55, 15.0), (21.55, 12.4), (27.2, 12.0), (27.2, 13.0), (22.2, 12.6),
            (22.2, 9.38), (24.4, 9.38), (24.4, 6.85), (22.2, 6.85), (22.2, 4.4), (24.6, 4.4), (24.6, 1.75),
            (23.75, 1.75), (23.75, 4.4), (22.2, 4.4), (20.0, 4.7), (9.0, 4.7), (9.0, 2.5), (10.6, 2.4), (11.8, 1.8),
            (13.3, 1.7),
        ),
        radius=0.4,
    )  # fmt: skip
    localization = Route(
        (
            (15.0, 1.2), (15.0, 4.6), (20.0, 4.8), (22.0, 4.45), (23.9, 4.45), (23.9, 2.0), (24.75, 2.0), (24.75, 4.45),
            (22.1, 4.45), (22.1, 6.8), (24.2, 6.8), (24.2, 9.3), (22.1, 9.3), (21.9, 12.4), (21.5, 15.2), (22.5, 16.4),
            (21.6, 17.4), (20.6, 16.4), (21.6, 15.0), (21.5, 12.6), (8.05, 12.3), (8.05, 10.05), (5.2, 10.05),
            (5.2, 8.4), (6.3, 8.4), (6.3, 10.05), (7.95, 10.05), (7.95, 4.6), (14.5, 4.6),
        ),
        radius=0.4,
    )  # fmt: skip
    return mapping, localization


def _box(x: float, y: float, length: float, depth: float, degrees: float) -> shapely.Polygon:
    box = shapely.box(x - length / 2, y - depth / 2, x + length / 2, y + depth / 2)
    return shapely.affinity.rotate(box, degrees)


def _plant(x: float, y: float, a: float, b: float) -> shapely.Polygon:
    """Outline of a plant: an ellipse with lobes, turned by its place so that no two are alike."""
    phi = np.linspace(0, 2 * np.pi, 28, endpoint=False)
    r = 1 + 0.10 * np.sin(3 * phi + 5 * x) + 0.07 * np.sin(7 * phi + 3 * y)
    return shapely.Polygon(np.column_stack([x + a * r * np.cos(phi), y + b * r * np.sin(phi)]))
