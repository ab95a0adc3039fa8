"""Solid and Canopy: what stands in a world of triangle meshes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from factorloc.errors import SimulationError
from factorloc.simulation.world import Surface

if TYPE_CHECKING:
    import trimesh

__all__ = ["Canopy", "Solid"]


@dataclass(frozen=True)
class Solid:
    """An opaque object, at rest or in straight motion.

    Parameters
    ----------
    mesh : trimesh.Trimesh
        Its surface in the world frame at time 0, m. It need not be closed.
    surface : Surface
        What a ray that ends on it reports.
    name : str
        What it is called.
    velocity : (float, float, float)
        Constant velocity in the world, m/s; zero for what stands still.

    Raises
    ------
    SimulationError
        If the mesh is empty or not finite, the velocity is not finite, or the surface is none of a solid.
    """

    mesh: trimesh.Trimesh
    surface: Surface
    name: str = ""
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        _check(f"solid {self.name!r}", self.mesh)
        if self.surface in (Surface.NOTHING, Surface.GLASS, Surface.FOLIAGE):
            raise SimulationError(f"solid {self.name!r}: surface {Surface(self.surface).name} is not opaque")
        if np.shape(self.velocity) != (3,) or not np.isfinite(self.velocity).all():
            raise SimulationError(f"solid {self.name!r}: velocity {self.velocity}; expected three finite numbers, m/s")

    @property
    def moves(self) -> bool:
        """Whether its velocity is not zero."""
        return any(self.velocity)


@dataclass(frozen=True)
class Canopy:
    """A semi-transparent region in which the free path of a ray is exponentially distributed (thesis, eq. 3.1).

    Parameters
    ----------
    mesh : trimesh.Trimesh
        Its boundary in the world frame, m; closed, faces outwards. Where canopies overlap, their decay rates add up.
    rate : float
        Decay rate, the inverse of the mean free path, 1/m.
    name : str
        What it is called.

    Raises
    ------
    SimulationError
        If the mesh is empty, not finite, not closed or inside out, or the rate is not positive and finite.
    """

    mesh: trimesh.Trimesh
    rate: float
    name: str = ""

    def __post_init__(self) -> None:
        _check(f"canopy {self.name!r}", self.mesh)
        if not (self.mesh.is_watertight and self.mesh.is_winding_consistent and self.mesh.volume > 0):
            raise SimulationError(f"canopy {self.name!r}: its mesh is not closed or inside out; mend it with trimesh")
        if not 0 < self.rate < np.inf:
            raise SimulationError(f"canopy {self.name!r}: rate {self.rate} 1/m; must be positive and finite")


def _check(what: str, mesh: trimesh.Trimesh) -> None:
    if len(mesh.faces) == 0 or not np.isfinite(mesh.vertices).all():
        raise SimulationError(f"{what}: its mesh has {len(mesh.faces)} faces; expected some, of finite vertices")
