"""Tree and Hedge: trunks, crowns in which rays end by an exponential law, and what a season does to them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
import shapely.affinity

from factorloc.errors import SimulationError
from factorloc.simulation.poles import Pole, PoleKind
from factorloc.simulation.primitives import box, cone, cylinder, joined, mesh_of, sphere
from factorloc.simulation.solid import Canopy, Solid
from factorloc.simulation.world import Surface

__all__ = ["Hedge", "Tree", "leaf_share"]

_EMBED = 0.3  # m; a trunk reaches into the ground, so that it may slope
_BARE = 0.12  # share of a summer crown's decay rate that twigs alone have
_BARE_SIZE = 0.85  # size of a bare crown relative to a leafy one


def leaf_share(month: float) -> float:
    """Share of the leaves that are on the trees, 0 to 1, of a temperate year.

    Parameters
    ----------
    month : float
        Time of the year in months: 0 and 12 are the first of January, 6.5 the middle of July.

    Returns
    -------
    float
        0 from December to March, 1 from the middle of May to the middle of September, a smooth step between.
    """
    month = month % 12.0
    grown, fallen = np.clip([(month - 3.0) / 1.5, (month - 8.5) / 2.5], 0.0, 1.0)
    spring, autumn = (x * x * (3 - 2 * x) for x in (float(grown), float(fallen)))
    return spring - autumn


@dataclass(frozen=True)
class Tree:
    """A tree of the street.

    Parameters
    ----------
    trunk : Pole
        Its stem, of kind trunk: it is a pole to whoever sees it.
    crown_width, crown_height : float
        Full axes of the crown in summer, m; it begins at the top of the free trunk.
    rate : float
        Decay rate of the crown in summer, 1/m.
    leaves : float
        Share of the leaves that are on it, 0 to 1: it scales the rate down to that of twigs, and the size a little.

    Raises
    ------
    SimulationError
        If the trunk is another kind of pole, a size is not positive, or the share is not in [0, 1].
    """

    trunk: Pole
    crown_width: float
    crown_height: float
    rate: float
    leaves: float = 1.0

    def __post_init__(self) -> None:
        if self.trunk.kind is not PoleKind.TRUNK:
            raise SimulationError(f"tree: stands on a {self.trunk.kind}; give it a trunk")
        if not min(self.crown_width, self.crown_height, self.rate) > 0 or not 0 <= self.leaves <= 1:
            raise SimulationError(f"tree {self.trunk.id}: sizes and rate must be positive, leaves within [0, 1]")

    @classmethod
    def drawn(cls, id: int, position: tuple[float, float], bottom: float, rng: np.random.Generator) -> Tree:
        """Return a tree of usual size."""
        width, free = float(rng.uniform(0.14, 0.38)), float(rng.uniform(2.1, 3.0))
        trunk = Pole(id, PoleKind.TRUNK, *position, width, bottom, bottom + free, float(rng.uniform(0, 2 * np.pi)))
        crown = float(rng.uniform(2.8, 4.4))
        return cls(trunk, crown, crown * float(rng.uniform(0.9, 1.4)), float(rng.uniform(0.7, 1.8)))

    def at(self, month: float) -> Tree:
        """Return the tree as it is in a month of the year."""
        return replace(self, leaves=leaf_share(month))

    @property
    def footprint(self) -> shapely.Polygon:
        """Where the trunk stands, m."""
        return self.trunk.footprint

    @property
    def solids(self) -> tuple[Solid, ...]:
        """Trunk and leading shoot; above its free part it tapers inside of the crown."""
        stem, height = self.trunk, self.trunk.top - self.trunk.bottom
        base = (stem.x, stem.y, stem.bottom - _EMBED)
        shoot = cone(stem.width, stem.width * 0.25, 0.6 * self.crown_height, (stem.x, stem.y, stem.top))
        trunk = joined([cylinder(stem.width, height + _EMBED, base), shoot])
        return (Solid(trunk, Surface.TRUNK, f"trunk {stem.id}"),)

    @property
    def canopies(self) -> tuple[Canopy, ...]:
        """Its crown: an ellipsoid with lobes, turned as the tree is so that no two are alike."""
        size = _BARE_SIZE + (1 - _BARE_SIZE) * self.leaves
        rate = self.rate * (_BARE + (1 - _BARE) * self.leaves)
        unit = sphere((1, 1, 1))
        x, y, z = 2 * np.asarray(unit.vertices).T
        phi = np.arctan2(y, x) + self.trunk.yaw
        # Lobes fade out towards the poles of the sphere, where the azimuth has no meaning.
        lobes = 1 + (1 - z * z) * (0.10 * np.sin(3 * phi) + 0.06 * np.sin(5 * phi + 1.3 * self.trunk.yaw))
        half = np.array([self.crown_width, self.crown_width, self.crown_height]) / 2
        centre = (self.trunk.x, self.trunk.y, self.trunk.top + half[2])
        vertices = np.column_stack([x * lobes, y * lobes, z]) * half * size + centre
        crown = mesh_of(vertices, unit.faces)
        return (Canopy(crown, rate, f"crown {self.trunk.id}"),)


@dataclass(frozen=True)
class Hedge:
    """A clipped hedge: as good as opaque inside of a skin of leaves.

    Parameters
    ----------
    x, y, z : float
        Centre of its foot, m.
    yaw : float
        Direction of its length, rad.
    length, width, height : float
        Outer size, m; more than twice the skin.
    rate : float
        Decay rate of the skin in summer, 1/m.
    leaves : float
        Share of the leaves that are on it, 0 to 1.

    Raises
    ------
    SimulationError
        If it is too small for its skin, the rate is not positive, or the share is not in [0, 1].
    """

    x: float
    y: float
    z: float = 0.0
    yaw: float = 0.0
    length: float = 4.0
    width: float = 0.7
    height: float = 1.2
    rate: float = 6.0
    leaves: float = 1.0

    _SKIN = 0.12

    def __post_init__(self) -> None:
        if not min(self.length, self.width, self.height) > 2 * self._SKIN or not self.rate > 0:
            raise SimulationError(f"hedge: size and rate must be above {2 * self._SKIN} m and 0")
        if not 0 <= self.leaves <= 1:
            raise SimulationError(f"hedge leaves: {self.leaves}; must be within [0, 1]")

    def at(self, month: float) -> Hedge:
        """Return the hedge as it is in a month of the year."""
        return replace(self, leaves=leaf_share(month))

    @property
    def footprint(self) -> shapely.Polygon:
        """Rectangle it takes up, m."""
        a, b = self.length / 2, self.width / 2
        turned = shapely.affinity.rotate(shapely.box(-a, -b, a, b), self.yaw, origin=(0, 0), use_radians=True)
        footprint: shapely.Polygon = shapely.affinity.translate(turned, self.x, self.y)
        return footprint

    @property
    def solids(self) -> tuple[Solid, ...]:
        """Its core."""
        size = (self.length - 2 * self._SKIN, self.width - 2 * self._SKIN, self.height - self._SKIN)
        return (Solid(box(size, (self.x, self.y, self.z), self.yaw), Surface.HEDGE, "hedge"),)

    @property
    def canopies(self) -> tuple[Canopy, ...]:
        """Its skin of leaves."""
        size = (self.length, self.width, self.height)
        rate = self.rate * (_BARE + (1 - _BARE) * self.leaves)
        return (Canopy(box(size, (self.x, self.y, self.z), self.yaw), rate, "hedge"),)
