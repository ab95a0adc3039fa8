"""Viewer: figures fit to print, from plain arrays and trajectories.

Every plot function returns a :class:`matplotlib.figure.Figure`; :func:`save_figure` writes it, and a :class:`Viewer`
does both in one call. No window is opened and no global state of matplotlib is touched.
"""

from factorloc.viewer.bounds_plot import plot_accumulator, plot_associated_points, plot_feasible_sets
from factorloc.viewer.cost_plot import plot_cost_history
from factorloc.viewer.error_plot import TimedErrors, plot_errors_over_time
from factorloc.viewer.facade_plot import draw_facade_map, plot_facade_map
from factorloc.viewer.figure_file import FIGURE_KINDS, save_figure
from factorloc.viewer.map_plots import plot_error_coloured_path, plot_map_and_trajectories
from factorloc.viewer.pole_plots import plot_pole_map
from factorloc.viewer.scan_plot import View, plot_scan
from factorloc.viewer.viewer import NullViewer, Viewer

__all__ = [
    "FIGURE_KINDS",
    "NullViewer",
    "TimedErrors",
    "View",
    "Viewer",
    "draw_facade_map",
    "plot_accumulator",
    "plot_associated_points",
    "plot_cost_history",
    "plot_error_coloured_path",
    "plot_errors_over_time",
    "plot_facade_map",
    "plot_feasible_sets",
    "plot_map_and_trajectories",
    "plot_pole_map",
    "plot_scan",
    "save_figure",
]
