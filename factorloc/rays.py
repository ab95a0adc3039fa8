"""Rays: many scans in one block of arrays, as kernels want them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.errors import GeometryError
from factorloc.geometry import se2, se3
from factorloc.scan import RayStatus, Scan

__all__ = ["Rays", "pack", "spread"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Rays:
    """Rays of many scans in one block, in the *body* frame of each scan: what kernels work on.

    Parameters
    ----------
    origins, directions : ndarray, shape (M, D)
        Ray origins (m) and unit directions in the body frame.
    ranges : ndarray, shape (M,)
        Length of each ray, m.
    status : ndarray of uint8, shape (M,)
        :class:`RayStatus`.
    offsets : ndarray of int64, shape (S + 1,)
        Scan ``k`` owns the rays ``offsets[k]:offsets[k + 1]``.
    """

    origins: Array
    directions: Array
    ranges: Array
    status: npt.NDArray[np.uint8]
    offsets: npt.NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.offsets) - 1

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return int(self.directions.shape[1])

    def select(self, keep: npt.NDArray[np.bool_]) -> Rays:
        """Return the block of some of its rays, given by a mask (M,); scans keep their places, even empty ones."""
        count = np.concatenate([[0], np.cumsum(keep)])
        return Rays(
            self.origins[keep], self.directions[keep], self.ranges[keep], self.status[keep], count[self.offsets]
        )

    def returns(self) -> Rays:
        """Only the rays that were reflected within the limits."""
        return self.select(self.status == RayStatus.RETURN)


def pack(scans: Sequence[Scan]) -> Rays:
    """Move the rays of scans into their body frames and lay them out in one block.

    Parameters
    ----------
    scans : sequence of Scan
        At least one; all of the same dimension.

    Returns
    -------
    Rays
        Contiguous float64 arrays.

    Raises
    ------
    GeometryError
        If there is no scan, or their dimensions differ.
    """
    if not scans:
        raise GeometryError("scans: none given")
    dimensions = {scan.dimension for scan in scans}
    if len(dimensions) > 1:
        raise GeometryError("scans: planar and spatial ones are mixed; keep them apart")
    if dimensions == {2}:
        origins = [se2.transform(s.T_body_sensor, s.origins) for s in scans]
        directions = [se2.rotate(s.T_body_sensor[2], s.directions) for s in scans]
    else:
        origins = [se3.transform(s.T_body_sensor, s.origins) for s in scans]
        directions = [s.directions @ s.T_body_sensor[:3, :3].T for s in scans]
    return Rays(
        np.ascontiguousarray(np.concatenate(origins)),
        np.ascontiguousarray(np.concatenate(directions)),
        np.concatenate([s.ranges for s in scans]),
        np.concatenate([s.status for s in scans]),
        np.concatenate([[0], np.cumsum([len(s) for s in scans])]).astype(np.int64),
    )


def spread(rays: Rays, count: int, voxel: float = 0.5, seed: int = 0) -> Rays:
    """Choose rays with a return whose ends lie spread over the surroundings.

    A spinning lidar draws dense rings on the ground nearby and few points on the walls that tell where it is. One ray
    is drawn of each voxel that holds an end, and of those as many as wanted; scans with fewer voxels keep them all.

    Parameters
    ----------
    rays : Rays
        One or more scans.
    count : int
        Most rays of each scan.
    voxel : float
        Edge of a voxel in the body frame, m.
    seed : int
        Of the draw: the same rays, the same choice.
    """
    returns = rays.returns()
    ends = returns.origins + returns.directions * returns.ranges[:, None]
    voxels = np.floor(ends / voxel).astype(np.int64)
    keep = np.zeros(len(ends), np.bool_)
    rng = np.random.default_rng(seed)
    for k in range(len(returns)):
        first, last = int(returns.offsets[k]), int(returns.offsets[k + 1])
        order = rng.permutation(last - first)
        # One number a voxel; two far apart may share one by chance, which costs a ray.
        keys = voxels[first:last][order] @ np.array([1, 2_097_169, 4_398_050_705_407])[: voxels.shape[1]]
        _, found = np.unique(keys, return_index=True)
        keep[first + order[np.sort(found)[:count]]] = True
    return returns.select(keep)
