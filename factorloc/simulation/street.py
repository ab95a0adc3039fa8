"""A street between two rows of houses, with a cross street: the world of the convergence benchmarks."""

from __future__ import annotations

from pydantic import Field

from factorloc.config import Block
from factorloc.simulation.frontage import RowSettings
from factorloc.simulation.furnishing import FurnitureSettings, houses, parking_places, pole_sites, trees
from factorloc.simulation.mesh_world import MeshWorld
from factorloc.simulation.route import Route
from factorloc.simulation.scene import Scene
from factorloc.simulation.streams import stream
from factorloc.simulation.street_grid import StreetGrid, StreetProfile

__all__ = ["StreetSettings", "street_route", "street_scene", "street_world"]

_YARD = 8.0  # m between the backs of the houses and the end of the block


class StreetSettings(Block):
    """A street along x, from 0 on, with its middle at y = 0.

    Parameters
    ----------
    length : float
        Its length, m.
    crossing : float
        Where the cross street is, as a share of the length.
    slope : float
        Rise per metre along x.
    month : float
        Time of the year, which tells how leafy trees are; 6.5 is the middle of July.
    profile : StreetProfile
        Cross-section of both streets.
    rows : RowSettings
        Houses.
    furniture : FurnitureSettings
        Poles, trees, hedges and parked cars.
    """

    length: float = Field(180.0, ge=100, le=5000)
    crossing: float = Field(0.6, ge=0.25, le=0.75)
    slope: float = Field(0.0, ge=-0.1, le=0.1)
    month: float = Field(6.5, ge=0, le=12)
    profile: StreetProfile = StreetProfile()
    rows: RowSettings = RowSettings()
    furniture: FurnitureSettings = FurnitureSettings()

    @property
    def grid(self) -> StreetGrid:
        """Where its two streets run."""
        reach = self.profile.half_road + self.profile.pavement_width + self.rows.house_depth + _YARD
        bounds = (0.0, -reach, self.length, reach)
        return StreetGrid((self.crossing * self.length,), (0.0,), bounds, self.profile, (self.slope, 0.0))


def street_world(settings: StreetSettings | None = None, seed: int = 0) -> MeshWorld:
    """Build the world of a street.

    Parameters
    ----------
    settings : StreetSettings, optional
        What it is like.
    seed : int
        Which of all such streets.
    """
    return street_scene(settings, seed).world


def street_scene(settings: StreetSettings | None = None, seed: int = 0) -> Scene:
    """Build a street with its truth; see :func:`street_world`."""
    settings = settings or StreetSettings()
    grid, furniture = settings.grid, settings.furniture
    buildings, hedges = houses(grid, settings.rows, furniture.hedge_share, seed)
    places = parking_places(grid)
    taken = stream(seed, "parked").random(len(places)) < furniture.parked_share
    parked = [(n, place) for n, place in enumerate(places) if taken[n]]
    return Scene(
        ground=grid.ground,
        buildings=buildings,
        hedges=tuple(hedge.at(settings.month) for hedge in hedges),
        poles=tuple(site.pole(stream(seed, "pole", site.id)) for site in pole_sites(grid, furniture, seed)),
        trees=tuple(tree.at(settings.month) for tree in trees(grid, furniture, seed)),
        vehicles=tuple(place.car(grid.ground, stream(seed, "parked car", n)) for n, place in parked),
    )


def street_route(settings: StreetSettings | None = None, speed: float = 8.0) -> Route:
    """Drive the street along x in the right-hand lane, from 5 m after its begin to 5 m before its end."""
    settings = settings or StreetSettings()
    y = -settings.profile.lane_width / 2
    return Route(((5.0, y), (settings.length - 5.0, y)), 5.0, speed, 1.0)
