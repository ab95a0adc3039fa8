"""Outcomes of the long-term sessions: errors of all runs, and the table that shows them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from rich.table import Table

from benchmarks.harness import Benchmark
from factorloc.geometry import wrap

__all__ = ["COLUMNS", "METHODS", "LongtermBenchmark", "Outcome"]

Array = npt.NDArray[np.float64]

METHODS = ("filter", "smoother")
COLUMNS = ("position error", "position RMSE", "heading error", "heading RMSE")
"""Of table 12.1, m and deg."""

LARGEST = "largest position error"
"""Of any run, m; stands beside."""


@dataclass
class Outcome:
    """Errors of one method in one session, run by run: (R, N) m and deg, and seconds."""

    position: list[Array] = field(default_factory=list)
    angle: list[Array] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)

    def add(self, poses: Array, truth: Array, seconds: float) -> None:
        """Compare a path with the truth."""
        self.position.append(np.hypot(*(poses[:, :2] - truth[:, :2]).T))
        self.angle.append(np.degrees(np.abs(wrap(poses[:, 2] - truth[:, 2]))))
        self.seconds.append(seconds)

    def row(self) -> tuple[float, float, float, float]:
        """Mean and RMSE of positions and of headings, each averaged over the runs."""
        both = (np.array(self.position), np.array(self.angle))
        values = [(float(e.mean()), float(np.sqrt((e**2).mean(1)).mean())) for e in both]
        return (*values[0], *values[1])

    @property
    def largest(self) -> float:
        """Largest error of a position in any run, m."""
        return max(float(errors.max()) for errors in self.position)

    def longest_above(self, limit: float, spacing: float) -> float:
        """Longest way in one piece on which a run was farther off than a limit, m."""
        return max(_longest(errors > limit) for errors in self.position) * spacing


class LongtermBenchmark(Benchmark):
    """Sessions in the form of table 12.1, both methods side by side."""

    def session(self, number: int, fraction: float, outcomes: dict[str, Outcome]) -> None:
        """Add a row."""
        self.figure(f"session {number:02d}: f_map", 100 * fraction, "%")
        for who, outcome in outcomes.items():
            for name, value, unit in zip(COLUMNS, outcome.row(), ("m", "m", "deg", "deg"), strict=True):
                self.figure(f"session {number:02d}: {who}: {name}", value, unit)
            self.figure(f"session {number:02d}: {who}: {LARGEST}", outcome.largest, "m")

    def _figure_table(self) -> Table:
        table = Table("session", title=f"{self.name} (filter as published | smoother)", title_justify="left")
        shown = (*COLUMNS, LARGEST)
        for header in ("f_map\n%", *("pos\nm", "RMSE\nm", "ang\ndeg", "RMSE\ndeg", "max\nm") * len(METHODS)):
            table.add_column(header, justify="right")
        names = dict.fromkeys(name.split(": ")[0] for name in self.figures if name.endswith(": f_map"))
        for name in names:
            cells = [f"{self.figures[f'{name}: {who}: {column}'][0]:.3f}" for who in METHODS for column in shown]
            table.add_row(name.removeprefix("session "), f"{self.figures[f'{name}: f_map'][0]:.1f}", *cells)
        rest = [name for name in self.figures if name.split(": ")[0] not in names]
        table.caption = "\n".join(f"{name}: {self.figures[name][0]:.4g} {self.figures[name][1]}" for name in rest)
        table.caption_justify = "left"
        return table


def _longest(flags: npt.NDArray[np.bool_]) -> int:
    """Length of the longest run of true flags."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))
