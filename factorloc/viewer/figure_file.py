"""Figure file: a figure written whole or not at all, the same bytes for the same figure."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from factorloc.errors import ConfigError
from factorloc.files import atomic_path

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["FIGURE_KINDS", "save_figure"]

# Without a date, equal figures are equal files.
_METADATA: dict[str, dict[str, Any]] = {".png": {}, ".pdf": {"CreationDate": None}, ".svg": {"Date": None}}

FIGURE_KINDS = tuple(_METADATA)
"""Endings that :func:`save_figure` writes."""


def save_figure(figure: Figure, path: Path | str, dpi: float = 150) -> None:
    """Write a figure as PNG, PDF or SVG, whichever the ending says.

    Parameters
    ----------
    figure : Figure
        What to write; white borders are trimmed.
    path : Path or str
        The file; its folder is created.
    dpi : float
        Pixels an inch of PNG, and of images inside PDF and SVG.

    Raises
    ------
    ConfigError
        If the ending is another one.
    FactorlocError
        If the file cannot be written; nothing is left behind.
    """
    import matplotlib

    path = Path(path)
    kind = path.suffix.lower()
    if kind not in _METADATA:
        raise ConfigError(f"{path}: '{kind}' is no kind of figure; end the name in {', '.join(FIGURE_KINDS)}")
    # Outlined fonts: publishers refuse the bitmap-like Type 3 that is matplotlib's default.
    with (
        atomic_path(path) as temporary,
        matplotlib.rc_context({"pdf.fonttype": 42, "svg.fonttype": "path", "svg.hashsalt": "factorloc"}),
    ):
        figure.savefig(
            temporary, format=kind[1:], dpi=dpi, bbox_inches="tight", pad_inches=0.05, metadata=_METADATA[kind]
        )
