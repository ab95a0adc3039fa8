"""Picture of the sensor models: held-out nats per ray, errors of the filters, and error over time (figure 8.3)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from benchmarks.filter_study import FilterSettings
from benchmarks.sensor_models_findings import COMPARED, FIGURE_MODELS, FILTERED, Findings
from factorloc.viewer.style import FONT_SIZE, INK, OKABE_ITO, WIDTH, dress, line_style, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["models_picture"]

_STYLES = {model: number for number, model in enumerate(dict.fromkeys((*COMPARED, *FILTERED)))}


def models_picture(found: Findings, filters: FilterSettings) -> Figure:
    """Draw what was measured; panels of parts that were left out stay away.

    Parameters
    ----------
    found : Findings
    filters : FilterSettings
    """
    curves = [scene for scene in found.scenes if found.curve(scene, FIGURE_MODELS[0]) is not None]
    studies = [
        study.name for study in filters.studies if found.errors(found.scenes[0], FILTERED[0], study.name) is not None
    ]
    weighed = found.held_out(found.scenes[0], COMPARED[0]) is not None
    rows = max(1, int(weighed) + len(studies) + int(bool(curves)))
    figure = new_figure(WIDTH * 1.3, 0.6 + 2.6 * rows)
    grid = figure.add_gridspec(rows, max(1, len(curves)))
    row = 0
    if weighed:
        axes = figure.add_subplot(grid[row, :])
        for model in COMPARED:
            values = [one.mean if (one := found.held_out(scene, model)) else np.nan for scene in found.scenes]
            _points(axes, model, values, np.zeros(len(values)))
        _finish(axes, found, "nat per ray", "held-out scans (more is better)")
        row += 1
    for study in studies:
        axes = figure.add_subplot(grid[row, :])
        for model in FILTERED:
            runs = [found.errors(scene, model, study) for scene in found.scenes]
            means = [np.nan if errors is None else errors.mean() for errors in runs]
            bars = [np.nan if errors is None else errors.std(ddof=1) / np.sqrt(len(errors)) for errors in runs]
            _points(axes, model, means, np.array(bars))
        axes.set_yscale("log")
        _finish(axes, found, "m", f"position error, {study} (bars: standard errors over the runs)")
        row += 1
    for column, scene in enumerate(curves):
        axes, count = figure.add_subplot(grid[row, column]), 0
        for model in FIGURE_MODELS:
            curve = found.curve(scene, model)
            assert curve is not None
            count = len(curve)
            axes.plot(curve.mean(0), label=model, linewidth=1.2, **line_style(_STYLES[model]))
        dress(axes, "scan", "position error, m" if column == 0 else "")
        axes.set_ylim(bottom=0)
        axes.set_title(f"{scene}, mean of {count} runs", fontsize=FONT_SIZE, color=INK, loc="left")
        axes.legend(fontsize=FONT_SIZE - 1, labelcolor=INK, frameon=False)
    return figure


def _points(axes: Axes, model: str, values: list[float], bars: np.ndarray) -> None:
    number = _STYLES[model]
    place = np.arange(len(values)) + 0.09 * (number - (len(_STYLES) - 1) / 2)
    color = OKABE_ITO[number] if number < len(OKABE_ITO) else INK
    marker = "os^Dvp<"[number % 7]
    axes.errorbar(place, values, bars, label=model, fmt=marker, markersize=4, elinewidth=0.8, color=color)


def _finish(axes: Axes, found: Findings, unit: str, title: str) -> None:
    dress(axes, "", unit)
    axes.set_xticks(range(len(found.scenes)), [scene.replace("-", "\n") for scene in found.scenes])
    axes.set_title(title, fontsize=FONT_SIZE, color=INK, loc="left")
    axes.legend(fontsize=FONT_SIZE - 1, labelcolor=INK, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
