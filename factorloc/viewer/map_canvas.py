"""Map canvas: axes in metres with the image of a map at the bottom, framed around what there is to see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from factorloc.errors import ConfigError, GeometryError
from factorloc.viewer.style import FONT_SIZE, INK, WIDTH, dress, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

__all__ = ["MapImage", "draw_scale_bar", "map_canvas"]

Array = npt.NDArray[np.float64]
Limits = tuple[float, float, float, float]

_MARGIN = 0.03  # white space around the content, as a fraction of its longer side
_MAX_HEIGHT = 8.0  # inch
_STRAY = 0.002  # fraction of cells that may lie outside the frame, on each side
_MAX_CELLS = 1000  # across the frame; finer ones are merged, so that thin walls do not fade
_UNKNOWN = "#F1F1F1"  # colour of cells without a value
_DARKEST = 0.8  # of the map's greys, so that lines stand out against walls


@dataclass(frozen=True)
class MapImage:
    """A raster over the plane.

    Parameters
    ----------
    values : ndarray, shape (X, Y)
        One value a cell, for instance the probability that a ray is reflected in it, ``1 - exp(-lambda * h)``. The
        first axis runs along x, the second along y. NaN is unknown.
    extent : (float, float, float, float)
        ``x_min, x_max, y_min, y_max`` of the outer cell borders, m.

    Raises
    ------
    GeometryError
        If the array is not two-dimensional, empty, without a finite value, or the extent is not increasing.
    """

    values: Array
    extent: Limits

    def __post_init__(self) -> None:
        values = np.asarray(self.values, np.float64)
        if values.ndim != 2 or values.size == 0:
            raise GeometryError(f"image: shape {values.shape}; expected (cells along x, cells along y)")
        if not np.isfinite(values).any():
            raise GeometryError("image: no cell is finite; nothing can be drawn")
        extent = np.asarray(self.extent, np.float64)
        if extent.shape != (4,) or not np.isfinite(extent).all() or extent[0] >= extent[1] or extent[2] >= extent[3]:
            raise GeometryError(f"extent: {self.extent}; expected x_min < x_max, y_min < y_max in metres")
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "extent", tuple(extent.tolist()))

    def content(self) -> Limits:
        """Limits of the cells that differ from the background, without strays; all cells if none does.

        The background is the median. Strays are the outermost 0.2 % on each side: echoes through windows.
        """
        finite = self.values[np.isfinite(self.values)]
        away = np.abs(self.values - np.median(finite))
        shown = away > 0.1 * np.nanmax(away) if np.nanmax(away) > 0 else np.isfinite(self.values)
        stray = _STRAY * np.count_nonzero(shown)
        x_min, x_max, y_min, y_max = self.extent
        limits: list[float] = []
        for axis, (low, high) in enumerate([(x_min, x_max), (y_min, y_max)]):
            cells = np.count_nonzero(shown, axis=1 - axis)
            rows = np.flatnonzero((np.cumsum(cells) > stray) & (np.cumsum(cells[::-1])[::-1] > stray))
            cell = (high - low) / self.values.shape[axis]
            limits += [low + float(rows[0]) * cell, low + float(rows[-1] + 1) * cell]
        return limits[0], limits[1], limits[2], limits[3]

    def draw(self, axes: Axes, colormap: str | None = None) -> AxesImage:
        """Draw it below everything else, after the limits of the axes have been set.

        Parameters
        ----------
        axes : Axes
            Where to.
        colormap : str, optional
            Name of a matplotlib colour map. Greys by default, which leave all colours to the lines: white for zero,
            dark for the largest value, and a light grey for the unknown.

        Raises
        ------
        ConfigError
            If there is no such colour map.
        """
        from matplotlib import colormaps
        from matplotlib.colors import ListedColormap

        if colormap is not None and colormap not in colormaps:
            raise ConfigError(f"colormap: '{colormap}' is unknown to matplotlib; take 'viridis' or 'cividis'")
        greys = ListedColormap(colormaps["Greys"](np.linspace(0, _DARKEST, 256))).with_extremes(bad=_UNKNOWN)
        chosen = greys if colormap is None else colormaps[colormap]
        low, high = axes.get_xlim()
        shown = self.values.shape[0] * (high - low) / (self.extent[1] - self.extent[0])
        size = max(1, int(np.ceil(shown / _MAX_CELLS)))
        return axes.imshow(
            np.ma.masked_invalid(self._merged(size).T),
            extent=self._padded_extent(size),
            origin="lower",
            cmap=chosen,
            interpolation="antialiased",
            interpolation_stage="data",
            zorder=0,
        )

    def _merged(self, size: int) -> Array:
        """The largest value of each block of ``size`` by ``size`` cells."""
        if size == 1:
            return self.values
        padding = [(0, -n % size) for n in self.values.shape]
        padded = np.pad(self.values, padding, mode="constant", constant_values=np.nan)
        blocks = padded.reshape(padded.shape[0] // size, size, padded.shape[1] // size, size)
        return np.asarray(np.fmax.reduce(np.fmax.reduce(blocks, axis=3), axis=1))

    def _padded_extent(self, size: int) -> Limits:
        """Extent of the blocks, of which the last ones may reach beyond the cells."""
        (x_min, x_max, y_min, y_max), (columns, rows) = self.extent, self.values.shape
        x_max += (-columns % size) * (x_max - x_min) / columns
        y_max += (-rows % size) * (y_max - y_min) / rows
        return x_min, x_max, y_min, y_max


def map_canvas(
    image: MapImage | None,
    paths: Sequence[Array],
    *,
    crop: bool = True,
    scale_bar: bool = False,
    colormap: str | None = None,
) -> tuple[Figure, Axes, AxesImage | None]:
    """Return a figure of fitting shape with equal axes in metres, the map drawn.

    Parameters
    ----------
    image : MapImage, optional
        The map; None for white ground.
    paths : sequence of ndarray, each of shape (N, 2)
        What is going to be drawn, m: the frame encloses it.
    crop : bool
        Whether to frame only the content of the map (and the paths) instead of its whole extent.
    scale_bar : bool
        Whether a scale bar takes the place of ticks and labels.
    colormap : str, optional
        Colour map of the image.
    """
    boxes = [(*path.min(0), *path.max(0)) for path in paths]
    if image is not None:
        x_min, x_max, y_min, y_max = image.content() if crop else image.extent
        boxes.append((x_min, y_min, x_max, y_max))
    corners = np.array(boxes)
    low, high = corners[:, :2].min(0), corners[:, 2:].max(0)
    if crop or image is None:
        margin = _MARGIN * max(float((high - low).max()), 1.0)
        low, high = low - margin, high + margin
    size = high - low
    shape = float(size[1] / size[0])
    width = min(WIDTH, max(3.5, _MAX_HEIGHT / shape))
    figure = new_figure(width, min(_MAX_HEIGHT, max(2.0, width * shape + 0.8)), equal_aspect=True)
    axes = figure.add_subplot()
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    drawn = None if image is None else image.draw(axes, colormap)
    axes.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    dress(axes, "x (m)", "y (m)", frame=True)
    axes.ticklabel_format(useOffset=False, style="plain")
    if scale_bar:
        axes.grid(False)
        axes.set(xticks=[], yticks=[], xlabel="", ylabel="")
        draw_scale_bar(axes)
    return figure, axes, drawn


def draw_scale_bar(axes: Axes) -> None:
    """Draw a bar of a round length, about a fifth of the longer side, into the lower left corner of axes in metres."""
    x_min, x_max = axes.get_xlim()
    y_min, width = axes.get_ylim()[0], x_max - x_min
    wanted = min(0.5 * width, 0.2 * max(width, axes.get_ylim()[1] - y_min))
    decade = 10.0 ** np.floor(np.log10(wanted))
    length = max(step * decade for step in (1, 2, 5) if step * decade <= wanted)
    inset = 0.04 * width
    x, y = x_min + inset, y_min + inset
    box = {"boxstyle": "round,pad=0.25", "facecolor": "white", "edgecolor": "none", "alpha": 0.8}
    for colour, thickness, zorder in (("white", 6, 5.9), (INK, 3, 6)):
        axes.plot([x, x + length], [y, y], color=colour, linewidth=thickness, solid_capstyle="butt", zorder=zorder)
    axes.annotate(
        f"{length:g} m",
        (x, y),
        xytext=(2, 6),
        textcoords="offset points",
        ha="left",
        va="bottom",
        fontsize=FONT_SIZE,
        color=INK,
        bbox=box,
        zorder=6,
    )
