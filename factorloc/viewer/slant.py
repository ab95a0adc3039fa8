"""Slant: a view of space at an angle, without perspective, over a floor with the axes of the world."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from factorloc.errors import ConfigError
from factorloc.viewer.style import FONT_SIZE, INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Slant"]

Array = npt.NDArray[np.float64]

_GRID = "#B0B0B0"
_TICK_GAP, _LABEL_GAP = 7.0, 24.0  # from the edge of the floor to the middle of a text, pt
_MARGIN = 0.01  # around the floor, as a fraction of the width


@dataclass(frozen=True)
class Slant:
    """A parallel projection: lengths in the plane of the picture are true, m.

    Parameters
    ----------
    azimuth : float
        Where it is seen from, counter-clockwise from the x axis, rad.
    elevation : float
        How high above the horizon it is seen from, rad; in (0, pi/2).
    area : (float, float, float, float)
        ``x_min, x_max, y_min, y_max`` of the floor, m.
    floor, top : float
        Heights that are to be seen, m.

    Raises
    ------
    ConfigError
        If the azimuth is not finite or the elevation out of its range.
    """

    azimuth: float
    elevation: float
    area: tuple[float, float, float, float]
    floor: float
    top: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.azimuth) and 0 < self.elevation < np.pi / 2):
            raise ConfigError(
                f"view from azimuth {self.azimuth}, elevation {self.elevation} rad; need an elevation in (0, pi/2)"
            )

    @cached_property
    def _axes(self) -> Array:
        """Right, up and away as seen in the picture: the rows of a rotation, shape (3, 3)."""
        (ca, sa), (ce, se) = ((np.cos(a), np.sin(a)) for a in (self.azimuth, self.elevation))
        return np.array([[-sa, ca, 0.0], [-ca * se, -sa * se, ce], [-ca * ce, -sa * ce, -se]])

    def project(self, points: Array) -> Array:
        """Places in the picture, right and up, m, of points (N, 3); shape (N, 2)."""
        return np.asarray(points @ self._axes[:2].T)

    def depth(self, points: Array) -> Array:
        """How far away points (N, 3) are, from the plane through the origin, m; shape (N,)."""
        return np.asarray(points @ self._axes[2])

    @cached_property
    def limits(self) -> tuple[float, float, float, float]:
        """Least and greatest place right, then up, of all that is to be seen, m."""
        x0, x1, y0, y1 = self.area
        corners = np.array(list(itertools.product((x0, x1), (y0, y1), (self.floor, self.top))))
        (u0, v0), (u1, v1) = (side(self.project(corners), axis=0) for side in (np.min, np.max))
        return float(u0), float(u1), float(v0), float(v1)

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the picture, m."""
        u0, u1, v0, v1 = self.limits
        return u1 - u0, v1 - v0

    def draw_floor(self, axes: Axes) -> None:
        """Draw the grid of the floor, with ticks and names of x and y along its edges in front, instead of a frame."""
        u0, u1, v0, v1 = self.limits
        margin = _MARGIN * (u1 - u0)
        axes.set(aspect="equal", xlim=(u0 - margin, u1 + margin), ylim=(v0 - margin, v1 + margin))
        axes.set_axis_off()
        sides = (self.area[:2], self.area[2:])
        step = _round_step(max(high - low for low, high in sides))
        for along, name in enumerate("xy"):
            low, high = sides[along]
            across = sides[1 - along]
            ticks = step * np.arange(np.ceil(low / step), np.floor(high / step) + 1)
            for value in (low, *ticks, high):
                line = self.project(np.array([self._on_floor(along, value, other) for other in across]))
                border = value in (low, high)
                axes.plot(*line.T, color=_GRID, linewidth=0.6, alpha=1.0 if border else 0.5, zorder=1)
            # Labels stand along the edge that is nearer to whoever looks.
            ends = np.array([self._on_floor(along, (low + high) / 2, other) for other in across])
            near = int(np.argmin(self.depth(ends)))
            middle, far = self.project(ends)[[near, 1 - near]]
            outwards = (middle - far) / np.linalg.norm(middle - far)
            places = self.project(np.array([self._on_floor(along, t, across[near]) for t in ticks]).reshape(-1, 3))
            # Texts are wider than high: beside a steep edge they need more room.
            room = 1.0 + 0.7 * abs(float(outwards[0]))
            for place, value in zip(places, ticks, strict=True):
                text = f"{value + 0.0:g}".replace("-", "\N{MINUS SIGN}")
                self._write(axes, text, place, _TICK_GAP * room * outwards, FONT_SIZE - 1)
            self._write(axes, f"{name} (m)", middle, _LABEL_GAP * room * outwards, FONT_SIZE)

    def _on_floor(self, along: int, value: float, other: float) -> tuple[float, float, float]:
        x, y = (value, other) if along == 0 else (other, value)
        return x, y, self.floor

    @staticmethod
    def _write(axes: Axes, text: str, place: Array, offset: Array, size: float) -> None:
        axes.annotate(
            text,
            (float(place[0]), float(place[1])),
            xytext=(float(offset[0]), float(offset[1])),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=size,
            color=INK,
        )


def _round_step(length: float) -> float:
    """Step of 1, 2 or 5 times a power of ten that divides a length into at most eight parts."""
    decade = 10.0 ** np.floor(np.log10(length))
    return float(min(step * decade for step in (0.2, 0.5, 1.0, 2.0) if length / (step * decade) <= 8))
