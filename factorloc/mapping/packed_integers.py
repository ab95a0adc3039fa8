"""Packed integers: counts that are nearly all small, in the bytes that small ones need."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["PackedIntegers"]


@dataclass(frozen=True)
class PackedIntegers:
    """Whole numbers of at least 0, the few that are too large apart.

    Parameters
    ----------
    narrow : ndarray of unsigned int, shape (V,)
        Each number; 0 for those that are too large for the type.
    places : ndarray of int64, shape (W,)
        Where the large ones stand.
    wide : ndarray of int64, shape (W,)
        The large ones.
    """

    narrow: npt.NDArray[Any]
    places: npt.NDArray[np.int64]
    wide: npt.NDArray[np.int64]

    @classmethod
    def pack(cls, values: npt.ArrayLike, dtype: npt.DTypeLike) -> PackedIntegers:
        """Pack numbers into a narrow type."""
        numbers = np.asarray(values)
        large = numbers > np.iinfo(dtype).max
        places = np.flatnonzero(large)
        narrow = numbers.astype(dtype) if len(places) == 0 else np.where(large, 0, numbers).astype(dtype)
        return cls(narrow, places, numbers[places].astype(np.int64))

    def unpack(self, dtype: npt.DTypeLike) -> npt.NDArray[Any]:
        """Return all numbers in a type that is wide enough."""
        values = self.narrow.astype(dtype)
        values[self.places] = self.wide
        return values

    @property
    def nbytes(self) -> int:
        """Memory of the arrays."""
        return self.narrow.nbytes + self.places.nbytes + self.wide.nbytes
