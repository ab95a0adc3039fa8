"""What the command line shows: tables, progress with rates, log messages."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

if TYPE_CHECKING:
    from rich.progress import Task
    from rich.text import Text

__all__ = ["Threads", "console", "errors", "progress_bar", "start_logging", "use_threads"]

console = Console(highlight=False)
errors = Console(stderr=True, highlight=False)

Threads = Annotated[int | None, typer.Option("--threads", min=1, help="Threads of the kernels; all cores by default.")]


def start_logging(verbose: bool) -> None:
    """Show the package's messages; warnings of any kind become one line each."""
    from rich.logging import RichHandler

    handler = RichHandler(console=errors, show_time=False, show_path=False, show_level=verbose, markup=False)
    handler.setFormatter(logging.Formatter("%(message)s"))
    package = logging.getLogger("factorloc")
    package.handlers = [handler]
    package.setLevel(logging.DEBUG if verbose else logging.INFO)
    package.propagate = False
    for chatty in ("factorloc.viewer", "factorloc.evaluation"):
        logging.getLogger(chatty).setLevel(logging.DEBUG if verbose else logging.WARNING)
    _show_warnings(package)


def _show_warnings(package: logging.Logger) -> None:
    import warnings

    def show(message: Warning | str, category: type[Warning], *_: object, **__: object) -> None:
        package.warning("warning: %s", message)

    warnings.showwarning = show


def use_threads(count: int | None) -> None:
    """Set the threads of kernels and linear algebra for this process."""
    from factorloc._jit import set_threads

    set_threads(count)


@contextmanager
def progress_bar(label: str, total: int, unit: str = "scans") -> Iterator[Callable[[int], None]]:
    """Show a bar with its rate; yields what to call with the number done."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, TextColumn, TimeRemainingColumn
    from rich.text import Text as RichText

    class Rate(ProgressColumn):
        def render(self, task: Task) -> Text:
            speed = task.finished_speed or task.speed
            return RichText("" if speed is None else f"{speed:.0f} {unit}/s")

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), Rate(), TimeRemainingColumn())
    with Progress(*columns, console=errors, transient=not errors.is_terminal) as progress:
        task = progress.add_task(label, total=total)
        yield lambda done: progress.update(task, completed=done)
