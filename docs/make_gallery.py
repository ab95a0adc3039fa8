"""Draw the pictures of the gallery: ``python docs/make_gallery.py`` for all, with their names for some.

The same pictures every time: worlds, drives and noise follow from the seeds below.
"""

from __future__ import annotations

import argparse
import logging
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
import trimesh
from PIL import Image

from factorloc.files import atomic_path
from factorloc.mapping import BuildingOutlines, Outline
from factorloc.simulation import (
    FloorPlan,
    FurnitureSettings,
    MeshWorld,
    PlanarLidar,
    Route,
    Sessions,
    SessionSettings,
    SpatialLidar,
    Town,
    TownSettings,
    extrude,
    hdl_32e,
    hdl_64e,
    office_plan,
    office_routes,
    os_128,
    simulate_drive,
    street_route,
    street_world,
    vlp_16,
)
from factorloc.viewer import plot_scan, save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FOLDER = Path(__file__).parent / "images" / "gallery"

_log = logging.getLogger("gallery")

_DPI = 130
_COLOURS = 256  # of the palette that keeps the files small
_STREET = (15.0, 95.0, -13.0, 13.0)  # m; what the pictures of the lidars show
_PLACE = 6  # number of the scan they show
_SICK_HEIGHT = 0.6  # m above the road

# Outlines about a square, m east and north, and the height of each building, m.
_SQUARE = (
    ("town hall", 18.0, [(-14, 22), (14, 22), (14, 36), (-14, 36)]),
    ("arcade", 11.0, [(-42, -18), (-26, -18), (-26, 8), (-18, 8), (-18, 36), (-42, 36)]),
    ("market", 6.0, [(-8, -5), (8, -5), (8, 5), (-8, 5)]),
    ("school", 12.0, [(24, -6), (42, -6), (42, 36), (20, 36), (20, 22), (24, 22)]),
    ("mill", 9.0, [(-26, -38), (6, -38), (6, -22), (-26, -22)]),
    ("bank", 14.0, [(14, -38), (42, -38), (42, -18), (22, -18), (14, -25)]),
)


def office() -> Figure:
    """Scans of a planar lidar on its way through the office."""
    route, _ = office_routes()
    drive = simulate_drive(office_plan(), route, PlanarLidar(beams=361), seed=1, period=1.0)
    return plot_scan(drive.scans, drive.truth.poses, limits=(-1, 31, -1, 21))


def street() -> Figure:
    """Scans of 128 beams along the street."""
    return _driven(street_world(seed=1), street_route(), limits=(0, 180, -25, 25), heights=(0, 14), elevation=0.75)


def town(number: int) -> Figure:
    """Scans of 128 beams along a street of a town: session 0 in July, session 1 in January."""
    settings = SessionSettings(first_month=6.5, months_between=6, moving_cars=0, pedestrians=0)
    avenues = TownSettings(columns=2, rows_of_blocks=1, furniture=FurnitureSettings(tree_share=1.0))
    sessions = Sessions(Town(avenues, seed=2), settings)
    y = avenues.block_depth + avenues.profile.lane_width / 2
    return _driven(
        sessions.session(number).world,
        Route(((95.0, y), (5.0, y)), speed=8.0, body_radius=1.0),
        views=("above", "oblique"),
        limits=(12, 88, 89, 111),
        heights=(0, 8),
        elevation=0.9,
    )


def barrels(number: int) -> Figure:
    """Scans of an HDL-64E past the row of barrels."""
    town = Town(TownSettings(columns=2, rows_of_blocks=1), seed=1)
    session = Sessions(town, SessionSettings(moving_cars=0, pedestrians=0)).session(number)
    y = -town.settings.profile.lane_width / 2
    return _driven(
        session.world,
        Route(((12.0, y), (88.0, y)), speed=8.0, body_radius=1.0),
        hdl_64e(columns=1024),
        limits=(14, 86, -11, 10),
        heights=(0, 3),
        elevation=0.8,
    )


