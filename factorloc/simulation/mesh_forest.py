"""MeshForest: triangle meshes sorted into trees of boxes, some of them moving, for exact queries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.simulation import _crossing_kernels, _forest_kernels, _mesh_kernels

__all__ = ["MeshForest"]

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


@dataclass(frozen=True)
class MeshForest:
    """Groups of triangles, each of which moves as a whole and has a tree of bounding boxes of its own.

    Parameters
    ----------
    triangles : ndarray, shape (T, 3, 3)
        Vertices at time 0, m.
    velocities : ndarray, shape (G, 3)
        Constant velocity of each group, m/s.
    order, roots, boxes, links
        The trees, as of :func:`~factorloc.simulation._forest_kernels.build_forest`.
    """

    triangles: Array
    velocities: Array
    order: Indices
    roots: Indices
    boxes: Array
    links: Indices

    @classmethod
    def build(cls, groups: Sequence[Array], velocities: npt.ArrayLike | None = None) -> MeshForest:
        """Sort groups of triangles (T_g, 3, 3) with their velocities (G, 3), zero by default; groups may be empty."""
        triangles = np.ascontiguousarray(np.concatenate([np.empty((0, 3, 3)), *groups]), np.float64)
        starts = np.cumsum([0, *(len(group) for group in groups)]).astype(np.int64)
        speeds = np.zeros((len(groups), 3)) if velocities is None else np.asarray(velocities, np.float64)
        return cls(triangles, speeds.reshape(-1, 3), *_forest_kernels.build_forest(triangles, starts))

    def shorten(self, origins: Array, directions: Array, times: Array, ranges: Array, triangles: Indices) -> None:
        """Shorten rays to the first triangle they meet.

        Parameters
        ----------
        origins, directions : ndarray, shape (N, 3)
            Start points (m) and unit vectors.
        times : ndarray, shape (N,)
            s.
        ranges : ndarray, shape (N,)
            Lengths, m; updated in place.
        triangles : ndarray of int64, shape (N,)
            What ends each ray; the index of the triangle is written where the ray becomes shorter.
        """
        trees = (self.triangles, self.order, self.roots, self.boxes, self.links)
        _mesh_kernels.first_hits(origins, directions, times, self.velocities, *trees, ranges, triangles)

    def free_paths(self, origins: Array, directions: Array, draws: Array, rates: Array) -> Array:
        """Lengths (N,) at which the optical depth of rays (N, 3) reaches their draws (N,), m; infinite if it does not.

        The forest holds one group: closed regions at rest, with the decay rate behind each triangle (T,), 1/m.
        """
        tree = (self.order, self.roots[0], self.boxes, self.links)
        return np.asarray(
            _crossing_kernels.free_paths(origins, directions, draws, self.triangles, rates, *tree), np.float64
        )

    def clearances(self, points: Array, times: Array, closed: npt.NDArray[np.bool_]) -> Array:
        """Distances (N,) from points (N, 3) at times (N,) to the nearest triangle, m; 0 in closed groups (G,)."""
        trees = (self.triangles, self.order, self.roots, self.boxes, self.links)
        return np.asarray(_crossing_kernels.clearances(points, times, self.velocities, closed, *trees), np.float64)
