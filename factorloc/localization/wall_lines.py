"""Wall lines: facades in intervals about their own midpoints, ready for localization."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import shapely

from factorloc.intervals import Box, Interval, cos_sin
from factorloc.localization._facade_kernels import see
from factorloc.mapping.facade_bounds import FacadeBounds
from factorloc.mapping.facades import Facades

__all__ = ["WallLines"]

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]

_CHAIN_TURN = np.radians(5.0)
_CHAIN_OFFSET = 1.0  # m
_CHAIN_GAP = 3.0  # m


@dataclass(frozen=True, eq=False)
class WallLines:
    """Facades, each with the line it is on, about the middle of the facade as mapped.

    ``n(alpha) . (m - centre) = d`` for the points m of the true wall. As the true middle is off by no more than the
    shift and the vertex error along each axis, ``d`` is as narrow as it can be, wherever the origin of the map lies: a
    distance from a far origin would grow by the lever times the width of alpha.

    Parameters
    ----------
    facades : Facades
        As mapped.
    """

    facades: Facades

    def __len__(self) -> int:
        return len(self.facades)

    @cached_property
    def centres(self) -> Array:
        """Middles as mapped, m, shape (F, 2)."""
        return np.ascontiguousarray(self.facades.segments.mean(1))

    @cached_property
    def along(self) -> Array:
        """Unit vectors from start to end, shape (F, 2)."""
        segments = self.facades.segments
        return np.asarray((segments[:, 1] - segments[:, 0]) / self.facades.lengths[:, None])

    @cached_property
    def normals(self) -> Array:
        """Unit vectors out of the buildings, as mapped, shape (F, 2)."""
        return np.stack([self.along[:, 1], -self.along[:, 0]], 1)

    @cached_property
    def _bounds(self) -> FacadeBounds:
        return FacadeBounds.of(self.facades)

    @property
    def alpha(self) -> Interval:
        """Directions of the normals, rad, shape (F,)."""
        return self._bounds.alpha

    @property
    def hull(self) -> Box:
        """Hulls of the ends, shift and all, m, batch (F,)."""
        return self._bounds.hull

    @cached_property
    def cos_sin(self) -> tuple[Interval, Interval]:
        """Of alpha."""
        return cos_sin(self.alpha)

    @cached_property
    def swing(self) -> Array:
        """Greatest ``|cos| + |sin|`` of alpha: what an error along each axis may do to a distance."""
        c, s = self.cos_sin
        return np.asarray((abs(c) + abs(s)).hi)

    @cached_property
    def vertex_d(self) -> Array:
        """Radius of d without the shift, m."""
        return np.nextafter(self.facades.vertex_errors * self.swing, np.inf)

    @cached_property
    def shift_d(self) -> Array:
        """What the shift adds to it, m."""
        return np.nextafter(self.facades.shifts * self.swing, np.inf)

    @cached_property
    def turn(self) -> Array:
        """Half widths of alpha, rad."""
        return 0.5 * self.alpha.width

    @cached_property
    def chains(self) -> Array:
        """Along its own direction and from its centre, where the walls in line with each one begin and end, m, (F, 2).

        Walls are in line that look the same way, within 5 degrees and 1 m, with gaps of up to 3 m: rows of houses.
        """
        return _chains(self.facades.segments, self.centres, self.along, self.facades.tree)

    def within(self, place: Box, reach: float) -> Rows:
        """Facades that may be within reach (m) of some point of a box, and turn their outer side to some, ascending."""
        radius = float(np.hypot(*(0.5 * place.width)))
        rows = self.facades.within(place.mid, reach + radius)
        errors = np.sqrt(2.0) * (self.facades.shifts + self.facades.vertex_errors)[rows]
        ahead = (self.normals[rows] * (place.mid - self.centres[rows])).sum(1)
        return np.asarray(rows[ahead > -(radius + errors)], np.int64)

    def shares_seen_from(self, place: Box, rows: Rows, reach: float) -> Array:
        """How much of some facades is seen from nine observers spread over a box, on average, (R,).

        Five points of each wall, moved out by 0.4 m, are looked for: mapped walls stand in the way.
        """
        x, y = place.mid
        radius = float(np.hypot(*(0.5 * place.width)))
        spread = [np.linspace(low, high, 3) for low, high in zip(place.lo, place.hi, strict=True)]
        observers = np.stack(np.meshgrid(*spread), -1).reshape(-1, 2)
        blockers = self.facades.tree.query(shapely.Point(x, y), predicate="dwithin", distance=reach + radius)
        shares = np.empty(len(rows))
        see(self.facades.segments, rows, np.sort(blockers).astype(np.int64), observers, 5, 0.4, shares)
        return shares


def _chains(segments: Array, centres: Array, along: Array, tree: shapely.STRtree) -> Array:
    normals = np.stack([along[:, 1], -along[:, 0]], 1)
    count = len(segments)
    pairs = tree.query(np.asarray(shapely.linestrings(segments)), predicate="dwithin", distance=_CHAIN_GAP)
    i, j = pairs[:, pairs[0] != pairs[1]]
    turned = (along[i] * along[j]).sum(1) > np.cos(_CHAIN_TURN)
    offset = np.abs(np.einsum("ped,pd->pe", segments[j] - centres[i][:, None], normals[i])).max(1) < _CHAIN_OFFSET
    i, j = i[turned & offset], j[turned & offset]
    # Neighbours in line hang together; a chain is what can be reached from a wall.
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    links = coo_matrix((np.ones(len(i)), (i, j)), (count, count))
    number, label = connected_components(links, directed=False)
    members = np.argsort(label, kind="stable")
    edges = np.searchsorted(label[members], np.arange(number + 1))
    chains = np.empty((count, 2))
    for k in range(number):
        rows = members[edges[k] : edges[k + 1]]
        ends = segments[rows].reshape(-1, 2)
        reached = (ends[None] - centres[rows][:, None]) @ along[rows][:, :, None]
        chains[rows, 0], chains[rows, 1] = reached.min((1, 2)), reached.max((1, 2))
    return chains
