"""Cost plot: how an optimization went down, level by level."""

from __future__ import annotations

from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from factorloc.viewer.style import FONT_SIZE, INK, WIDTH, dress, line_style, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from factorloc.result import Iteration, Result

__all__ = ["plot_cost_history"]

_LOG_RATIO = 30.0  # costs that span more than this, and are positive, get a logarithmic axis


def plot_cost_history(result: Result) -> Figure:
    """Draw cost and damping of each accepted step; steps on the same blur of the map are joined.

    Parameters
    ----------
    result : Result
        Its history and why it stopped. Without iterations the figure only says so.
    """
    figure = new_figure(WIDTH, 4.0)
    if not result.history:
        axes = figure.add_subplot()
        axes.set_axis_off()
        text = f"no iterations\n{result.stop.value}"
        axes.text(0.5, 0.5, text, ha="center", va="center", fontsize=FONT_SIZE + 1, color=INK)
        return figure
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1])
    begin = 1
    for number, (level, steps) in enumerate(groupby(result.history, key=lambda step: step.level)):
        group = list(steps)
        _draw_level(upper, lower, group, begin, number, "map itself" if level == 0 else f"blur {level:g} m")
        begin += len(group)
    costs = np.array([step.cost for step in result.history])
    if costs.min() > 0 and costs.max() > _LOG_RATIO * costs.min():
        upper.set_yscale("log")
    if any(step.damping > 0 for step in result.history):
        lower.set_yscale("log")
    upper.set_title(result.stop.value, fontsize=FONT_SIZE, color=INK, loc="right")
    dress(upper, ylabel="cost")
    dress(lower, "iteration", "damping")
    upper.tick_params(labelbottom=False)
    upper.set_xlim(0.5, len(costs) + 0.5)
    lower.xaxis.get_major_locator().set_params(integer=True)
    figure.align_ylabels([upper, lower])
    upper.legend(fontsize=FONT_SIZE, labelcolor=INK, frameon=False, loc="upper right")
    return figure


def _draw_level(upper: Axes, lower: Axes, steps: list[Iteration], begin: int, number: int, label: str) -> None:
    x = np.arange(begin, begin + len(steps))
    style = {**line_style(number), "linewidth": 1.3, "marker": "o", "markersize": 3.5}
    upper.plot(x, [step.cost for step in steps], **style, label=label)
    lower.plot(x, [step.damping for step in steps], **style)
    if begin > 1:
        for axes in (upper, lower):
            axes.axvline(begin - 0.5, color=INK, linewidth=0.5, alpha=0.4, linestyle=(0, (4, 3)))
