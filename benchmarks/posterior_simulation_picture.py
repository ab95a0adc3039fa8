"""Accuracy over the number of observations of a voxel, a panel a model (the form of figure 8.2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from benchmarks.corridor import ALGORITHMS, DECAY, MODELS, REFLECTION, TRUE
from factorloc.viewer.style import FONT_SIZE, INK, WIDTH, dress, line_style, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["accuracy_picture"]

_TITLES = {REFLECTION: "(a) reflection model", DECAY: "(b) decay-rate model"}
_APART = 1.025  # factor between the bars of two algorithms, which would else lie on each other


def accuracy_picture(figures: Mapping[str, tuple[float, str]], visits: Sequence[int]) -> Figure:
    """Draw the mean belief at the true pose; the bars are the variances over the runs, as published.

    Parameters
    ----------
    figures : mapping of str to (float, str)
        Values by ``model, n = visits, algorithm: figure``.
    visits : sequence of int
    """
    picture = new_figure(WIDTH, 3.2)
    for panel, model in zip(picture.subplots(1, 2), MODELS, strict=True):
        drawn = [name for name in ALGORITHMS if not (model == REFLECTION and name == TRUE)]
        for number, name in enumerate(drawn):
            rho, variance = (
                [figures[f"{model}, n = {n}, {name}: {what}"][0] for n in visits] for what in ("rho", "variance of rho")
            )
            label = f"{name} (the true one)" if model == REFLECTION and "uniform" in name else name
            apart = _APART ** (number - (len(drawn) - 1) / 2)
            panel.errorbar([apart * n for n in visits], rho, variance, **line_style(number), label=label, marker="o",
                           markersize=2.5, linewidth=1.1, elinewidth=0.7, capsize=1.5)  # fmt: skip
        panel.set_xscale("log")
        dress(panel, "n, observations of a voxel", r"$\rho$, mean belief at the true pose")
        panel.set_title(_TITLES[model], fontsize=FONT_SIZE, color=INK, loc="left")
        panel.legend(fontsize=FONT_SIZE - 1, labelcolor=INK, frameon=False, loc="lower right")
    return picture
