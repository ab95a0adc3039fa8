"""Scans that were cast once, kept on disk in small whole numbers, and read when asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import overload

import numpy as np
import numpy.typing as npt

from factorloc.scan import RayStatus, Scan
from factorloc.simulation import MeshWorld, SpatialLidar, cache_key, cached
from factorloc.simulation.session_cache import read_arrays
from factorloc.simulation.streams import stream

__all__ = ["StoredScans"]

Array = npt.NDArray[np.float64]

_AT_ONCE = 25  # scans in a file
_NO_RETURN = 65535


class StoredScans(Sequence[Scan]):
    """Scans of one lidar from a body that stands still.

    Parameters
    ----------
    files : list of Path
        Ranges of so many scans each.
    count : int
        Scans in all.
    lidar : SpatialLidar
        What took them.
    unit : float
        Ranges are whole numbers of it, m.
    """

    def __init__(self, files: list[Path], count: int, lidar: SpatialLidar, unit: float) -> None:
        self._files, self._count, self._lidar, self._unit = files, count, lidar, unit
        self._ranges = lru_cache(maxsize=2)(lambda number: read_arrays(files[number])["ranges"])

    @classmethod
    def of(
        cls,
        folder: Path,
        follows_from: tuple[str, ...],
        world: Callable[[], MeshWorld],
        lidar: SpatialLidar,
        T_world_body: Array,
        unit: float,
        on_scan: Callable[[int], None] | None = None,
    ) -> StoredScans:
        """Find scans in a cache, or cast them.

        Parameters
        ----------
        folder : Path
            The cache.
        follows_from : tuple of str
            All that they follow from, but the poses.
        world : callable
            Makes the world, if rays have to be cast.
        lidar : SpatialLidar
            What takes them.
        T_world_body : ndarray, shape (N, 4, 4)
            Where it stands.
        unit : float
            Ranges are rounded to it, m.
        on_scan : callable, optional
            Called with the number of scans that are there.
        """
        files = []
        for first in range(0, len(T_world_body), _AT_ONCE):
            poses = T_world_body[first : first + _AT_ONCE]
            key = cache_key(*follows_from, first, np.round(poses, 9).tobytes().hex())

            def cast(poses: Array = poses, first: int = first) -> dict[str, npt.NDArray[np.uint16]]:
                rng = stream(first, "scans", *follows_from[-3:])
                return {"ranges": _packed(lidar.cast_many(world(), poses, rng), unit)}

            cached(folder, key, cast)
            files.append(folder / f"{cache_key(key)}.npz")
            if on_scan is not None:
                on_scan(first + len(poses))
        return cls(files, len(T_world_body), lidar, unit)

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, index: int) -> Scan: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Scan]: ...
    def __getitem__(self, index: int | slice) -> Scan | Sequence[Scan]:
        if isinstance(index, slice):
            return [self[k] for k in range(*index.indices(self._count))]
        if not -self._count <= index < self._count:
            raise IndexError(index)
        number, row = divmod(index % self._count, _AT_ONCE)
        packed = self._ranges(number)[row]
        low, high = self._lidar.range_limits
        status = np.full(len(packed), RayStatus.RETURN, np.uint8)
        status[packed == 0], status[packed == _NO_RETURN] = RayStatus.BELOW_MINIMUM, RayStatus.NO_RETURN
        ranges = np.clip(packed * self._unit, low, high)
        shape = self._lidar.directions.shape
        return Scan(
            directions=self._lidar.directions.reshape(-1, 3),
            ranges=ranges,
            status=status,
            range_limits=self._lidar.range_limits,
            shape=(shape[0], shape[1]),
            frame=self._lidar.frame,
            T_body_sensor=np.array(self._lidar.T_body_sensor),
        )

    def __iter__(self) -> Iterator[Scan]:
        return (self[k] for k in range(self._count))


def _packed(scans: list[Scan], unit: float) -> npt.NDArray[np.uint16]:
    packed = np.array([np.clip(np.rint(scan.ranges / unit), 1, _NO_RETURN - 1) for scan in scans]).astype(np.uint16)
    status = np.array([scan.status for scan in scans])
    packed[status == RayStatus.BELOW_MINIMUM], packed[status == RayStatus.NO_RETURN] = 0, _NO_RETURN
    return packed
