"""``factorloc evaluate``: one trajectory against another."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from factorloc.cli.console import console

__all__ = ["evaluate"]


def evaluate(
    estimate: Annotated[Path, typer.Argument(help="Estimated trajectory, TUM format.")],
    truth: Annotated[Path, typer.Argument(help="True trajectory, TUM format.")],
    align: Annotated[bool, typer.Option(help="Lay the estimate onto the truth first, without scale.")] = False,
    planar: Annotated[bool, typer.Option(help="Project both onto the plane.")] = False,
    delta: Annotated[float, typer.Option(min=0.0, help="Step of the relative errors.")] = 1.0,
    unit: Annotated[str, typer.Option(help="Unit of the step: frames or m.")] = "frames",
    max_difference: Annotated[float, typer.Option(min=0.0, help="Largest difference of matched stamps, s.")] = 0.01,
    json: Annotated[Path | None, typer.Option(help="Write the metrics as JSON.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the errors over time.")] = None,
) -> None:
    """Compute absolute and relative errors, with their units.

    [bold]Examples[/bold]

    [green]factorloc evaluate results/latest/smoothed.tum truth.tum --planar[/green]

    [green]factorloc evaluate odometry.tum truth.tum --align --delta 10 --json metrics.json[/green]
    """
    from typing import cast

    from factorloc.errors import ConfigError
    from factorloc.evaluation import StepUnit, absolute_errors, associate
    from factorloc.evaluation import evaluate as compute
    from factorloc.trajectory import Trajectory
    from factorloc.viewer import plot_errors_over_time, save_figure

    if unit not in ("frames", "m"):
        raise ConfigError(f"--unit {unit}: choose frames or m")
    first, second = (Trajectory.read_tum(path, planar=planar) for path in (estimate, truth))
    report = compute(
        first, second, align=align, delta=delta, unit=cast("StepUnit", unit), max_difference=max_difference
    )
    console.print(report.table(f"{estimate.name} against {truth.name}"))
    if json is not None:
        report.write_json(json)
    if plot is not None:
        matched = associate(first, second, max_difference)
        errors = absolute_errors(matched.estimate, matched.truth, align, max_difference)
        save_figure(plot_errors_over_time({estimate.stem: errors}), plot)
