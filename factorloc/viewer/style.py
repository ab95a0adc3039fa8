"""Style: colours that everybody can tell apart, and axes that stay behind the data.

Figures are built from :class:`matplotlib.figure.Figure` directly: no window system, no global state.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["FONT_SIZE", "INK", "OKABE_ITO", "WIDTH", "dress", "legend_above", "line_style", "new_figure"]

OKABE_ITO = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""The palette of Okabe and Ito (2008) in the order it is used, without black (:data:`INK`) and the yellow, which is
too light for lines on white."""

INK = "#1A1A1A"
"""Colour of text and of whatever others are compared with."""

WIDTH = 7.2
"""Width of a figure, inch: the text width of a two-column page."""

FONT_SIZE = 9.0
"""Size of labels, pt; ticks are a point smaller."""

_DASHES = ("-", (0, (5, 1.5)), (0, (1.2, 1.2)))
_GRID = "#B0B0B0"
_LETTER_WIDTH, _HANDLE_WIDTH = 0.075, 0.5  # of a legend entry, inch


def new_figure(width: float = WIDTH, height: float = 4.0, *, equal_aspect: bool = False) -> Figure:
    """Return an empty white figure, ``width`` by ``height`` inch, that arranges its axes by itself.

    With ``equal_aspect``, whatever stands beside axes of fixed proportions moves close to them.
    """
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="compressed" if equal_aspect else "constrained", facecolor="white")


def line_style(number: int) -> dict[str, Any]:
    """Colour and dashes of the line with this number, from 0; they repeat only after 18."""
    dashes = _DASHES[number // len(OKABE_ITO) % len(_DASHES)]
    return {"color": OKABE_ITO[number % len(OKABE_ITO)], "linestyle": dashes}


def dress(axes: Axes, xlabel: str = "", ylabel: str = "", *, frame: bool = False) -> None:
    """Label axes and put a light grid behind the data.

    Parameters
    ----------
    axes : Axes
        What to dress.
    xlabel, ylabel : str
        Quantities with their units.
    frame : bool
        Whether to close the box at the top and on the right, as for a map.
    """
    axes.set_facecolor("white")
    axes.set_xlabel(xlabel, fontsize=FONT_SIZE, color=INK)
    axes.set_ylabel(ylabel, fontsize=FONT_SIZE, color=INK)
    axes.tick_params(labelsize=FONT_SIZE - 1, colors=INK, color=_GRID, length=3, width=0.6)
    axes.grid(True, color=_GRID, alpha=0.35, linewidth=0.5)
    axes.set_axisbelow(True)
    for side, spine in axes.spines.items():
        spine.set(color=_GRID, linewidth=0.6, visible=frame or side in ("left", "bottom"))


def legend_above(axes: Axes) -> None:
    """Put the legend of ``axes`` above them, where it covers no data; none if nothing has a label."""
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        # As many columns as fit side by side, and no fewer in the last row than needed.
        entry = _HANDLE_WIDTH + _LETTER_WIDTH * max(map(len, labels))
        rows = -(-len(labels) // max(1, int(axes.figure.bbox.width / axes.figure.dpi / entry)))
        axes.legend(
            handles,
            labels,
            loc="lower center",
            bbox_to_anchor=(0.5, 1.0),
            ncols=-(-len(labels) // rows),
            fontsize=FONT_SIZE,
            labelcolor=INK,
            frameon=False,
            handlelength=1.8,
            columnspacing=1.6,
        )
