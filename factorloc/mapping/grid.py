"""Grid: where the cells of a map lie."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from factorloc.errors import MapError

__all__ = ["Grid", "require_memory"]

Array = npt.NDArray[np.float64]

_ON_RASTER = 1e-6  # cells; lines this close to each other are one
_MOST_LINES = 2**51  # from the origin of the frame; farther ones are no longer told apart to a quarter of a cell


def require_memory(needed: int, what: str) -> None:
    """Refuse an allocation that would not fit into the free memory of this machine, before it is made.

    Parameters
    ----------
    needed : int
        Bytes.
    what : str
        What they are for, with its size.

    Raises
    ------
    MapError
        If less than that is available.
    """
    try:
        available = _available_memory()
    except (ValueError, OSError):
        return
    if needed > available:
        raise MapError(
            f"{what} needs {needed / 2**30:.1f} GiB, {available / 2**30:.1f} GiB are free; "
            "use a coarser resolution or a smaller region"
        )


def _available_memory() -> int:
    """Bytes that can be had without swapping; all there are where the system does not tell."""
    meminfo = Path("/proc/meminfo")
    if meminfo.exists():
        # What is free is less than what is available: caches give way.
        found = re.search(r"^MemAvailable:\s+(\d+) kB$", meminfo.read_text(encoding="ascii"), re.MULTILINE)
        if found:
            return int(found[1]) * 1024
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


@dataclass(frozen=True)
class Grid:
    """Axis-aligned cubic cells in a named frame, of any dimension.

    Cell ``i`` covers ``[origin + i * resolution, origin + (i + 1) * resolution)`` along each axis. Origins made by
    :meth:`around` are whole multiples of the resolution, so that all grids of one frame and resolution share a raster.

    Parameters
    ----------
    origin : tuple of float
        Lowest corner, m, in ``frame``.
    resolution : float
        Edge length of a cell, m.
    shape : tuple of int
        Cells along each axis.
    frame : str
        Name of the frame the map lives in.

    Raises
    ------
    MapError
        If a number is not finite, not positive, or the lengths disagree.
    """

    origin: tuple[float, ...]
    resolution: float
    shape: tuple[int, ...]
    frame: str = "map"

    def __post_init__(self) -> None:
        object.__setattr__(self, "origin", tuple(float(v) for v in self.origin))
        object.__setattr__(self, "shape", tuple(int(v) for v in self.shape))
        object.__setattr__(self, "resolution", float(self.resolution))
        if len(self.origin) != len(self.shape) or len(self.shape) not in (2, 3):
            raise MapError(f"grid: origin {self.origin} and shape {self.shape}; expected two or three axes each")
        if not (np.isfinite(self.resolution) and self.resolution > 0):
            raise MapError(f"grid: resolution {self.resolution} m; expected a positive length")
        if not np.isfinite(self.origin).all() or min(self.shape) < 1:
            raise MapError(f"grid: origin {self.origin}, shape {self.shape}; expected finite and at least one cell")

    @classmethod
    def around(cls, points: npt.ArrayLike, resolution: float, margin: float = 1.0, frame: str = "map") -> Grid:
        """Make the smallest grid on the common raster that holds points and a margin around them.

        Parameters
        ----------
        points : array_like, shape (N, D)
            Points in ``frame``, m.
        resolution : float
            Edge length of a cell, m.
        margin : float
            Free space added on every side, m.
        frame : str
            Name of the frame.

        Raises
        ------
        MapError
            If there is no finite point or the resolution is not positive.
        """
        array = np.asarray(points, np.float64)
        if array.ndim != 2 or len(array) == 0 or not np.isfinite(array).all():
            raise MapError("grid: no finite points to lay it around; are there any returns?")
        if not (np.isfinite(resolution) and resolution > 0):
            raise MapError(f"grid: resolution {resolution} m; expected a positive length")
        if not (np.isfinite(margin) and margin >= 0):
            raise MapError(f"grid: margin {margin} m; expected a length")
        with np.errstate(over="ignore", invalid="ignore"):
            low = np.floor((array.min(0) - margin) / resolution)
            # A point on the upper face of a cell belongs to the next one.
            high = np.maximum(np.ceil((array.max(0) + margin) / resolution), np.floor(array.max(0) / resolution) + 1)
            shape = high - low
        if not np.abs([low, high]).max() < _MOST_LINES:
            raise MapError(f"grid: points reach {np.abs(array).max():.3g} m, too far for cells of {resolution} m")
        return cls(tuple(low * resolution), resolution, tuple(int(n) for n in shape), frame)

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return len(self.shape)

    @property
    def cells(self) -> int:
        """Number of cells."""
        return int(np.prod([int(n) for n in self.shape], dtype=object))

    @property
    def upper(self) -> tuple[float, ...]:
        """Highest corner, m."""
        return tuple(o + n * self.resolution for o, n in zip(self.origin, self.shape, strict=True))

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """``(x_min, x_max, y_min, y_max)`` in m, as plots want it."""
        return self.origin[0], self.upper[0], self.origin[1], self.upper[1]

    def shares_raster(self, other: Grid) -> bool:
        """Whether the cells of both grids coincide where they overlap, and the frames are the same."""
        if (self.frame, self.resolution, self.dimension) != (other.frame, other.resolution, other.dimension):
            return False
        shift = (np.array(self.origin) - other.origin) / self.resolution
        return bool(np.abs(shift - np.round(shift)).max() < _ON_RASTER)

    def union(self, other: Grid) -> Grid:
        """Return the smallest grid on the common raster that covers both.

        Raises
        ------
        MapError
            If the two do not share a raster.
        """
        if not self.shares_raster(other):
            raise MapError(
                f"grids do not share a raster: {self.resolution} m in frame '{self.frame}' and "
                f"{other.resolution} m in frame '{other.frame}'; build both in one frame at one resolution"
            )
        low = np.minimum(self.origin, other.origin)
        cells = np.round((np.maximum(self.upper, other.upper) - low) / self.resolution)
        return Grid(tuple(low), self.resolution, tuple(int(n) for n in cells), self.frame)

    def window(self, inner: Grid) -> tuple[slice, ...]:
        """Slices of this grid's arrays that hold ``inner``.

        Raises
        ------
        MapError
            If ``inner`` does not share the raster, or does not lie within this grid.
        """
        if self.shares_raster(inner):
            start = np.round((np.array(inner.origin) - self.origin) / self.resolution)
            if (start >= 0).all() and (start + inner.shape <= self.shape).all():
                return tuple(slice(int(s), int(s) + n) for s, n in zip(start, inner.shape, strict=True))
        raise MapError(f"grid: {inner} is no part of {self}")

    def crop(self, low: npt.ArrayLike, high: npt.ArrayLike) -> Grid:
        """Return the part of this grid, on its raster, that covers a box.

        Parameters
        ----------
        low, high : array_like, shape (D,)
            Lowest and highest corner of the box, m; they may lie outside the grid, even at infinity.

        Raises
        ------
        MapError
            If these are no corners, or the box misses the grid.
        """
        corners = [np.asarray(corner, np.float64) for corner in (low, high)]
        if any(corner.shape != (self.dimension,) for corner in corners) or not (corners[0] <= corners[1]).all():
            raise MapError(
                f"region from {low!r} to {high!r}: expected two corners of {self.dimension} numbers, lower first"
            )
        lines = (np.stack(corners) - self.origin) / self.resolution
        with np.errstate(invalid="ignore"):
            lines = np.where(np.abs(lines - np.round(lines)) < _ON_RASTER, np.round(lines), lines)
        first = np.clip(np.floor(lines[0]), 0, self.shape)
        last = np.clip(np.maximum(np.ceil(lines[1]), np.floor(lines[0]) + 1), 0, self.shape)
        if not (first < last).all():
            raise MapError(f"region from {low!r} to {high!r}: misses the map, from {self.origin} to {self.upper} m")
        # An origin that is exactly a multiple of the resolution remains one.
        line = np.round(np.array(self.origin) / self.resolution)
        exact = line * self.resolution == self.origin
        origin = np.where(exact, (line + first) * self.resolution, self.origin + first * self.resolution)
        return Grid(tuple(origin), self.resolution, tuple(int(n) for n in last - first), self.frame)

    def index(self, points: npt.ArrayLike) -> npt.NDArray[np.int64]:
        """Cell indices (..., D) of points (..., D); they may lie outside the grid."""
        return np.floor((np.asarray(points, np.float64) - self.origin) / self.resolution).astype(np.int64)

    def contains(self, points: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Which points (..., D) lie in the grid."""
        index = self.index(points)
        return np.asarray(((index >= 0) & (index < self.shape)).all(-1))

    def centres(self, axis: int) -> Array:
        """Coordinates of cell centres along an axis, m."""
        return np.asarray(self.origin[axis] + (np.arange(self.shape[axis]) + 0.5) * self.resolution)
