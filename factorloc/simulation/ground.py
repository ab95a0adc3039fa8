"""Ground: a strip of road with a slope, and pavements behind kerbs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import shapely

from factorloc.errors import SimulationError
from factorloc.simulation.primitives import joined, mesh_of, prism, triangulated
from factorloc.simulation.solid import Solid
from factorloc.simulation.world import Surface

if TYPE_CHECKING:
    import trimesh

__all__ = ["Ground"]

Array = npt.NDArray[np.float64]

_DEPTH = 0.3  # m; a pavement reaches down through the road, so that no ray slips in between


@dataclass(frozen=True)
class Ground:
    """A plane through the world's origin, and pavements that stand above it.

    Parameters
    ----------
    area : shapely.Polygon
        How far it reaches, seen from above, m.
    pavements : tuple of shapely.Polygon
        Where it is raised.
    kerb : float
        Height of the pavements above the road, m.
    slope : (float, float)
        Rise per metre along x and y.

    Raises
    ------
    SimulationError
        If a polygon is empty or not valid, the kerb is not positive, or the slope is not finite.
    """

    area: shapely.Polygon
    pavements: tuple[shapely.Polygon, ...] = ()
    kerb: float = 0.12
    slope: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        for what, polygon in (("area", self.area), *(("pavement", polygon) for polygon in self.pavements)):
            if not isinstance(polygon, shapely.Polygon) or polygon.is_empty or not polygon.is_valid:
                raise SimulationError(f"ground {what}: {shapely.is_valid_reason(polygon)}; expected one valid polygon")
        if not 0 < self.kerb < np.inf or not np.isfinite(self.slope).all():
            raise SimulationError(f"ground: kerb {self.kerb} m, slope {self.slope}; need above 0, finite")

    def elevation(self, points: npt.ArrayLike) -> Array:
        """Height of the surface at points (..., 2), m, shape (...)."""
        xy = np.asarray(points, np.float64)
        raised = shapely.intersects_xy(self._raised, xy[..., 0], xy[..., 1])
        return np.asarray(xy @ np.asarray(self.slope, np.float64) + np.where(raised, self.kerb, 0.0))

    def tilted(self, mesh: trimesh.Trimesh, pivot: npt.ArrayLike = (0.0, 0.0)) -> trimesh.Trimesh:
        """Return a mesh that follows the slope about a pivot (2,): a shear, so that what is upright stays so."""
        vertices = np.array(mesh.vertices, np.float64)
        vertices[:, 2] += (vertices[:, :2] - np.asarray(pivot, np.float64)) @ np.asarray(self.slope, np.float64)
        return mesh_of(vertices, np.asarray(mesh.faces))

    @cached_property
    def solid(self) -> Solid:
        """Its surface; an open sheet with closed pavements on it."""
        points, triangles, _ = triangulated(self.area)
        sheet = mesh_of(np.pad(points, ((0, 0), (0, 1))), triangles)
        raised = [prism(polygon, -_DEPTH, self.kerb) for polygon in self.pavements]
        return Solid(self.tilted(joined([sheet, *raised])), Surface.GROUND, "ground")

    @cached_property
    def _raised(self) -> shapely.Geometry:
        raised = shapely.union_all(self.pavements)
        shapely.prepare(raised)
        return raised
