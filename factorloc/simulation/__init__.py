"""Worlds, sensors and drives with exact truth.

A :class:`World` tells where rays end; a :class:`Lidar` turns that into scans as noisy as real ones;
:func:`simulate_drive` carries it along a :class:`Route`. :func:`office_plan` is a building to begin with:

>>> plan, (mapping, localization) = office_plan(), office_routes()
>>> drive = simulate_drive(plan, mapping, seed=1)
"""

from factorloc.simulation.carmen_export import write_carmen
from factorloc.simulation.drive import SimulatedDrive, simulate_drive
from factorloc.simulation.floor_plan import FloorPlan, Foliage, Pane
from factorloc.simulation.lidar import Lidar, PlanarLidar
from factorloc.simulation.odometry import OdometryNoise, integrate_odometry
from factorloc.simulation.office import office_plan, office_routes
from factorloc.simulation.route import Route
from factorloc.simulation.world import Hits, Surface, World

__all__ = [
    "FloorPlan",
    "Foliage",
    "Hits",
    "Lidar",
    "OdometryNoise",
    "Pane",
    "PlanarLidar",
    "Route",
    "SimulatedDrive",
    "Surface",
    "World",
    "integrate_odometry",
    "office_plan",
    "office_routes",
    "simulate_drive",
    "write_carmen",
]
