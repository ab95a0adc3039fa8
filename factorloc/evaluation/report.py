"""Report: every metric of one run, as JSON for programs and as a table for people."""

from __future__ import annotations

import io
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from factorloc.evaluation.absolute import absolute_errors
from factorloc.evaluation.association import MAX_STAMP_DIFFERENCE, associate
from factorloc.evaluation.consistency import nees
from factorloc.evaluation.relative import StepUnit, relative_errors
from factorloc.evaluation.statistics import ErrorStatistics
from factorloc.files import write_text
from factorloc.trajectory import Trajectory

if TYPE_CHECKING:
    from rich.table import Table

__all__ = ["Report", "evaluate"]

_COLUMNS = {"rmse": "RMSE", "mean": "mean", "median": "median", "std": "std", "percentile_95": "95 %", "max": "max"}


@dataclass(frozen=True)
class Report:
    """Statistics of all metrics of a run, and how many poses they rest on.

    Parameters
    ----------
    metrics : dict of str to ErrorStatistics
        By name, such as ``"absolute translation"``; angles in radians.
    counts : dict of str to int
        Poses compared and left out.
    """

    metrics: dict[str, ErrorStatistics]
    counts: dict[str, int] = field(default_factory=dict)

    def to_json(self) -> str:
        """Return one JSON object with ``metrics`` (figures in SI units) and ``counts``."""
        metrics = {name: statistics.to_dict() for name, statistics in self.metrics.items()}
        return json.dumps({"metrics": metrics, "counts": self.counts}, indent=2, allow_nan=False) + "\n"

    def write_json(self, path: Path | str) -> None:
        """Write :meth:`to_json` to a file, whole or not at all.

        Raises
        ------
        FactorlocError
            If the file cannot be written.
        """
        write_text(path, self.to_json())

    def table(self, title: str | None = None) -> Table:
        """Return a table for the terminal; angles in degrees."""
        from rich.box import SIMPLE_HEAD
        from rich.table import Table
        from rich.text import Text

        caption = ", ".join(f"{count} {name}" for name, count in self.counts.items())
        # Text, so that brackets in a name are not taken for markup.
        table = Table(
            title=None if title is None else Text(title),
            caption=caption or None,
            box=SIMPLE_HEAD,
            pad_edge=False,
            padding=(0, 0),  # 80 columns hold it
        )
        table.title_justify = table.caption_justify = "left"
        table.add_column("metric", no_wrap=True)
        table.add_column("unit", no_wrap=True)
        for header in _COLUMNS.values():
            table.add_column(header, justify="right", no_wrap=True, min_width=7)
        for name, statistics in self.metrics.items():
            shown = statistics.in_degrees()
            figures = (f"{getattr(shown, column):.4f}" for column in _COLUMNS)
            table.add_row(Text(name), "" if shown.unit == "1" else shown.unit, *figures)
        return table

    def to_text(self, title: str | None = None) -> str:
        """Return :meth:`table` as plain text."""
        from rich.console import Console

        stream = io.StringIO()
        Console(file=stream, width=120, color_system=None).print(self.table(title))
        return "\n".join(line.rstrip() for line in stream.getvalue().splitlines()) + "\n"


def evaluate(
    estimate: Trajectory,
    truth: Trajectory,
    *,
    align: bool = False,
    delta: float = 1,
    unit: StepUnit = "frames",
    all_pairs: bool = False,
    max_difference: float = MAX_STAMP_DIFFERENCE,
) -> Report:
    """Associate two trajectories and compute every metric.

    Parameters
    ----------
    estimate, truth : Trajectory
        What to compare; matched by stamps.
    align : bool
        Whether to lay the estimate onto the truth for the absolute errors.
    delta, unit, all_pairs
        Steps of the relative errors, see :func:`factorloc.evaluation.relative.step_pairs`.
    max_difference : float
        Largest difference of associated stamps, s.

    Returns
    -------
    Report
        Absolute and relative errors; and, if the estimate has covariances, the NEES per degree of freedom.

    Raises
    ------
    EvaluationError
        If the two do not overlap in time or cannot be compared.
    """
    matched = associate(estimate, truth, max_difference)
    absolute = absolute_errors(matched.estimate, matched.truth, align, max_difference)
    relative = relative_errors(
        matched.estimate, matched.truth, delta, unit, all_pairs=all_pairs, max_difference=max_difference
    )
    metrics = {f"absolute {name}": absolute.statistics(name) for name in absolute.names}
    metrics |= {f"relative {name}": relative.statistics(name) for name in relative.names}
    if matched.estimate.covariances is not None:
        consistency = nees(absolute.tangent, matched.estimate.covariances)
        name = "NEES per degree of freedom"
        metrics[name] = ErrorStatistics.of(consistency.values / consistency.freedom, "1", name)
    counts = {
        "poses": len(matched),
        "pairs": len(relative),
        "unmatched poses of the estimate": matched.unmatched_estimate,
        "unmatched poses of the truth": matched.unmatched_truth,
    }
    return Report(metrics, counts)
