"""Errors over scans, a panel a kind of runs, and the particles of one run without a guess."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from factorloc.localization import Particles
from factorloc.viewer.style import FONT_SIZE, INK, OKABE_ITO, WIDTH, dress, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from benchmarks.mcl_scenes import Office

__all__ = ["convergence_picture"]

_MOMENTS = (0, 1, 3, 10)  # scans whose particles are shown
_LEAST, _MOST = 1e-3, 40.0  # m; lower errors are drawn at the least
_ALL_DRAWN = 4000  # particles
_CONVERGED: dict[str, Any] = {"color": OKABE_ITO[0], "alpha": 0.35, "linewidth": 0.5, "zorder": 2}
_FAILED: dict[str, Any] = {"color": OKABE_ITO[1], "linewidth": 1.0, "zorder": 3}


class Errors(Protocol):
    """What of an outcome is drawn."""

    @property
    def position(self) -> npt.NDArray[np.float64]:
        """Errors, m."""
        ...

    @property
    def converged_at(self) -> int | None:
        """None if it did not."""
        ...


def convergence_picture(
    curves: Mapping[str, Sequence[Errors]],
    success: tuple[float, float],
    office: Office | None,
    cloud: Sequence[Particles],
) -> Figure:
    """Draw all runs, those that fail in another colour; below, particles over the map.

    Parameters
    ----------
    curves : mapping of str to sequence of Errors
        Outcomes by kind of runs.
    success : (float, float)
        What counts as near, m and deg.
    office : Office, optional
        Its map.
    cloud : sequence of Particles
        Of each scan of one run in the office; may be empty.
    """
    below = office is not None and len(cloud) > 0
    picture = new_figure(WIDTH * 1.4, 5.6 if below else 2.8)
    rows = picture.add_gridspec(2, 1, height_ratios=[1.1, 1]) if below else picture.add_gridspec(1, 1)
    panels = picture.add_subfigure(rows[0]).subplots(1, len(curves), squeeze=False, sharey=True)[0]
    for panel, (who, outcomes) in zip(panels, curves.items(), strict=True):
        for outcome in outcomes:
            style = _FAILED if outcome.converged_at is None else _CONVERGED
            panel.plot(np.maximum(outcome.position, _LEAST), **style)
        panel.axhline(success[0], color=INK, linewidth=0.7, linestyle=(0, (4, 2)))
        panel.set_yscale("log")
        panel.set_ylim(_LEAST, _MOST)
        dress(panel, "scan", "position error (m)" if panel is panels[0] else "")
        panel.set_title(who.replace(", ", "\n"), fontsize=FONT_SIZE, color=INK, loc="left")
    if below:
        assert office is not None
        moments = [moment for moment in _MOMENTS if moment < len(cloud)]
        lower = picture.add_subfigure(rows[1]).subplots(1, len(moments), squeeze=False)[0]
        for panel, moment in zip(lower, moments, strict=True):
            _draw_particles(panel, office, cloud[moment])
            panel.set_title(f"scan {moment}: {len(cloud[moment])} particles", fontsize=FONT_SIZE, color=INK, loc="left")
    return picture


def _draw_particles(panel: Axes, office: Office, particles: Particles) -> None:
    statistics, grid = office.statistics, office.statistics.grid
    (x, y), (width, height) = grid.origin, (n * grid.resolution for n in grid.shape)
    extent = (x, x + width, y, y + height)
    panel.imshow((statistics.hits > 0).T, origin="lower", extent=extent, cmap="Greys", vmax=1.6, interpolation="none")
    some = particles.positions[:: max(len(particles) // _ALL_DRAWN, 1)]
    panel.plot(*some.T, ",", color=OKABE_ITO[1], alpha=0.8)
    panel.set(xlim=(-0.5, office.size[0] + 0.5), ylim=(-0.5, office.size[1] + 0.5), aspect="equal")
    dress(panel, "x (m)", frame=True)
    panel.grid(False)
