"""One form for all benchmarks: arguments, figures with units, goals, one JSON object, one picture."""

from __future__ import annotations

import argparse
import functools
import json
import math
import os
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table

from benchmarks.machine import commit, machine
from factorloc import set_threads
from factorloc.datasets import data_folder
from factorloc.errors import DataError, FactorlocError
from factorloc.files import write_text
from factorloc.viewer import FIGURE_KINDS, save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "Arguments",
    "Benchmark",
    "Goal",
    "arguments",
    "default_data",
    "new_console",
    "one_line_errors",
    "yes_or_no",
]

_BESIDE_CHECKOUT = Path(__file__).resolve().parents[2] / "shared" / "data"


@dataclass(frozen=True)
class Arguments:
    """What every benchmark is told.

    Parameters
    ----------
    data : Path or None
        Folder of real data, if there is one.
    quick : bool
        Fewer samples, never easier ones.
    json, plot : Path
        Files to write.
    threads : int
        Threads of the kernels.
    options : dict
        What the benchmark asked for besides.
    """

    data: Path | None
    quick: bool
    json: Path
    plot: Path
    threads: int
    options: dict[str, Any]


def arguments(name: str, description: str, argv: list[str] | None = None, **options: Any) -> Arguments:
    """Parse the common arguments, and ``--key VALUE`` for each option with its default (a tuple takes several).

    Raises
    ------
    DataError
        If ``FACTORLOC_DATA`` names no folder.
    SystemExit
        With code 2 and the reason, if an argument cannot be understood.
    """
    parser = argparse.ArgumentParser(prog=f"python -m benchmarks.{name}", description=description)
    parser.add_argument("--data", type=Path, help="folder of real data (default: FACTORLOC_DATA, or ../shared/data)")
    parser.add_argument("--quick", action="store_true", help="fewer samples, never easier ones")
    parser.add_argument("--json", type=Path, default=Path("out") / f"{name}.json", help="default: %(default)s")
    parser.add_argument("--plot", type=Path, default=Path("out") / f"{name}.png", help="default: %(default)s")
    parser.add_argument("--threads", type=int, help="threads of the kernels (default: all cores)")
    for key, default in options.items():
        several = isinstance(default, tuple)
        parser.add_argument(
            f"--{key.replace('_', '-')}",
            type=type(default[0]) if several else type(default),
            nargs="+" if several else None,
            default=default,
            dest=key,
            help=f"default: {' '.join(map(str, default)) if several else default}",
        )
    given = parser.parse_args(argv)
    if given.data is not None and not given.data.is_dir():
        parser.error(f"--data {given.data}: no such folder")
    if given.plot.suffix.lower() not in FIGURE_KINDS:  # said now, not after the run
        parser.error(f"--plot {given.plot}: end the name in {', '.join(FIGURE_KINDS)}")
    if given.threads is not None and given.threads < 1:
        parser.error(f"--threads {given.threads}: at least 1")
    chosen = {key: getattr(given, key) for key in options}
    data = given.data or default_data()
    return Arguments(data, given.quick, given.json, given.plot, set_threads(given.threads), chosen)


def default_data() -> Path | None:
    """Return where the package looks for data, or else the folder beside the checkout, as the tests do; None without.

    Raises
    ------
    DataError
        If ``FACTORLOC_DATA`` names no folder.
    """
    try:
        return data_folder()
    except DataError:
        if os.environ.get("FACTORLOC_DATA"):
            raise
        return _BESIDE_CHECKOUT if _BESIDE_CHECKOUT.is_dir() else None


@dataclass(frozen=True)
class Goal:
    """A bound on a figure.

    Parameters
    ----------
    name : str
    value : float
    unit : str
    most, least : float
        The range that meets it.
    """

    name: str
    value: float
    unit: str
    most: float = math.inf
    least: float = -math.inf

    @property
    def met(self) -> bool:
        """Whether the value lies in the range; NaN never does."""
        return self.least <= self.value <= self.most

    @property
    def bound(self) -> str:
        """The range in words."""
        if self.least == -math.inf:
            return f"<= {self.most:g}"
        return f">= {self.least:g}" if self.most == math.inf else f"{self.least:g} to {self.most:g}"


