"""What stands in a district: the true buildings with balconies, parked cars and trees, and what the map has of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
from pydantic import Field

from benchmarks.district_streets import Streets
from factorloc.config import Block
from factorloc.mapping import BuildingOutlines
from factorloc.simulation import Scene
from factorloc.simulation.extrusion import extrude
from factorloc.simulation.facades import FacadeSettings
from factorloc.simulation.streams import stream
from factorloc.simulation.trees import Tree
from factorloc.simulation.vehicles import Vehicle

__all__ = ["Built", "WorldSettings", "build"]

_FINE = 0.05  # m; corners on straight walls, as their errors would fold them
_SHORTEST = 0.5  # m
_TREE_IDS = 10_000
_FROM_MIDDLE = (3.9, 6.5)  # m from the middle of the street to cars and to trees
_ROOM = 2.7  # m on either side of all middles that stay free of cars


class WorldSettings(Block):
    """How a district is furnished.

    Parameters
    ----------
    balcony_share, balcony_depth : float
        Share of window axes with balconies, and their depth, m.
    heights : (float, float)
        Of buildings whose height is unknown, m.
    missing_share, extra_share : float
        Shares of buildings that stand but are not mapped, and that are mapped but do not stand.
    car_share, tree_share : float
        Shares of places that are taken.
    car_pitch, tree_pitch : float
        Distance of places along either side of a street, m.
    """

    balcony_share: float = Field(ge=0, le=1)
    balcony_depth: float = Field(gt=0)
    heights: tuple[float, float]
    missing_share: float = Field(ge=0, lt=1)
    extra_share: float = Field(ge=0, lt=1)
    car_share: float = Field(ge=0, le=1)
    car_pitch: float = Field(gt=0)
    tree_share: float = Field(ge=0, le=1)
    tree_pitch: float = Field(gt=0)


@dataclass(frozen=True)
class Built:
    """A furnished district.

    Parameters
    ----------
    scene : Scene
        All that stands.
    mapped : BuildingOutlines
        True outlines of what the map has, before its errors.
    obstacles : shapely.Geometry
        Where no car drives, m.
    standing : ndarray of bool
        Which of the mapped buildings stand.
    """

    scene: Scene
    mapped: BuildingOutlines
    obstacles: shapely.Geometry
    standing: np.ndarray


def build(buildings: BuildingOutlines, streets: Streets, settings: WorldSettings, seed: int) -> Built:
    """Furnish a district.

    Parameters
    ----------
    buildings : BuildingOutlines
        All there are.
    streets : Streets
        Where cars drive.
    settings : WorldSettings
        What it is like.
    seed : int
        Chooses all.
    """
    whole = buildings.whole()
    lots = stream(seed, "missing and extra").random(len(whole))
    heights = stream(seed, "heights").uniform(*settings.heights, len(whole))
    outlines = []
    for outline, height in zip(whole.outlines, heights.tolist(), strict=True):
        outlines.append(replace(outline, polygon=_clean(outline.polygon), height=outline.height or height))
    is_extra = lots < settings.extra_share
    is_missing = (lots >= settings.extra_share) & (lots < settings.extra_share + settings.missing_share)
    stands = tuple(outline for outline, extra in zip(outlines, is_extra, strict=True) if not extra)
    mapped = tuple(outline for outline, missing in zip(outlines, is_missing, strict=True) if not missing)
    facade = FacadeSettings(balcony_share=settings.balcony_share, balcony_depth=settings.balcony_depth)
    scene = extrude(replace(buildings, outlines=stands), facade=facade, seed=seed)
    walls = shapely.union_all([outline.polygon for outline in stands])
    lanes = shapely.union_all(list(streets.lines)).buffer(_ROOM)
    cars = _cars(streets, walls.union(lanes), settings, seed)
    parked = shapely.union_all([car.footprint for car in cars])
    trees = _trees(streets, shapely.union_all([walls.buffer(1.0), lanes, parked.buffer(0.3)]), settings, seed)
    trunks = shapely.union_all([tree.footprint for tree in trees])
    scene = replace(scene, vehicles=cars, trees=trees)
    obstacles = shapely.union_all([walls, parked, trunks])
    return Built(scene, replace(whole, outlines=mapped), obstacles, ~is_extra[~is_missing])


def _clean(polygon: shapely.Polygon) -> shapely.Polygon:
    """The same outline without edges so short that errors of corners would fold them."""
    rings = []
    for ring in shapely.get_rings(polygon.simplify(_FINE)):
        corners = shapely.get_coordinates(ring)[:-1]
        kept = [corners[0]]
        for corner in corners[1:]:
            if np.hypot(*(corner - kept[-1])) >= _SHORTEST and np.hypot(*(corner - kept[0])) >= _SHORTEST:
                kept.append(corner)
        rings.append(kept)
    clean = shapely.Polygon(rings[0], [hole for hole in rings[1:] if len(hole) > 2]) if len(rings[0]) > 2 else polygon
    return clean if clean.is_valid and clean.area > 0.9 * polygon.area else polygon


def _cars(streets: Streets, taken: shapely.Geometry, settings: WorldSettings, seed: int) -> tuple[Vehicle, ...]:
    shapely.prepare(taken)
    rng = stream(seed, "cars")
    cars: list[Vehicle] = []
    for x, y, yaw in _sides(streets, settings.car_pitch, _FROM_MIDDLE[0]):
        car = Vehicle.drawn((x, y), 0.0, yaw, rng)
        if rng.random() < settings.car_share and not taken.intersects(car.footprint):
            cars.append(car)
    tree = shapely.STRtree([car.footprint for car in cars])
    pairs = tree.query(np.array([car.footprint for car in cars], dtype=object), predicate="intersects").T
    crossing = {max(a, b) for a, b in pairs.tolist() if a != b}
    return tuple(car for n, car in enumerate(cars) if n not in crossing)


def _trees(streets: Streets, taken: shapely.Geometry, settings: WorldSettings, seed: int) -> tuple[Tree, ...]:
    shapely.prepare(taken)
    rng = stream(seed, "trees")
    trees = []
    for n, (x, y, _) in enumerate(_sides(streets, settings.tree_pitch, _FROM_MIDDLE[1])):
        tree = Tree.drawn(_TREE_IDS + n, (x, y), 0.0, rng)
        if rng.random() < settings.tree_share and not taken.intersects(tree.footprint):
            trees.append(tree)
    return tuple(trees)


def _sides(streets: Streets, pitch: float, off: float) -> list[tuple[float, float, float]]:
    """Places on both sides of all streets, facing as the traffic on the right does."""
    return [
        (x + off * np.sin(heading), y - off * np.cos(heading), heading)
        for x, y, yaw in streets.spots(pitch).tolist()
        for heading in (yaw, yaw + np.pi)
    ]
