"""Frontage: one side of a street between two corners, and the row of houses behind it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import numpy.typing as npt
import shapely
from pydantic import AfterValidator, Field

from factorloc.config import Block
from factorloc.simulation.facades import FacadeSettings

__all__ = ["Frontage", "Plot", "RowSettings"]

Array = npt.NDArray[np.float64]

_PARTY_GAP = 0.01  # m between neighbouring houses: no two walls in one plane
_CORNER_GAP = 0.5  # m between the rows of two streets
_NARROWEST = 6.0  # m; what is left of a row goes to the last house if it is less


def _ordered(limits: tuple[float, float]) -> tuple[float, float]:
    if not 0 < limits[0] <= limits[1]:
        raise ValueError("least and greatest must be positive and in order")
    return limits


Limits = Annotated[tuple[float, float], AfterValidator(_ordered)]


class RowSettings(Block):
    """How houses line a street; lengths in m.

    Parameters
    ----------
    house_width : (float, float)
        Least and greatest width.
    house_depth : float
        From the building line to the back.
    storeys : (float, float)
        Least and greatest number of storeys.
    setback_share, setback : float
        Share of houses that stand back from the building line, and by how much at most.
    recess_share, recess_depth : float
        Share of houses with a recessed middle, and its depth.
    gap_share, gap_width : float
        Share of houses followed by an open gap, and its width.
    facade : FacadeSettings
        How facades are built; single houses differ from it by some percent.
    """

    house_width: Limits = (10.0, 18.0)
    house_depth: float = Field(11.0, gt=4)
    storeys: Limits = (3, 5)
    setback_share: float = Field(0.35, ge=0, le=1)
    setback: float = Field(1.2, ge=0, le=1.5)
    recess_share: float = Field(0.35, ge=0, le=1)
    recess_depth: float = Field(1.0, gt=0, le=1.2)
    gap_share: float = Field(0.12, ge=0, le=1)
    gap_width: float = Field(3.0, gt=0.5)
    facade: FacadeSettings = FacadeSettings()


@dataclass(frozen=True)
class Plot:
    """Room for a house, or a gap.

    Parameters
    ----------
    outline : shapely.Polygon
        Footprint of the house; of a gap, its front metre.
    storeys : int
        Storeys of the house, 0 for a gap.
    """

    outline: shapely.Polygon
    storeys: int


@dataclass(frozen=True)
class Frontage:
    """A building line: going along it, the houses are on the left and the street is on the right.

    Parameters
    ----------
    start : (float, float)
        Where it begins, m.
    heading : float
        Its direction, rad.
    length : float
        How far it reaches, m.
    cut : (bool, bool)
        Whether the row of another street takes the corner at its start and end.
    street : tuple of two (int, int), optional
        Crossings between which it lies; none at the end of a street.
    """

    start: tuple[float, float]
    heading: float
    length: float
    cut: tuple[bool, bool] = (False, False)
    street: tuple[tuple[int, int], tuple[int, int]] | None = None

    @property
    def outwards(self) -> Array:
        """Unit vector towards the street, shape (2,)."""
        return np.array([np.sin(self.heading), -np.cos(self.heading)])

    def points(self, along: npt.ArrayLike, out: npt.ArrayLike) -> Array:
        """Points at distances along it (...) and in front of it (...), m, shape (..., 2)."""
        s, o = np.broadcast_arrays(np.asarray(along, np.float64), np.asarray(out, np.float64))
        ahead = np.array([np.cos(self.heading), np.sin(self.heading)])
        points: Array = np.array(self.start) + s[..., None] * ahead + o[..., None] * self.outwards
        return points

    def outline(self, corners: npt.ArrayLike) -> shapely.Polygon:
        """Polygon of corners (N, 2) given along it and in front of it, m."""
        along, out = np.asarray(corners, np.float64).T
        return shapely.Polygon(self.points(along, out))

    def rectangle(self, first: float, last: float, near: float, far: float) -> shapely.Polygon:
        """Rectangle between two distances along it and two in front of it, m."""
        return self.outline([(first, near), (first, far), (last, far), (last, near)])

    def plots(self, settings: RowSettings, rng: np.random.Generator) -> tuple[Plot, ...]:
        """Divide it into houses and gaps."""
        inset = settings.house_depth + _CORNER_GAP
        s, end = (inset if self.cut[0] else 0.0), self.length - (inset if self.cut[1] else 0.0)
        plots: list[Plot] = []
        while end - s > _NARROWEST:
            width = float(rng.uniform(*settings.house_width))
            if end - s - width < _NARROWEST + settings.gap_width:
                width = end - s
            plots.append(Plot(self._house(s, s + width - _PARTY_GAP, settings, rng), _storeys(settings, rng)))
            s += width
            if rng.random() < settings.gap_share and end - s > _NARROWEST + settings.gap_width:
                plots.append(Plot(self.rectangle(s, s + settings.gap_width, -1.0, 0.0), 0))
                s += settings.gap_width
        return tuple(plots)

    def _house(self, a: float, b: float, settings: RowSettings, rng: np.random.Generator) -> shapely.Polygon:
        stands_back, is_recessed = rng.random(2) < (settings.setback_share, settings.recess_share)
        front = -float(rng.uniform(0.3, 1.0)) * settings.setback if stands_back else 0.0
        back = -settings.house_depth
        if not is_recessed:
            return self.rectangle(a, b, back, front)
        left, right = a + (b - a) * float(rng.uniform(0.3, 0.4)), a + (b - a) * float(rng.uniform(0.6, 0.7))
        inner = front - settings.recess_depth
        sides = [(left, front), (left, inner), (right, inner), (right, front)]
        return self.outline([(a, back), (a, front), *sides, (b, front), (b, back)])


def _storeys(settings: RowSettings, rng: np.random.Generator) -> int:
    low, high = settings.storeys
    return int(rng.integers(round(low), round(high) + 1))
