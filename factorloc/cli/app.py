"""The command line's commands, and how it ends."""

from __future__ import annotations

import sys
import warnings
from typing import Annotated

import typer

from factorloc._version import __version__
from factorloc.cli.console import errors, start_logging
from factorloc.cli.demo_command import demo
from factorloc.cli.evaluate_command import evaluate
from factorloc.cli.info_command import info
from factorloc.cli.localize_command import localize
from factorloc.cli.map_commands import map_app
from factorloc.cli.pole_command import poles
from factorloc.cli.simulate_command import simulate
from factorloc.errors import FactorlocError, FactorlocWarning

__all__ = ["app", "run"]

app = typer.Typer(
    name="factorloc",
    help="""Localize a lidar vehicle in a known map by smoothing a factor graph.

    [bold]Examples[/bold]

    [green]factorloc demo[/green]   a simulated building, mapped and localized in: start here

    [green]factorloc map build intel-corrected.log.gz --scans even -o intel.h5[/green]

    [green]factorloc map poles kitti/sequences/07 -o poles.geojson[/green]

    [green]factorloc localize intel.h5 intel.clf.bz2 --truth intel-corrected.log.gz --scans odd[/green]

    [green]factorloc simulate street -o world[/green]   a street in space, as a KITTI sequence

    [green]factorloc evaluate results/latest/smoothed.tum truth.tum[/green]

    [green]factorloc info intel.h5[/green]
    """,
    rich_markup_mode="rich",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
map_app.command()(poles)
app.add_typer(map_app, name="map")
app.command()(localize)
app.command()(evaluate)
app.command()(info)
app.command()(demo)
app.command()(simulate)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"factorloc {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Say more.")] = False,
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    start_logging(verbose)


def run() -> None:
    """Run :data:`app`; a :class:`FactorlocError` becomes one line on the error stream and exit code 1."""
    warnings.simplefilter("always", FactorlocWarning)
    try:
        app()
    except FactorlocError as error:
        errors.print(f"[bold red]error:[/bold red] {_escaped(error)}", highlight=False, soft_wrap=True)
        sys.exit(1)
    except KeyboardInterrupt:
        errors.print("interrupted; files are written whole or not at all")
        sys.exit(130)


def _escaped(error: Exception) -> str:
    from rich.markup import escape

    return escape(" ".join(str(error).split()))
