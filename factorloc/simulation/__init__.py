"""Worlds, sensors and drives with exact truth, in the plane and in space.

A :class:`World` tells where rays end; a :class:`Lidar` turns that into scans as noisy as real ones;
:func:`simulate_drive` carries it along a :class:`Route`. :func:`office_plan` is a building to begin with:

>>> plan, (mapping, localization) = office_plan(), office_routes()
>>> drive = simulate_drive(plan, mapping, seed=1)

In space, a :class:`MeshWorld` holds opaque :class:`Solid` and semi-transparent :class:`Canopy` meshes, and a
:class:`SpatialLidar` turns while it is driven over the ground:

>>> street = MeshWorld(solids, canopies)
>>> drive = simulate_drive(street, Route(waypoints, radius=6, speed=8), hdl_64e(), seed=1, period=0.1, gnss=Gnss())
>>> write_kitti("town", drive)
"""

from factorloc.simulation.carmen_export import write_carmen
from factorloc.simulation.drive import SimulatedDrive, simulate_drive
from factorloc.simulation.extrusion import extrude
from factorloc.simulation.floor_plan import FloorPlan, Foliage, Pane
from factorloc.simulation.furnishing import FurnitureSettings
from factorloc.simulation.gnss import Gnss, GnssFixes
from factorloc.simulation.kitti_export import write_kitti
from factorloc.simulation.lidar import Lidar, PlanarLidar
from factorloc.simulation.lidar_models import hdl_32e, hdl_64e, os_128, vlp_16
from factorloc.simulation.mesh_world import MeshWorld
from factorloc.simulation.nclt_export import write_nclt
from factorloc.simulation.odometry import OdometryNoise, integrate_odometry
from factorloc.simulation.office import office_plan, office_routes
from factorloc.simulation.poles import Pole, PoleKind
from factorloc.simulation.route import Route
from factorloc.simulation.scene import Scene
from factorloc.simulation.session_cache import cache_key, cached
from factorloc.simulation.sessions import Session, Sessions, SessionSettings
from factorloc.simulation.solid import Canopy, Solid
from factorloc.simulation.spatial_lidar import SpatialLidar
from factorloc.simulation.spatial_odometry import SpatialOdometryNoise
from factorloc.simulation.spatial_route import SpatialRoute
from factorloc.simulation.street import StreetSettings, street_route, street_scene, street_world
from factorloc.simulation.sweeps import Sweeps
from factorloc.simulation.town import Town, TownSettings
from factorloc.simulation.world import Hits, Surface, World

__all__ = [
    "Canopy",
    "FloorPlan",
    "Foliage",
    "FurnitureSettings",
    "Gnss",
    "GnssFixes",
    "Hits",
    "Lidar",
    "MeshWorld",
    "OdometryNoise",
    "Pane",
    "PlanarLidar",
    "Pole",
    "PoleKind",
    "Route",
    "Scene",
    "Session",
    "SessionSettings",
    "Sessions",
    "SimulatedDrive",
    "Solid",
    "SpatialLidar",
    "SpatialOdometryNoise",
    "SpatialRoute",
    "StreetSettings",
    "Surface",
    "Sweeps",
    "Town",
    "TownSettings",
    "World",
    "cache_key",
    "cached",
    "extrude",
    "hdl_32e",
    "hdl_64e",
    "integrate_odometry",
    "office_plan",
    "office_routes",
    "os_128",
    "simulate_drive",
    "street_route",
    "street_scene",
    "street_world",
    "vlp_16",
    "write_carmen",
    "write_kitti",
    "write_nclt",
]