@dataclass
class Benchmark:
    """Figures and goals of one run.

    Parameters
    ----------
    name : str
    settings : mapping
        What the figures depend on.
    figures : dict of str to (float, str)
        Value and unit.
    spreads : dict of str to (float, float)
        Lower and upper quartile of the figures that are medians.
    goals : list of Goal
    """

    name: str
    settings: Mapping[str, Any]
    figures: dict[str, tuple[float, str]] = field(default_factory=dict)
    spreads: dict[str, tuple[float, float]] = field(default_factory=dict)
    goals: list[Goal] = field(default_factory=list)

    def figure(self, name: str, value: float, unit: str, spread: tuple[float, float] | None = None) -> None:
        """Add a figure, with its quartiles if it is the median of repetitions."""
        self.figures[name] = (float(value), unit)
        if spread is not None:
            self.spreads[name] = spread

    def goal(self, name: str, value: float, unit: str, most: float = math.inf, least: float | None = None) -> None:
        """Add a goal: the value is at most ``most``, and at least ``least`` if that is given."""
        self.goals.append(Goal(name, float(value), unit, most, -math.inf if least is None else least))

    @property
    def met(self) -> bool:
        """Whether every goal was met."""
        return all(goal.met for goal in self.goals)

    def to_json(self) -> str:
        """Return the whole run as one JSON object; what is not finite becomes null."""
        figures: dict[str, dict[str, Any]] = {
            name: {"value": _finite(value), "unit": unit} for name, (value, unit) in self.figures.items()
        }
        for name, quartiles in self.spreads.items():
            figures[name]["spread"] = [_finite(value) for value in quartiles]
        goals = [
            {"name": goal.name, "value": _finite(goal.value), "unit": goal.unit, "bound": goal.bound, "met": goal.met}
            for goal in self.goals
        ]
        run = {"benchmark": self.name, "commit": commit(), "machine": machine(), "settings": dict(self.settings)}
        return json.dumps({**run, "figures": figures, "goals": goals}, indent=2, default=str, allow_nan=False)

    def finish(self, given: Arguments, picture: Figure | None = None) -> int:
        """Print the tables and write JSON and picture, whole or not at all; returns 1 if a goal was missed, else 0.

        Raises
        ------
        FactorlocError
            If a file cannot be written.
        """
        console = new_console()
        console.print(self._figure_table())
        if self.goals:
            console.print(self._goal_table())
        write_text(given.json, self.to_json() + "\n")
        console.print(f"figures: {given.json}")
        if picture is not None:
            save_figure(picture, given.plot)
            console.print(f"picture: {given.plot}")
        return 0 if self.met else 1

    def _figure_table(self) -> Table:
        table = Table("figure", title=self.name, title_justify="left")
        table.add_column("value", justify="right")
        if self.spreads:
            table.add_column("quartiles", justify="right")
        table.add_column("unit")
        for name, (value, unit) in self.figures.items():
            quartiles = " to ".join(f"{limit:.4g}" for limit in self.spreads.get(name, ()))
            table.add_row(name, f"{value:.4g}", *([quartiles] if self.spreads else []), unit)
        return table

    def _goal_table(self) -> Table:
        table = Table("goal", "value", "unit", "bound", "met", title="goals", title_justify="left")
        for goal in self.goals:
            table.add_row(goal.name, f"{goal.value:.4g}", goal.unit, goal.bound, yes_or_no(goal.met))
        return table


def new_console() -> Console:
    """Return a terminal for tables; a file or pipe is taken for a wide one."""
    return Console(highlight=False, width=None if sys.stdout.isatty() else 120)


def yes_or_no(met: bool) -> str:
    """Whether a goal was met, in colour."""
    return "[green]yes[/green]" if met else "[bold red]no[/bold red]"


def one_line_errors(main: Callable[..., int]) -> Callable[..., int]:
    """Wrap the entry of a benchmark: an error of the package becomes one line and the exit code 2."""

    @functools.wraps(main)
    def guarded(argv: list[str] | None = None) -> int:
        try:
            return main(argv)
        except FactorlocError as error:
            print(f"error: {error}", file=sys.stderr)
            return 2

    return guarded


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
