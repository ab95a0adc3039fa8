"""Basins of convergence beside the time a registration takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from factorloc.viewer.style import FONT_SIZE, INK, OKABE_ITO, WIDTH, dress, line_style, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["basin_picture"]

_SUCCESS = "success from "


def basin_picture(figures: Mapping[str, tuple[float, str]], parts: Sequence[str]) -> Figure:
    """Draw a column a scene: the share that converged over the offset of the start, and times below.

    Parameters
    ----------
    figures : mapping of str to (float, str)
        Values and units by ``scene, competitor: figure``; those that begin with "success from" are the shares, %.
    parts : sequence of str
        Names of the times that add up to one registration, ms.
    """
    table: dict[str, dict[str, dict[str, float]]] = {}
    for name, (value, _) in figures.items():
        who, figure = name.split(": ", 1)
        scene, competitor = who.split(", ", 1)
        table.setdefault(scene, {}).setdefault(competitor, {})[figure] = value
    competitors = list(dict.fromkeys(name for rows in table.values() for name in rows))
    colours = {name: OKABE_ITO[number % len(OKABE_ITO)] for number, name in enumerate(competitors)}
    picture = new_figure(WIDTH * (0.6 + 0.5 * len(table)), 5.4)
    panels = picture.subplots(2, len(table), squeeze=False, sharey="row", height_ratios=[3, 2])
    for (scene, rows), (upper, lower) in zip(table.items(), panels.T, strict=True):
        for number, (name, values) in enumerate(rows.items()):
            reached = {key.removeprefix(_SUCCESS): share for key, share in values.items() if key.startswith(_SUCCESS)}
            style = {**line_style(number), "color": colours[name], "marker": "o", "markersize": 3.5}
            upper.plot([label.replace(", ", "\n") for label in reached], list(reached.values()), **style, label=name)
            left = 0.0
            for part, alpha in zip(parts, (0.45, 1.0), strict=True):
                lower.barh(name, values[part], left=left, height=0.7, color=colours[name], alpha=alpha, zorder=2)
                left += values[part]
        upper.set_title(scene, fontsize=FONT_SIZE, color=INK, loc="left")
        upper.set_ylim(-3, 103)
        dress(upper, "offset of the start")
        dress(lower, f"ms, median: {parts[0]} (light), {parts[1]}")
        lower.grid(False, axis="y")
    panels[0, 0].set_ylabel("converged (%)", fontsize=FONT_SIZE, color=INK)
    panels[1, 0].invert_yaxis()
    panels[0, 0].legend(fontsize=FONT_SIZE - 1, labelcolor=INK, frameon=False, loc="lower left")
    return picture
