"""Line groups: the lines of a scan by facade, with the cores of their hulls, and what each of these weighs.

A line may be anywhere in its hull, but is more often in the core of it: where nearly as many points vote for it as for
the best. A pose that takes it out of the core costs a little, out of the hull the rest. With p the doubt of the line
and q that of its core, odds of hull and core, of hull without core, and of neither are ``1 - p - q : q : p``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from factorloc.localization.correspondence import Correspondence
from factorloc.localization.line_weights import PARTS, Weights, weights_of

__all__ = ["LineGroups", "core_of"]

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class LineGroups:
    """Lines of one scan, grouped.

    Parameters
    ----------
    lines : tuple of Correspondence
        K lines by facade, each with its hull; then those of them that have cores, with these.
    count : int
        K.
    facades : ndarray of int, shape (F,)
        Ascending.
    doubts : ndarray, shape (F,)
        Least doubts of their lines.
    groups : ndarray of int, shape (G + 1,)
        Where groups of lines begin, and their end: one a facade, then one a facade with cores. Of the lines of a group
        any will do.
    weights : ndarray of int, shape (G,)
        Of the groups; with both of its groups satisfied, a facade counts whole.
    """

    lines: tuple[Correspondence, ...]
    count: int
    facades: Rows
    doubts: Array
    groups: Rows
    weights: Weights

    @classmethod
    def of(cls, found: Sequence[Correspondence]) -> LineGroups:
        """Group lines; of one facade there may be several, found from parts of one start."""
        lines = tuple(sorted(found, key=lambda one: (one.facade, one.doubt)))
        facades, begin = np.unique(np.array([one.facade for one in lines], np.int64), return_index=True)
        doubts = np.array([lines[k].doubt for k in begin])
        cores = tuple(one for one in lines if one.core is not None)
        cored, at = np.unique(np.array([one.facade for one in cores], np.int64), return_index=True)
        which = np.searchsorted(facades, cored)
        whole, part = _parted(doubts[which], np.array([cores[k].core_doubt for k in at]))
        weights = weights_of(doubts)
        weights[which] = whole - part
        narrow = tuple(core_of(one) for one in cores)
        groups = np.concatenate([begin, len(lines) + at, [len(lines) + len(cores)]]).astype(np.int64)
        return cls((*lines, *narrow), len(lines), facades, doubts, groups, np.concatenate([weights, part]))

    @property
    def sources(self) -> Rows:
        """Facade of every line, shape (K and the cores,)."""
        return np.array([one.facade for one in self.lines], np.int64)


def _parted(doubts: Array, core_doubts: Array) -> tuple[Weights, Weights]:
    """Weights of facades, and what of them is that of the core, less than all."""
    inside = 1.0 - doubts - core_doubts
    whole = np.maximum(np.rint(PARTS * np.log(inside / doubts)), 1.0)
    part = np.clip(np.rint(PARTS * np.log(inside / core_doubts)), 0.0, whole - 1.0)
    return whole.astype(np.int32), part.astype(np.int32)


def core_of(line: Correspondence) -> Correspondence:
    """A line with the core of its hull for the hull; the line itself if it has none."""
    if line.core is None:
        return line
    alpha, d = line.core
    return replace(line, alpha=alpha, d=d)