def footprints() -> Figure:
    """Scans of 128 beams around a square that is extruded from outlines."""
    outlines = tuple(Outline(shapely.Polygon(corners), height, name) for name, height, corners in _SQUARE)
    world = extrude(BuildingOutlines(outlines)).world
    corners = ((-14.0, -14.0), (16.0, -14.0), (16.0, 14.0), (-13.0, 14.0), (-13.0, -12.0))
    route = Route(corners, radius=4.0, speed=5.0, body_radius=1.0)
    return _driven(world, route, limits=(-46, 46, -42, 40), heights=(0, 18))


def lidar(sensor: SpatialLidar) -> Figure:
    """One sweep in the street."""
    drive = simulate_drive(street_world(seed=1), street_route(), sensor, seed=1, period=1.0, keep_scans=False)
    scan, pose = drive.scans[_PLACE], drive.truth.poses[_PLACE]
    return plot_scan(scan, pose, limits=_STREET, heights=(0, 8), azimuth=-1.9, elevation=0.7, point_size=0.6)


def sick() -> Figure:
    """One scan of a planar lidar in the section of the street at the height of a bumper."""
    meshes = [solid.mesh for solid in street_world(seed=1).solids]
    cut_at: Any = trimesh.intersections.mesh_plane  # has no types
    cuts = [cut_at(mesh, (0, 0, 1), (0, 0, _SICK_HEIGHT))[..., :2] for mesh in meshes]
    walls = [shapely.LineString(segment) for segment in np.concatenate([cut for cut in cuts if len(cut)])]
    section = FloorPlan(tuple(wall for wall in walls if wall.length > 0))
    pose = street_route().sample(1.0).poses[_PLACE]
    sensor = PlanarLidar(beams=361, range_limits=(0.1, 80.0), T_body_sensor=(2.0, 0.0, 0.0))
    return plot_scan(sensor.cast(section, pose, np.random.default_rng(1)), pose, limits=_STREET, point_size=2.0)


def _driven(world: MeshWorld, route: Route, sensor: SpatialLidar | None = None, **view: Any) -> Figure:
    """All scans of a drive, at a slant."""
    sensor = os_128(columns=512) if sensor is None else sensor
    drive = simulate_drive(world, route, sensor, seed=1, period=1.0, keep_scans=False)
    return plot_scan(drive.scans, drive.truth.poses, **{"views": ("oblique",), **view})


PICTURES: dict[str, Callable[[], Figure]] = {
    "office": office,
    "street": street,
    "town-july": lambda: town(0),
    "town-january": lambda: town(1),
    "barrels-before": lambda: barrels(2),
    "barrels-after": lambda: barrels(3),
    "footprints": footprints,
    "hdl-64e": lambda: lidar(hdl_64e()),
    "hdl-32e": lambda: lidar(hdl_32e()),
    "vlp-16": lambda: lidar(vlp_16()),
    "os-128": lambda: lidar(os_128()),
    "sick": sick,
}


def main() -> None:
    """Draw the pictures that the command line names."""
    parser = argparse.ArgumentParser(description="Draw the pictures of the gallery.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"which: {', '.join(PICTURES)}; all if none is named")
    names = parser.parse_args().names or list(PICTURES)
    if unknown := sorted(set(names) - set(PICTURES)):
        parser.error(f"no picture is called {', '.join(unknown)}; known: {', '.join(PICTURES)}")
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    for name in names:
        path = FOLDER / f"{name}.png"
        with tempfile.TemporaryDirectory() as folder:
            drawn = Path(folder, path.name)
            save_figure(PICTURES[name](), drawn, _DPI)
            with Image.open(drawn) as picture, atomic_path(path) as small:
                flat = picture.convert("RGB").quantize(_COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
                flat.save(small, "PNG", optimize=True)
        _log.info("%s: %.0f kB", path, path.stat().st_size / 1000)


if __name__ == "__main__":
    main()
