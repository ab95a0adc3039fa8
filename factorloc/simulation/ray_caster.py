"""Ray casters: the first triangle of a mesh at rest that a ray meets, by embree or by a tree of our own."""

from __future__ import annotations

import functools
import importlib.util
import logging
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from factorloc.simulation import _mesh_kernels
from factorloc.simulation.mesh_forest import MeshForest

__all__ = ["EmbreeCaster", "ForestCaster", "RayCaster", "ray_caster"]

logger = logging.getLogger(__name__)

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

_BLOCK = 1 << 18  # rays handed over at once; bounds the memory of their copies in single precision


class RayCaster(Protocol):
    """Something that knows the triangles of a mesh."""

    def first_hits(self, origins: Array, directions: Array) -> tuple[Array, Indices]:
        """Ranges (N,), m, infinite for rays that meet nothing, and the triangles met (N,), -1 for none."""
        ...


class EmbreeCaster:
    """Embree finds the triangle in single precision; the range on its plane is then computed in double precision.

    On the triangle that a ray truly meets, ranges are exact to rounding: about 1e-13 m over 100 m. Single precision
    moves rays and vertices by less than 2**-23 of the size of the mesh (0.1 mm in 1 km), so a ray this close to an
    edge may end on the neighbour or pass a silhouette. A closed mesh does not leak.

    Parameters
    ----------
    triangles : ndarray, shape (T, 3, 3)
        Vertices, m; at least one triangle.
    """

    def __init__(self, triangles: Array) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self._triangles = np.ascontiguousarray(triangles, np.float64)
        corners = self._triangles.reshape(-1, 3)
        self._centre = (corners.min(0) + corners.max(0)) / 2
        self._scene: Any = EmbreeScene(robust=True)
        # Vertices are handed over one by one for each triangle: equal ones stay equal when they are rounded.
        faces = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
        TriangleMesh(scene=self._scene, vertices=(corners - self._centre).astype(np.float32), indices=faces)

    def first_hits(self, origins: Array, directions: Array) -> tuple[Array, Indices]:
        """Ranges (N,), m, infinite for rays that meet nothing, and the triangles met (N,), -1 for none."""
        ranges, found = np.empty(len(origins)), np.empty(len(origins), np.int64)
        for first in range(0, len(origins), _BLOCK):
            part = slice(first, first + _BLOCK)
            moved = (origins[part] - self._centre).astype(np.float32)
            found[part] = self._scene.run(moved, directions[part].astype(np.float32))
            ranges[part] = _mesh_kernels.plane_ranges(origins[part], directions[part], self._triangles, found[part])
        return ranges, found


class ForestCaster:
    """A tree of boxes in double precision, exact to rounding at edges too; some times slower than embree.

    Parameters
    ----------
    triangles : ndarray, shape (T, 3, 3)
        Vertices, m.
    """

    def __init__(self, triangles: Array) -> None:
        self._forest = MeshForest.build([triangles])

    def first_hits(self, origins: Array, directions: Array) -> tuple[Array, Indices]:
        """Ranges (N,), m, infinite for rays that meet nothing, and the triangles met (N,), -1 for none."""
        ranges, found = np.full(len(origins), np.inf), np.full(len(origins), -1, np.int64)
        self._forest.shorten(origins, directions, np.zeros(len(origins)), ranges, found)
        return ranges, found


def ray_caster(triangles: Array) -> RayCaster:
    """Return the fastest caster of triangles (T, 3, 3) that this machine has."""
    if len(triangles) and _has_embree():
        return EmbreeCaster(triangles)
    return ForestCaster(triangles)


@functools.cache
def _has_embree() -> bool:
    if importlib.util.find_spec("embreex") is not None:
        return True
    logger.warning("embreex is not installed (it has no wheel for this platform): rays are cast some times slower")
    return False
