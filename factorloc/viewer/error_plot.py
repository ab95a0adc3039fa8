"""Error plot: translation and heading errors of several runs over time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Protocol

import numpy as np
import numpy.typing as npt

from factorloc.errors import GeometryError
from factorloc.viewer.style import INK, WIDTH, dress, legend_above, line_style, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["TimedErrors", "plot_errors_over_time"]

Array = npt.NDArray[np.float64]


class TimedErrors(Protocol):
    """What is drawn of a run: errors by time, such as ``factorloc.evaluation.AbsoluteErrors``."""

    @property
    def stamps(self) -> Array:
        """Times, s, shape (N,)."""

    @property
    def translation(self) -> Array:
        """Distance from the truth, m, shape (N,)."""

    @property
    def heading(self) -> Array:
        """Heading error, positive to the left, rad, shape (N,)."""


def plot_errors_over_time(runs: Mapping[str, TimedErrors]) -> Figure:
    """Draw translation errors in metres and heading errors in degrees, one line a run.

    Parameters
    ----------
    runs : mapping of str to TimedErrors
        Errors by name. Time begins at the earliest stamp of all; rows are drawn in the order of their stamps. The
        legend carries the root mean squares.

    Raises
    ------
    GeometryError
        If there are no runs, one is empty, or its arrays differ in length or are not finite.
    """
    if not runs:
        raise GeometryError("runs: none given; nothing can be drawn")
    tables = {name: _table(errors, name) for name, errors in runs.items()}
    begin = min(float(table[0, 0]) for table in tables.values())
    figure = new_figure(WIDTH, 4.4)
    upper, lower = figure.subplots(2, 1, sharex=True)
    lower.axhline(0, color=INK, linewidth=0.6, alpha=0.6, zorder=1)
    for number, (name, (stamps, translation, heading)) in enumerate((n, t.T) for n, t in tables.items()):
        rms = np.sqrt(np.mean(translation**2)), np.sqrt(np.mean(heading**2))
        style = {**line_style(number), "linewidth": 1.1, "zorder": 2}
        upper.plot(stamps - begin, translation, **style, label=f"{name} (RMSE {rms[0]:.3g} m, {rms[1]:.3g}°)")
        lower.plot(stamps - begin, heading, **style)
    end = max(float(table[-1, 0]) for table in tables.values()) - begin
    upper.set_xlim(0, end if end > 0 else 1.0)
    upper.set_ylim(bottom=0)
    reach = max(map(abs, lower.get_ylim()))
    lower.set_ylim(-reach, reach)
    dress(upper, ylabel="translation error (m)")
    dress(lower, "time (s)", "heading error (°)")
    upper.tick_params(labelbottom=False)
    figure.align_ylabels([upper, lower])
    legend_above(upper)
    return figure


def _table(errors: TimedErrors, name: str) -> Array:
    """Rows ``[stamp, translation, heading in degrees]`` by time."""
    columns = [np.asarray(column, np.float64) for column in (errors.stamps, errors.translation, errors.heading)]
    if any(column.shape != (columns[0].size,) for column in columns) or columns[0].size == 0:
        shapes = ", ".join(str(column.shape) for column in columns)
        raise GeometryError(f"{name}: stamps, translation, heading have shapes {shapes}; expected rows of equal length")
    table = np.column_stack([columns[0], columns[1], np.degrees(columns[2])])
    if not np.isfinite(table).all():
        raise GeometryError(f"{name}: a stamp or error is not finite")
    return table[np.argsort(table[:, 0], kind="stable")]
