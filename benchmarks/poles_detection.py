"""How often poles of a map are missed, how often others are reported, and how far off positions are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from factorloc.mapping.local_maps import LocalMap
from factorloc.mapping.pole_map import PoleMap

__all__ = ["DetectionRates", "match"]

Array = npt.NDArray[np.float64]
Pairs = npt.NDArray[np.int64]


def match(found: Array, true: Array, reach: float) -> Pairs:
    """Match positions one to one, at most ``reach`` apart, as many as possible and then as near as possible; (P, 2)."""
    if len(found) == 0 or len(true) == 0:
        return np.empty((0, 2), np.int64)
    distances = cdist(found, true)
    rows, columns = linear_sum_assignment(np.where(distances < reach, distances, 1e3 * reach))
    near = distances[rows, columns] < reach
    return np.stack([rows[near], columns[near]], 1)


@dataclass(frozen=True)
class DetectionRates:
    """What local maps find of a map.

    Parameters
    ----------
    in_view, seen : int
        Poles of the map that local maps cover, and those of them that were found, over all local maps.
    detections, unmatched : int
        Poles found, and those of them that are not in the map.
    area : float
        Ground that the local maps cover, all together, m^2.
    offsets : ndarray, shape (N, 2)
        From poles of the map to what was found, m.
    """

    in_view: int
    seen: int
    detections: int
    unmatched: int
    area: float
    offsets: Array

    @classmethod
    def of(cls, maps: Sequence[LocalMap], reference: PoleMap, reach: float, margin: float) -> DetectionRates:
        """Compare local maps with a map in the same frame.

        Parameters
        ----------
        maps : sequence of LocalMap
            Local maps.
        reference : PoleMap
            What there is to find.
        reach : float
            Farthest a detection is from its pole, m.
        margin : float
            Poles nearer to the rim of a local map are not expected to be found in it, m.
        """
        in_view = seen = detections = unmatched = 0
        area, offsets = 0.0, [np.empty((0, 2))]
        for each in maps:
            found = each.in_world.positions
            expected = each.covers(reference.positions, margin)
            pairs = match(found, reference.positions, reach)
            in_view += int(expected.sum())
            seen += int(expected[pairs[:, 1]].sum())
            detections += len(found)
            unmatched += len(found) - len(pairs)
            area += float(np.prod(each.corners[1] - each.corners[0]))
            offsets.append(found[pairs[:, 0]] - reference.positions[pairs[:, 1]])
        return cls(in_view, seen, detections, unmatched, area, np.concatenate(offsets))

    @property
    def miss_rate(self) -> float:
        """Fraction of the poles in view that were not found."""
        return 1.0 - self.seen / self.in_view if self.in_view else np.nan

    @property
    def false_rate(self) -> float:
        """Detections that are not in the map, per m^2 of a local map."""
        return self.unmatched / self.area if self.area else np.nan

    @property
    def position_sigma(self) -> float:
        """Standard deviation of a position along one axis, m; that of the map counts in."""
        return float(np.sqrt(np.mean(self.offsets**2))) if len(self.offsets) else np.nan

    @property
    def robust_sigma(self) -> float:
        """The same from the median, which wrong matches do not move."""
        return float(1.4826 * np.median(np.abs(self.offsets))) if len(self.offsets) else np.nan
