"""Poles: upright landmarks in the plane, found in one local map or kept in a map of a whole town."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.errors import MapError
from factorloc.geometry import se2

__all__ = ["Poles"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Poles:
    """Posts, lamps, trunks and whatever else stands upright and free.

    Parameters
    ----------
    positions : (N, 2) array_like
        Axes, m, in the frame of the map they belong to.
    widths : (N,) array_like
        Diameters, m.
    spans : (N, 2) array_like
        Lowest and highest height at which each was seen, m, in the same frame.
    scores : (N,) array_like
        How sure the detector was; its own scale, greater is surer.

    Raises
    ------
    MapError
        If the shapes do not match, a value is not finite, a width is not positive or a span ends below its start.
    """

    positions: Array
    widths: Array
    spans: Array
    scores: Array

    def __post_init__(self) -> None:
        shapes = {"positions": (-1, 2), "widths": (-1,), "spans": (-1, 2), "scores": (-1,)}
        for name, shape in shapes.items():
            values = np.asarray(getattr(self, name), np.float64)
            if values.size == 0:
                values = values.reshape(tuple(0 if n < 0 else n for n in shape))
            if values.ndim != len(shape) or values.shape[1:] != shape[1:]:
                raise MapError(f"poles: {name} has shape {values.shape}; give one row for each pole")
            if not np.isfinite(values).all():
                raise MapError(f"poles: {name} has values that are not finite; leave those poles out")
            object.__setattr__(self, name, np.ascontiguousarray(values))
        counts = {name: len(getattr(self, name)) for name in shapes}
        if len(set(counts.values())) > 1:
            raise MapError(f"poles: counts differ ({counts}); give one row for each pole")
        if (self.widths <= 0.0).any():
            raise MapError("poles: widths must be positive, in m")
        if (self.spans[:, 0] > self.spans[:, 1]).any():
            raise MapError("poles: each span must name its lowest height first")

    def __len__(self) -> int:
        return len(self.widths)

    @classmethod
    def none(cls) -> Poles:
        """No poles at all."""
        return cls(np.empty((0, 2)), np.empty(0), np.empty((0, 2)), np.empty(0))

    @classmethod
    def joined(cls, parts: Sequence[Poles]) -> Poles:
        """All poles of several sets, in their order; nothing is merged."""
        if not parts:
            return cls.none()
        names = ("positions", "widths", "spans", "scores")
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    def select(self, which: npt.ArrayLike | slice) -> Poles:
        """Poles named by a mask, a slice or indices."""
        if isinstance(which, slice):
            return Poles(self.positions[which], self.widths[which], self.spans[which], self.scores[which])
        rows = np.asarray(which) if np.size(which) else np.empty(0, np.int64)
        return Poles(self.positions[rows], self.widths[rows], self.spans[rows], self.scores[rows])

    def transformed(self, T_map_body: npt.ArrayLike) -> Poles:
        """The same poles in another planar frame; heights stay.

        Parameters
        ----------
        T_map_body : (3,) array_like
            Pose (x, y, yaw) of the present frame in the other, m and rad.
        """
        return Poles(se2.transform(T_map_body, self.positions), self.widths, self.spans, self.scores)
