"""Bar charts of competitors: what each takes, how much that varies, and where its goal lies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from factorloc.viewer.style import FONT_SIZE, INK, OKABE_ITO, WIDTH, dress, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["Bar", "plot_bars", "plot_columns"]


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


def plot_columns(
    columns: Mapping[str, Mapping[str, Sequence[Bar]]], unit: str, note: str = "median, quartiles; dashed: goal"
) -> Figure:
    """Draw a column of panels a case and a row a group, each row on one scale; a competitor has one colour.

    Parameters
    ----------
    columns : mapping of str to mapping of str to sequence of Bar
        Groups of bars by case, then by title; every case has the same titles, and some bars of each may be missing.
    unit : str
        Of all values; empty if the labels say it.
    note : str
        What bars, strokes and dashes are.
    """
    titles = list(next(iter(columns.values())))
    labels = {
        title: list(dict.fromkeys(bar.label for groups in columns.values() for bar in groups[title]))
        for title in titles
    }
    every = list(dict.fromkeys(label for row in labels.values() for label in row))
    colours = {label: OKABE_ITO[number % len(OKABE_ITO)] for number, label in enumerate(every)}
    titles = [title for title in titles if labels[title]]
    heights = [len(labels[title]) for title in titles]
    figure = new_figure(WIDTH * max(1.0, 0.25 + 0.4 * len(columns)), 0.8 + 0.3 * sum(heights) + 0.45 * len(heights))
    panels = figure.subplots(
        len(titles), len(columns), sharex="row", sharey="row", squeeze=False, gridspec_kw={"height_ratios": heights}
    )
    for column, (case, groups) in enumerate(columns.items()):
        for axes, title in zip(panels[:, column], titles, strict=True):
            _draw(axes, groups[title], colours, unit, labels[title])
            axes.set_title(
                title if len(columns) == 1 else f"{case}: {title}", fontsize=FONT_SIZE, color=INK, loc="left"
            )
            dress(axes)
            axes.grid(False, axis="y")
        panels[-1, column].set_xlabel(f"{unit} ({note})".strip(), fontsize=FONT_SIZE, color=INK)
    return figure


def _draw(
    axes: Axes, bars: Sequence[Bar], colours: Mapping[str, str], unit: str, labels: Sequence[str] | None = None
) -> None:
    labels = labels or [bar.label for bar in bars]
    for bar in bars:
        row = labels.index(bar.label)
        axes.barh(row, bar.value, height=0.7, color=colours[bar.label], zorder=2)
        low, high = bar.spread
        axes.plot([low, high], [row, row], color=INK, linewidth=1.2, solid_capstyle="butt", zorder=3)
        if bar.bound is not None:
            axes.plot(
                [bar.bound] * 2, [row - 0.45, row + 0.45], color=INK, linewidth=1.2, linestyle=(0, (2, 1)), zorder=4
            )
        end = max(high, bar.value, bar.bound or 0.0)
        axes.annotate(
            f"{bar.value:.3g} {unit}".strip(),
            (end, row),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
            fontsize=FONT_SIZE - 1,
            color=INK,
        )
    axes.set_yticks(range(len(labels)), labels)
    axes.set_ylim(len(labels) - 0.5, -0.5)
    axes.set_xlim(left=0, auto=None)  # panels that share the scale widen it yet
    axes.margins(x=0.12)
