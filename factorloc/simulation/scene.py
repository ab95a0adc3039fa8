"""Scene: what stands where, with its exact truth; a world is made of it."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
import shapely

from factorloc.simulation.barrels import Barrel
from factorloc.simulation.buildings import Building
from factorloc.simulation.facades import Facade
from factorloc.simulation.ground import Ground
from factorloc.simulation.mesh_world import MeshWorld
from factorloc.simulation.poles import Pole
from factorloc.simulation.solid import Canopy, Solid
from factorloc.simulation.trees import Hedge, Tree
from factorloc.simulation.vehicles import Pedestrian, Vehicle

__all__ = ["Scene", "Thing"]


class Thing(Protocol):
    """What a scene is made of."""

    @property
    def footprint(self) -> shapely.Polygon:
        """What it takes up of the ground at time 0, m."""
        ...

    @property
    def solids(self) -> tuple[Solid, ...]:
        """What it adds to a world."""
        ...


@dataclass(frozen=True)
class Scene:
    """Ground and everything on it.

    Parameters
    ----------
    ground : Ground
        What it stands on.
    buildings, poles, trees, hedges, barrels, vehicles, pedestrians : tuples
        What stands there; trunks and barrels are not among the poles.
    """

    ground: Ground
    buildings: tuple[Building, ...] = ()
    poles: tuple[Pole, ...] = ()
    trees: tuple[Tree, ...] = ()
    hedges: tuple[Hedge, ...] = ()
    barrels: tuple[Barrel, ...] = ()
    vehicles: tuple[Vehicle, ...] = ()
    pedestrians: tuple[Pedestrian, ...] = ()

    @cached_property
    def world(self) -> MeshWorld:
        """The world a lidar sees of it."""
        return MeshWorld(tuple(self._solids()), self.canopies)

    @property
    def canopies(self) -> tuple[Canopy, ...]:
        """Crowns and hedges."""
        of_trees = itertools.chain.from_iterable(tree.canopies for tree in self.trees)
        return (*of_trees, *itertools.chain.from_iterable(hedge.canopies for hedge in self.hedges))

    @property
    def true_poles(self) -> tuple[Pole, ...]:
        """All that is a pole to a detector, trunks and barrels included, by identity."""
        trunks = (tree.trunk for tree in self.trees)
        return tuple(sorted((*self.poles, *trunks, *(b.pole for b in self.barrels)), key=lambda pole: pole.id))

    @property
    def facades(self) -> tuple[Facade, ...]:
        """All facades that are seen."""
        return tuple(itertools.chain.from_iterable(building.facades for building in self.buildings))

    @property
    def footprints(self) -> tuple[shapely.Polygon, ...]:
        """What each thing takes up of the ground at time 0, m."""
        return tuple(thing.footprint for thing in (*self._still, *self.vehicles, *self.pedestrians))

    @property
    def _still(self) -> tuple[Thing, ...]:
        return (*self.buildings, *self.poles, *self.trees, *self.hedges, *self.barrels)

    def _solids(self) -> Iterator[Solid]:
        yield self.ground.solid
        for thing in self._still:
            yield from thing.solids
        movers: tuple[Vehicle | Pedestrian, ...] = (*self.vehicles, *self.pedestrians)
        for mover in movers:
            for solid in mover.solids:
                if not any(self.ground.slope):
                    yield solid
                    continue
                vx, vy, _ = solid.velocity
                climb = float(np.dot(self.ground.slope, (vx, vy)))
                mesh = self.ground.tilted(solid.mesh, (mover.x, mover.y))
                yield replace(solid, mesh=mesh, velocity=(vx, vy, climb))
