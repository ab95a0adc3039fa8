"""Viewer: draws figures into a folder; its null object draws none."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, ParamSpec

from factorloc.errors import ConfigError
from factorloc.viewer.figure_file import FIGURE_KINDS, save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["NullViewer", "Viewer"]

_log = logging.getLogger(__name__)

P = ParamSpec("P")


class Viewer:
    """Saves every figure it is asked for as a file of a folder.

    Parameters
    ----------
    folder : Path or str
        Where the figures go; created with the first one.
    kind : str
        Ending of the files: ``".png"``, ``".pdf"`` or ``".svg"``.
    dpi : float
        Pixels an inch.

    Raises
    ------
    ConfigError
        If the kind is another one.
    """

    def __init__(self, folder: Path | str, kind: str = ".png", dpi: float = 150) -> None:
        if kind not in FIGURE_KINDS:
            raise ConfigError(f"kind: '{kind}' is no kind of figure; choose from {', '.join(FIGURE_KINDS)}")
        self.folder = Path(folder)
        self.kind = kind
        self.dpi = dpi

    def draw(self, name: str, plot: Callable[P, Figure], *args: P.args, **kwargs: P.kwargs) -> Path | None:
        """Call ``plot(*args, **kwargs)`` and save what it returns.

        Parameters
        ----------
        name : str
            Name of the figure's file, without folder and ending.
        plot : callable
            A plot function of :mod:`factorloc.viewer`, or any other that returns a Figure.
        *args, **kwargs
            What to plot.

        Returns
        -------
        Path or None
            The file; None if nothing was drawn.

        Raises
        ------
        ConfigError
            If the name is empty or contains a folder.
        FactorlocError
            If the file cannot be written, and whatever ``plot`` raises.
        """
        if not name or Path(name).name != name:
            raise ConfigError(f"name: '{name}' is no name of a figure; leave out folders")
        path = self.folder / f"{name}{self.kind}"
        save_figure(plot(*args, **kwargs), path, self.dpi)
        _log.info("figure written: %s", path)
        return path


class NullViewer(Viewer):
    """Takes every request and draws nothing: the viewer of runs without pictures."""

    def __init__(self) -> None:
        super().__init__(Path())

    def draw(self, name: str, plot: Callable[P, Figure], *args: P.args, **kwargs: P.kwargs) -> None:
        """Do nothing; ``plot`` is not called."""
