"""One form for all benchmarks: arguments, figures with units, goals, one JSON object, one picture."""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.table import Table

from factorloc import set_threads
from factorloc.files import write_text
from factorloc.viewer import save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Arguments", "Benchmark", "arguments", "interleave", "ratio"]

Array = npt.NDArray[np.float64]

_PACKAGES = ("factorloc", "gtsam", "numba", "numpy", "scipy")


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
    """Parse the common arguments, and ``--key VALUE`` for each option with its default."""
    parser = argparse.ArgumentParser(prog=f"python -m benchmarks.{name}", description=description)
    parser.add_argument("--data", type=Path, help="folder of real data (default: FACTORLOC_DATA, or ../shared/data)")
    parser.add_argument("--quick", action="store_true", help="fewer samples, never easier ones")
    parser.add_argument("--json", type=Path, default=Path("out") / f"{name}.json")
    parser.add_argument("--plot", type=Path, default=Path("out") / f"{name}.png")
    parser.add_argument("--threads", type=int, help="threads of the kernels (default: all cores)")
    for key, default in options.items():
        parser.add_argument(f"--{key.replace('_', '-')}", type=type(default), default=default, dest=key)
    given = parser.parse_args(argv)
    data = given.data or _default_data()
    threads = set_threads(given.threads)
    chosen = {key: getattr(given, key) for key in options}
    return Arguments(data, given.quick, given.json, given.plot, threads, chosen)


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
    goals : list of dict
        ``name``, ``value``, ``unit``, ``bound`` and ``met``.
    """

    name: str
    settings: Mapping[str, Any]
    figures: dict[str, tuple[float, str]] = field(default_factory=dict)
    goals: list[dict[str, Any]] = field(default_factory=list)

    def figure(self, name: str, value: float, unit: str) -> None:
        """Add a figure."""
        self.figures[name] = (float(value), unit)

    def goal(self, name: str, value: float, unit: str, most: float, least: float | None = None) -> None:
        """Add a goal: the value is at most ``most``, and at least ``least`` if that is given."""
        bound = f"<= {most:g}" if least is None else f"{least:g} to {most:g}"
        met = bool(value <= most and (least is None or value >= least))
        self.goals.append({"name": name, "value": float(value), "unit": unit, "bound": bound, "met": met})

    @property
    def met(self) -> bool:
        """Whether every goal was met."""
        return all(goal["met"] for goal in self.goals)

    def to_json(self) -> str:
        """Return the whole run as one JSON object; what is not finite becomes null."""
        finite = {name: value if np.isfinite(value) else None for name, (value, _) in self.figures.items()}
        return json.dumps(
            {
                "benchmark": self.name,
                "commit": _commit(),
                "machine": _machine(),
                "settings": dict(self.settings),
                "figures": {name: {"value": finite[name], "unit": unit} for name, (_, unit) in self.figures.items()},
                "goals": self.goals,
            },
            indent=2,
            default=str,
        )

    def finish(self, given: Arguments, picture: Figure | None = None) -> int:
        """Print the tables and write JSON and picture; returns the exit code, 1 if a goal was missed."""
        console = Console(highlight=False)
        table = Table(title=self.name, title_justify="left")
        table.add_column("figure")
        table.add_column("value", justify="right")
        table.add_column("unit")
        for name, (value, unit) in self.figures.items():
            table.add_row(name, f"{value:.4g}", unit)
        console.print(table)
        if self.goals:
            table = Table(title="goals", title_justify="left")
            for header in ("goal", "value", "unit", "bound", "met"):
                table.add_column(header)
            for goal in self.goals:
                met = "[green]yes[/green]" if goal["met"] else "[bold red]no[/bold red]"
                table.add_row(goal["name"], f"{goal['value']:.4g}", goal["unit"], goal["bound"], met)
            console.print(table)
        write_text(given.json, self.to_json() + "\n")
        console.print(f"figures: {given.json}")
        if picture is not None:
            save_figure(picture, given.plot)
            console.print(f"picture: {given.plot}")
        return 0 if self.met else 1


def interleave(functions: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, Array]:
    """Time functions in turn, round by round, after one call each to warm up; seconds, shape (rounds,)."""
    for function in functions.values():
        function()
    seconds: dict[str, list[float]] = {name: [] for name in functions}
    for _ in range(rounds):
        for name, function in functions.items():
            began = time.perf_counter()
            function()
            seconds[name].append(time.perf_counter() - began)
    return {name: np.array(values) for name, values in seconds.items()}


def ratio(seconds: Mapping[str, Array], name: str, reference: str) -> float:
    """Median over the rounds of the time of ``name`` over that of ``reference`` in the same round."""
    return float(np.median(seconds[name] / seconds[reference]))


def _default_data() -> Path | None:
    """``FACTORLOC_DATA``, or the data beside the checkout where the tests look for it, too."""
    named = os.environ.get("FACTORLOC_DATA")
    folder = Path(named) if named else Path(__file__).resolve().parents[2] / "shared" / "data"
    return folder if folder.is_dir() else None


def _commit() -> str:
    try:
        git = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty"]
        return subprocess.run(git, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def _machine() -> dict[str, Any]:
    cpu = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = [
            line.split(":", 1)[1].strip() for line in info.read_text().splitlines() if line.startswith("model name")
        ]
        cpu = names[0] if names else cpu
    return {
        "cpu": cpu,
        "cores": os.cpu_count(),
        "system": platform.system(),
        "python": platform.python_version(),
        **{package: version(package) for package in _PACKAGES},
    }
