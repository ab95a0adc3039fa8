"""Pole detection rates: how often the poles of a map are found in a second drive, and how much else is (12.4.3)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from factorloc.errors import MapError
from factorloc.geometry import se2
from factorloc.mapping.local_maps import LocalMap
from factorloc.mapping.pole_likelihood import clutter_density

__all__ = ["PoleDetectionRates"]

Array = npt.NDArray[np.float64]

_NODES = 40  # along each side of a local map, to tell how much of it lies near poles
_RIM = 0.5  # m; a pole on the rim of a local map is half in view
_NEAR = 0.5  # m; a pole counts as found by a detection so near, and not by whatever lies within the gate


@dataclass(frozen=True)
class PoleDetectionRates:
    """What a second drive says of a map of poles and of the detector.

    Parameters
    ----------
    matched, unmatched : int
        Detections with and without a pole of the map within the gate.
    gate : float
        m.
    chance : float
        Share of the local maps that lies within the gate of a pole: a detection of something else is matched so often.
    found, in_view : int
        Poles in view of local maps, and those of them that had a detection within half a metre.
    area : float
        Of all local maps together, m^2.
    """

    matched: int
    unmatched: int
    gate: float
    chance: float
    found: int
    in_view: int
    area: float

    @classmethod
    def of(cls, positions: npt.ArrayLike, local_maps: Iterable[LocalMap], gate: float = 2.7) -> PoleDetectionRates:
        """Compare the local maps of a drive, at its true poses, with a map that was made without it.

        Parameters
        ----------
        positions : array_like, shape (L, 2)
            Poles of the map, m.
        local_maps : iterable of LocalMap
            Of the second drive, in the frame of the map.
        gate : float
            A detection farther from all poles has none, m; that of the particle filter.

        Raises
        ------
        MapError
            If there are no poles or local maps, the gate is not positive, or no pole was in view.
        """
        poles = np.asarray(positions, np.float64).reshape(-1, 2)
        if len(poles) == 0 or not gate > 0:
            raise MapError(f"detection rates: {len(poles)} poles, gate {gate} m; a map with poles, and a length")
        tree = cKDTree(poles)
        matched = unmatched = found = in_view = nodes = near_nodes = 0
        area = 0.0
        for each in local_maps:
            detections = each.in_world.positions
            near = np.asarray(tree.query(detections, distance_upper_bound=gate)[0]) < np.inf
            matched, unmatched = matched + int(near.sum()), unmatched + int((~near).sum())
            here = poles[each.covers(poles, _RIM)]
            in_view += len(here)
            if len(detections) and len(here):
                found += int((np.asarray(cKDTree(detections).query(here)[0]) <= _NEAR).sum())
            places = _nodes(each)
            nodes += len(places)
            near_nodes += int((np.asarray(tree.query(places, distance_upper_bound=gate)[0]) < np.inf).sum())
            area += float(np.prod(each.corners[1] - each.corners[0]))
        if in_view == 0:
            raise MapError("detection rates: no pole of the map was in view; is the second drive in the map's frame?")
        return cls(matched, unmatched, gate, near_nodes / nodes, found, in_view, area)

    @property
    def others(self) -> float:
        """Number of detections that are not in the map: those without a pole, and as many more as have one by chance.

        At most all; all, where no place of the local maps is off the poles by the gate.
        """
        total = self.matched + self.unmatched
        return min(self.unmatched / (1 - self.chance), total) if self.chance < 1 else float(total)

    @property
    def epsilon(self) -> float:
        """Density of detections that are not in the map, for a particle filter with this gate, 1/m."""
        others = self.others
        return clutter_density(self.matched + self.unmatched - others, others, self.gate)

    @property
    def clutter(self) -> float:
        """Detections that are not in the map, 1/m^2, for :class:`~factorloc.factors.PoleMixture`; one is added."""
        return (self.others + 1) / self.area

    @property
    def found_rate(self) -> float:
        """Share of the poles in view that was found."""
        return self.found / self.in_view

    def __str__(self) -> str:
        """Return both rates, and what to set in a filter and in a smoother."""
        share = self.others / max(self.matched + self.unmatched, 1)
        return (
            f"{self.found_rate:.0%} of {self.in_view} poles in view found, {share:.0%} of "
            f"{self.matched + self.unmatched} detections not in the map: epsilon {self.epsilon:.3g} 1/m with a gate of "
            f"{self.gate:g} m, clutter {self.clutter:.2g} 1/m^2"
        )


def _nodes(each: LocalMap) -> Array:
    """Places evenly spread over a local map."""
    steps = (np.arange(_NODES) + 0.5) / _NODES
    low, size = each.corners[0], each.corners[1] - each.corners[0]
    grid = np.stack(np.meshgrid(*(low[:, None] + size[:, None] * steps), indexing="ij"), -1).reshape(-1, 2)
    return np.asarray(se2.transform(se2.compose(each.T_world_reference, each.T_reference_axes), grid))
