"""Bar charts of competitors: what each takes, how much that varies, and where its goal lies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from factorloc.viewer.style import FONT_SIZE, INK, OKABE_ITO, WIDTH, dress, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["Bar", "plot_bars"]


@dataclass(frozen=True)
class Bar:
    """One competitor.

    Parameters
    ----------
    label : str
        Its name; a name has one colour in the whole figure.
    value : float
        Median.
    spread : (float, float)
        Lower and upper quartile.
    bound : float, optional
        The most it should take.
    """

    label: str
    value: float
    spread: tuple[float, float]
    bound: float | None = None


def plot_bars(groups: Mapping[str, Sequence[Bar]], unit: str, *, share: bool = True) -> Figure:
    """Draw one panel of horizontal bars a group.

    Parameters
    ----------
    groups : mapping of str to sequence of Bar
        Bars by the title of their panel, at least one each.
    unit : str
        Of all values.
    share : bool
        Whether all panels have one scale.
    """
    labels = list(dict.fromkeys(bar.label for bars in groups.values() for bar in bars))
    colours = {label: OKABE_ITO[number % len(OKABE_ITO)] for number, label in enumerate(labels)}
    heights = [len(bars) for bars in groups.values()]
    figure = new_figure(WIDTH, 0.6 + 0.3 * sum(heights) + 0.45 * len(heights))
    panels = figure.subplots(len(heights), 1, sharex=share, squeeze=False, gridspec_kw={"height_ratios": heights})
    for axes, (title, bars) in zip(panels[:, 0], groups.items(), strict=True):
        _draw(axes, bars, colours, unit)
        axes.set_title(title, fontsize=FONT_SIZE, color=INK, loc="left")
        dress(axes)
        axes.grid(False, axis="y")
    panels[-1, 0].set_xlabel(f"{unit} (median, quartiles; dashed: goal)", fontsize=FONT_SIZE, color=INK)
    return figure


def _draw(axes: Axes, bars: Sequence[Bar], colours: Mapping[str, str], unit: str) -> None:
    for row, bar in enumerate(bars):
        axes.barh(row, bar.value, height=0.7, color=colours[bar.label], zorder=2)
        low, high = bar.spread
        axes.plot([low, high], [row, row], color=INK, linewidth=1.2, solid_capstyle="butt", zorder=3)
        if bar.bound is not None:
            axes.plot(
                [bar.bound] * 2, [row - 0.45, row + 0.45], color=INK, linewidth=1.2, linestyle=(0, (2, 1)), zorder=4
            )
        end = max(high, bar.value, bar.bound or 0.0)
        axes.annotate(
            f"{bar.value:.3g} {unit}",
            (end, row),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
            fontsize=FONT_SIZE - 1,
            color=INK,
        )
    axes.set_yticks(range(len(bars)), [bar.label for bar in bars])
    axes.set_ylim(len(bars) - 0.5, -0.5)
    axes.set_xlim(left=0)
    axes.margins(x=0.12)
