"""A large map from above, beside the memory it took over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from factorloc.viewer.map_canvas import MapImage, draw_scale_bar
from factorloc.viewer.style import FONT_SIZE, INK, OKABE_ITO, WIDTH, dress, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["large_picture"]

Array = npt.NDArray[np.float64]


def large_picture(
    view: Array,
    extent: tuple[float, float, float, float],
    memory: Array,
    marks: Sequence[tuple[float, str]],
    bound: float,
) -> Figure:
    """Draw map and memory.

    Parameters
    ----------
    view : ndarray, shape (n_x, n_y)
        The map from above (:func:`factorloc.mapping.top_view.top_view`).
    extent : (float, float, float, float)
        Its borders, m.
    memory : ndarray, shape (N, 2)
        Times, s, and resident memory, bytes.
    marks : sequence of (float, str)
        When what began, s.
    bound : float
        The most memory, GB.
    """
    figure = new_figure(WIDTH * 1.5, WIDTH * 0.7)
    left, right = figure.subplots(1, 2, width_ratios=[1.1, 1.0])
    image = MapImage(view, extent)
    image.draw(left)
    x_0, x_1, y_0, y_1 = image.content()
    left.set(aspect="equal", xlim=(x_0, x_1), ylim=(y_0, y_1))
    dress(left, frame=True)
    left.grid(False)
    left.set(xticks=[], yticks=[])
    draw_scale_bar(left)
    right.plot(memory[:, 0], memory[:, 1] / 1e9, color=OKABE_ITO[0], linewidth=1.2)
    right.axhline(bound, color=INK, linewidth=1.2, linestyle=(0, (2, 1)))
    for at, name in marks:
        right.axvline(at, color=INK, linewidth=0.4, alpha=0.5)
        right.annotate(name, (at, 0.02), xycoords=("data", "axes fraction"), xytext=(2, 0), textcoords="offset points",
                       rotation=90, fontsize=FONT_SIZE - 2, color=INK, va="bottom")  # fmt: skip
    dress(right, "time (s)", "resident memory (GB; dashed: goal)")
    right.set_xlim(0, float(memory[-1, 0]))
    right.set_ylim(0, max(1.1 * bound, 1.05 * float(memory[:, 1].max()) / 1e9))
    return figure
