"""BuildingOutlines: what a file says of the buildings of a place, in a local metric frame."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import shapely

from factorloc.errors import MapError
from factorloc.mapping.local_frame import LocalFrame

__all__ = ["BuildingOutlines", "Outline"]

_INSIDE = 0.9
"""Share of its area by which an outline lies in another one that makes it a part of that."""


@dataclass(frozen=True)
class Outline:
    """Outline of one building, or of a part of one, along its outer walls.

    Parameters
    ----------
    polygon : shapely.Polygon
        In the local frame, m; may have courtyards.
    height : float, optional
        Height of the roof above the ground, m, if the file tells.
    name : str
        What the file calls it.
    is_part : bool
        Whether the file calls it a part of a building.
    """

    polygon: shapely.Polygon
    height: float | None = None
    name: str = ""
    is_part: bool = False

    def __post_init__(self) -> None:
        shape = self.polygon
        if not isinstance(shape, shapely.Polygon) or shape.is_empty or not shape.is_valid:
            raise MapError(f"outline {self.name!r}: no valid polygon; mend it with shapely.make_valid")
        if not np.isfinite(shapely.get_coordinates(shape)).all():
            raise MapError(f"outline {self.name!r}: coordinates are not finite; leave it out")
        if self.height is not None and not 0 < self.height < math.inf:
            raise MapError(f"outline {self.name!r}: height {self.height} m; must be positive and finite")


@dataclass(frozen=True)
class BuildingOutlines:
    """Outlines of all buildings of a file or a place, and the account of what became of the rest.

    Parameters
    ----------
    outlines : tuple of Outline
        x east and y north of the origin, m.
    frame : LocalFrame, optional
        Where the frame lies on earth; None for places that are not on earth.
    attribution : str
        Whom every picture and report has to name; empty if nobody.
    source : str
        What was read.
    left_out : mapping of str to int
        What was not used, by reason.
    mended : mapping of str to int
        What was used otherwise than written, by what was done.
    notes : tuple of str
        Assumptions made where the file is silent.
    """

    outlines: tuple[Outline, ...]
    frame: LocalFrame | None = None
    attribution: str = ""
    source: str = ""
    left_out: Mapping[str, int] = field(default_factory=dict)
    mended: Mapping[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.outlines)

    def __str__(self) -> str:
        found = f"{self.source or 'outlines'}: {len(self)} buildings"
        counts = [f"left out {n} {reason}" for reason, n in self.left_out.items() if n]
        counts += [f"{deed} {n}" for deed, n in self.mended.items() if n]
        return "; ".join([found, *counts, *self.notes, *([self.attribution] if self.attribution else [])])

    def whole(self) -> BuildingOutlines:
        """Leave out what is drawn twice: copies, and whatever lies inside another building, as most parts do.

        What a part knows of its height goes to the building around it, if that does not know; the tallest one counts.
        """
        polygons = [outline.polygon for outline in self.outlines]
        # Large ones first, buildings before parts: each is compared with what is kept already.
        ranks = sorted(range(len(self)), key=lambda k: (self.outlines[k].is_part, -polygons[k].area))
        inner, outer = shapely.STRtree(polygons).query(np.array(polygons, dtype=object), predicate="intersects")
        around: dict[int, list[int]] = {}
        for a, b in zip(inner.tolist(), outer.tolist(), strict=True):
            around.setdefault(a, []).append(b)
        kept: set[int] = set()
        heights: dict[int, float] = {}
        counts = {"drawn twice": 0, "inside another building": 0}
        for k in ranks:
            rivals = [n for n in around.get(k, []) if n in kept]
            shares = [polygons[k].intersection(polygons[n]).area / polygons[k].area for n in rivals]
            host = rivals[int(np.argmax(shares))] if rivals and max(shares) > _INSIDE else None
            if host is None:
                kept.add(k)
                continue
            if (height := self.outlines[k].height) is not None:
                heights[host] = max(heights.get(host, 0.0), height)
            same = polygons[k].area > _INSIDE * polygons[host].area
            counts["drawn twice" if same else "inside another building"] += 1
        outlines = []
        for k, outline in enumerate(self.outlines):
            if k in kept:
                height = outline.height if outline.height is not None else heights.get(k)
                outlines.append(Outline(outline.polygon, height, outline.name, outline.is_part))
        left_out = dict(self.left_out)
        for reason, count in counts.items():
            if count:
                left_out[reason] = left_out.get(reason, 0) + count
        return BuildingOutlines(
            tuple(outlines), self.frame, self.attribution, self.source, left_out, self.mended, self.notes
        )
