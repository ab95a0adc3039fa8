"""Feasible sets: headings and positions that all correspondences allow, but for some that are doubtful enough.

For a slice of headings ``theta``, a correspondence with the line ``(alpha_l, d_l)`` about the anchor q of the scan and
the facade ``(alpha, d_m)`` about its centre c says

    alpha = alpha_l + theta,    n(alpha) . (t + R(theta) q - c) = d_m - d_l,

a strip of positions t: heading and strip belong together. Across it, along the
wall, some of the middle half of the supporters is between the ends of the row of walls in line with the facade: a
second strip. The ends of the facade itself would be too tight, as supporters are of its neighbours too, and so would be
the first and the last supporter.

Some correspondences are false. Each has a doubt p, and weighs ``log((1 - p) / p)``: if they are false independently of
each other, a pose at which the false ones are exactly those that fail has odds of ``exp(-weight of those)``. A line in
its hull but not in the core of it costs a part of its weight. The set is made of the poses of least such weight, as
many as hold all but a small part of these odds together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from factorloc.localization.correspondence import Correspondence
from factorloc.localization.feasible_layers import Layer, as_layers, hull_of_layers
from factorloc.localization.feasible_settings import FeasibleSettings
from factorloc.localization.line_weights import PARTS, likely_depth, surprising_weight, weights_of
from factorloc.localization.pose_cells import PoseCells
from factorloc.localization.wall_lines import WallLines
from factorloc.result import Bounds

__all__ = ["FeasibleSet", "intersect_correspondences", "intersect_pieces"]


@dataclass(frozen=True, eq=False)
class FeasibleSet:
    """What correspondences leave.

    Parameters
    ----------
    bounds : Bounds
        Orientation interval and convex polygons; without polygons, if the assumptions are violated.
    layers : tuple of Layer
        What a drive carries along: less probable poses too, each layer within the next.
    conflicts : tuple of int
        Facades whose correspondences fail where those that hold weigh most.
    correspondences : int
        Of how many facades there were some.
    piece : int
        In which piece of the start the poses are for which most speaks.
    """

    bounds: Bounds
    layers: tuple[Layer, ...]
    conflicts: tuple[int, ...]
    correspondences: int
    piece: int = 0

    @property
    def failed(self) -> int:
        """How many correspondences fail where most hold."""
        return len(self.conflicts)

    @property
    def violated(self) -> bool:
        """Whether no pose satisfies enough correspondences: assumptions are violated."""
        return not self.bounds.polygons


def intersect_correspondences(
    found: tuple[Correspondence, ...],
    walls: WallLines,
    start: Bounds | Sequence[Bounds] | Sequence[Layer],
    settings: FeasibleSettings | None = None,
    *,
    carried: bool = False,
) -> FeasibleSet:
    """Intersect correspondences over slices of headings and cells of positions, all but some doubtful ones.

    If the true pose was in the start, and the lightest correspondences that are false (line not in the hull, facade not
    the right one) weigh no more than those of the lightest pose that was kept, it is in the result.

    Parameters
    ----------
    found : tuple of Correspondence
        Of one scan.
    walls : WallLines
        The map.
    start : Bounds, or sequence of Bounds or Layer
        Where the body may be: a set, slices of one that may overlap, or layers; not empty.
    settings : FeasibleSettings, optional
        See there.
    carried : bool
        Whether the layers are wanted that a drive carries along; else there is one, of the poses that are reported.
    """
    return intersect_pieces([(found, as_layers(start))], walls, settings, carried=carried)


def intersect_pieces(
    pieces: Sequence[tuple[tuple[Correspondence, ...], Sequence[Layer]]],
    walls: WallLines,
    settings: FeasibleSettings | None = None,
    *,
    carried: bool = True,
) -> FeasibleSet:
    """Intersect what was found from the pieces of one start.

    Lines of all pieces are weighed in each of them, so that their poses can be compared: of a facade that was found
    from several, any line will do.

    Parameters
    ----------
    pieces : sequence of (tuple of Correspondence, sequence of Layer)
        What was found from each piece, and the piece.
    walls : WallLines
        The map.
    settings : FeasibleSettings, optional
        See there.
    carried : bool
        Whether the layers are wanted that a drive carries along; else there is one, of the poses that are reported.
    """
    settings = settings or FeasibleSettings()
    every = tuple(layer for _, layers in pieces for layer in layers)
    if not any(found for found, _ in pieces):
        single = len(every) == 1 and len(every[0].slices) == 1
        return FeasibleSet(every[0].slices[0] if single else hull_of_layers(every), every, (), 0)
    pool = tuple(one for found, _ in pieces for one in found)
    cells = [PoseCells(pool, walls, layers, settings) for _, layers in pieces]
    best = max(one.best for one in cells)
    lead = next(k for k, one in enumerate(cells) if one.best == best)
    first = cells[lead]
    lines = first.lines
    if first.failing > surprising_weight(weights_of(lines.doubts), lines.doubts, settings.surprise):
        nowhere = Bounds(hull_of_layers(every).orientation, ())
        return FeasibleSet(nowhere, (), first.conflicts, len(lines.facades), lead)
    level = best - likely_depth([one.odds(best) for one in cells], settings.confidence)
    kept = [bounds for one in cells if (bounds := one.bounds_above(level)) is not None]
    headings = np.array([one.orientation for one in kept])
    polygons = tuple(polygon for one in kept for polygon in one.polygons)
    bounds = Bounds((float(headings[:, 0].min()), float(headings[:, 1].max())), polygons)
    levels = [best - round(PARTS * most) for most in settings.layers] if carried else [level]
    costs = (0.0, *settings.layers)
    layers = tuple(
        Layer(cost, tuple(part for one in cells for part in one.slices_above(least)))
        for cost, least in zip(costs, levels, strict=False)
    )
    return FeasibleSet(bounds, layers, first.conflicts, len(lines.facades), lead)
