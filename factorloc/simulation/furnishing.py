"""Furnishing: houses, trees, poles and places to park along the frontages of a street grid.

What is drawn for one noun on one frontage comes from a random stream of its own. Identities tell noun, frontage and
place: ``base + 1000 * frontage + place``, so that they outlive a change of anything else.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely
from pydantic import Field

from factorloc.config import Block
from factorloc.simulation.buildings import Building, building
from factorloc.simulation.frontage import Frontage, RowSettings
from factorloc.simulation.ground import Ground
from factorloc.simulation.poles import Pole, PoleKind
from factorloc.simulation.streams import stream
from factorloc.simulation.street_grid import StreetGrid
from factorloc.simulation.trees import Hedge, Tree
from factorloc.simulation.vehicles import Vehicle

__all__ = [
    "BARREL_IDS",
    "CORNER",
    "FurnitureSettings",
    "ParkingPlace",
    "PoleSite",
    "houses",
    "parking_places",
    "pole_sites",
    "spare_sites",
    "trees",
]

Array = npt.NDArray[np.float64]

TREE_IDS, POLE_IDS, SPARE_IDS, BARREL_IDS = 10_000_000, 20_000_000, 30_000_000, 40_000_000
CORNER = 9.0
"""From the end of a frontage to the first regular place, m."""
_POLE_LINE, _TREE_LINE = 0.5, 1.0  # m behind the kerb
_PLACE = 6.2  # m of kerb for a parked car
_KINDS = (PoleKind.POST, PoleKind.SIGN, PoleKind.LAMP, PoleKind.COLUMN)
_KIND_SHARES = (0.2, 0.3, 0.35, 0.15)


class FurnitureSettings(Block):
    """What stands on the pavements and along the kerbs.

    Parameters
    ----------
    pole_spacing : float
        Mean distance of poles along a frontage, m; trees have places half-way between.
    tree_share, hedge_share, traffic_light_share : float
        Shares of tree places, gaps between houses, and corners that have one.
    bollards : int
        Bollards at each corner.
    parked_share : float
        Share of places where a car is parked.
    """

    pole_spacing: float = Field(18.0, ge=10)
    tree_share: float = Field(0.6, ge=0, le=1)
    hedge_share: float = Field(0.7, ge=0, le=1)
    traffic_light_share: float = Field(0.5, ge=0, le=1)
    bollards: int = Field(3, ge=0, le=3)
    parked_share: float = Field(0.65, ge=0, le=1)


@dataclass(frozen=True)
class PoleSite:
    """A place for a pole: identity, kind, position and bottom in m, direction of its arm or plate in rad."""

    id: int
    kind: PoleKind
    position: tuple[float, float]
    bottom: float
    yaw: float

    def pole(self, rng: np.random.Generator, id: int | None = None) -> Pole:
        """Set up a pole of random size there."""
        return Pole.drawn(self.id if id is None else id, self.kind, self.position, self.bottom, self.yaw, rng)


@dataclass(frozen=True)
class ParkingPlace:
    """A place for one car: its middle in m and the direction cars head, rad."""

    position: tuple[float, float]
    yaw: float

    def car(self, ground: Ground, rng: np.random.Generator) -> Vehicle:
        """Park a random car there, as straight as people do."""
        along, across, turn = rng.uniform(-1, 1, 3) * (0.3, 0.03, 0.01)
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        x, y = self.position
        x, y = float(x + along * c - across * s), float(y + along * s + across * c)
        return Vehicle.drawn((x, y), float(ground.elevation((x, y))), float(self.yaw + turn), rng)


def houses(
    grid: StreetGrid, settings: RowSettings, hedge_share: float, seed: int
) -> tuple[tuple[Building, ...], tuple[Hedge, ...]]:
    """Raise the houses of all frontages, and plant hedges in the gaps between some of them.

    Parameters
    ----------
    grid : StreetGrid
        Where the frontages are.
    settings : RowSettings
        What the rows are like.
    hedge_share : float
        Share of gaps that have a hedge.
    seed : int
        Seed of the town.
    """
    buildings: list[Building] = []
    hedges: list[Hedge] = []
    for f, frontage in enumerate(grid.frontages):
        for n, plot in enumerate(frontage.plots(settings, stream(seed, "plots", f))):
            centre = plot.outline.centroid
            z = float(grid.ground.elevation((centre.x, centre.y)))
            rng = stream(seed, "house", f, n)
            if plot.storeys:
                facade = settings.facade
                width, pitch = rng.uniform(0.85, 1.15, 2) * (facade.window_width, facade.window_pitch)
                varied = facade.replaced(window_width=width, window_pitch=max(pitch, width + 0.4))
                height = plot.storeys * facade.storey_height + 0.5
                name = f"house {1000 * f + n}"
                buildings.append(building(plot.outline, height, rng, varied, z, grid.open_space, name))
            elif rng.random() < hedge_share:
                length = settings.gap_width - 0.3
                hedges.append(Hedge(centre.x, centre.y, z, frontage.heading, length))
    return tuple(buildings), tuple(hedges)


def trees(
    grid: StreetGrid, settings: FurnitureSettings, seed: int, bare: shapely.Geometry | None = None
) -> tuple[Tree, ...]:
    """Plant the trees of all frontages, in summer.

    Parameters
    ----------
    grid : StreetGrid
        Where the frontages are.
    settings : FurnitureSettings
        How many.
    seed : int
        Seed of the town.
    bare : shapely.Geometry, optional
        Where none are planted.
    """
    planted = []
    for f, frontage in enumerate(grid.frontages):
        rng = stream(seed, "tree places", f)
        for n, s in enumerate(_places(frontage, settings.pole_spacing, 0.1, 0.1, rng).tolist()):
            x, y = frontage.points(s, grid.profile.pavement_width - _TREE_LINE).tolist()
            if rng.random() < settings.tree_share and not _covers(bare, x, y):
                z = float(grid.ground.elevation((x, y)))
                planted.append(Tree.drawn(TREE_IDS + 1000 * f + n, (x, y), z, stream(seed, "tree", f, n)))
    return tuple(planted)


def pole_sites(
    grid: StreetGrid, settings: FurnitureSettings, seed: int, bare: shapely.Geometry | None = None
) -> tuple[PoleSite, ...]:
    """Places of all poles that stand from the beginning; see :func:`trees` for the parameters."""
    sites = []
    for f, frontage in enumerate(grid.frontages):
        rng = stream(seed, "pole places", f)
        along = _places(frontage, settings.pole_spacing, 0.5, 0.1, rng).tolist()
        kinds = [_KINDS[k] for k in rng.choice(len(_KINDS), len(along), p=_KIND_SHARES)]
        if frontage.length > 2 * CORNER:
            lights = rng.random(2) < settings.traffic_light_share
            for has_light, mirror in zip(lights, (False, True), strict=True):
                corner = [(3.0, PoleKind.TRAFFIC_LIGHT)] if has_light else []
                corner += [(4.6 + 1.4 * k, PoleKind.BOLLARD) for k in range(settings.bollards)]
                along += [frontage.length - s if mirror else s for s, _ in corner]
                kinds += [kind for _, kind in corner]
        sites += _sites(grid, frontage, POLE_IDS + 1000 * f, along, kinds, bare)
    return tuple(sites)


def spare_sites(
    grid: StreetGrid, settings: FurnitureSettings, seed: int, bare: shapely.Geometry | None = None
) -> tuple[PoleSite, ...]:
    """Places where poles may appear later, clear of all others; see :func:`trees` for the parameters."""
    sites = []
    for f, frontage in enumerate(grid.frontages):
        rng = stream(seed, "spare places", f)
        along = _places(frontage, settings.pole_spacing / 2, 0.6, 0.05, rng).tolist()
        kinds = [_KINDS[k] for k in rng.choice(len(_KINDS), len(along), p=_KIND_SHARES)]
        sites += _sites(grid, frontage, SPARE_IDS + 1000 * f, along, kinds, bare)
    return tuple(sites)


def parking_places(grid: StreetGrid, bare: shapely.Geometry | None = None) -> tuple[ParkingPlace, ...]:
    """Places to park along all kerbs, except on bare ground."""
    places = []
    out = grid.profile.pavement_width + grid.profile.parking_width / 2
    for frontage in grid.frontages:
        count = int((frontage.length - 2 * CORNER) / _PLACE)
        first = (frontage.length - (count - 1) * _PLACE) / 2
        # Cars keep to the right: they head against the frontage, which has the street on its own right.
        yaw = frontage.heading + np.pi
        for x, y in frontage.points(first + _PLACE * np.arange(max(count, 0)), out).tolist():
            if not _covers(bare, x, y, _PLACE / 2):
                places.append(ParkingPlace((x, y), yaw))
    return tuple(places)


def _places(frontage: Frontage, spacing: float, phase: float, jitter: float, rng: np.random.Generator) -> Array:
    """Distances along a frontage: a regular row with a phase and jitter in shares of the spacing."""
    room = max(frontage.length - 2 * CORNER, 0.0)
    regular = np.arange(int(room / spacing) + 1) + phase
    places = CORNER + spacing * (regular + rng.uniform(-jitter, jitter, len(regular)))
    return np.asarray(places[places <= frontage.length - CORNER])


def _sites(
    grid: StreetGrid,
    frontage: Frontage,
    base: int,
    along: list[float],
    kinds: list[PoleKind],
    bare: shapely.Geometry | None,
) -> list[PoleSite]:
    points = frontage.points(along, grid.profile.pavement_width - _POLE_LINE)
    sites = []
    for n, ((x, y), kind) in enumerate(zip(points.tolist(), kinds, strict=True)):
        # Plates face the traffic, arms reach over the road.
        yaw = frontage.heading + (np.pi if kind is PoleKind.SIGN else -np.pi / 2)
        if not _covers(bare, x, y):
            sites.append(PoleSite(base + n, kind, (x, y), float(grid.ground.elevation((x, y))), float(yaw)))
    return sites


def _covers(bare: shapely.Geometry | None, x: float, y: float, margin: float = 0.0) -> bool:
    return bare is not None and bool(shapely.dwithin(bare, shapely.Point(x, y), margin + 1e-9))
