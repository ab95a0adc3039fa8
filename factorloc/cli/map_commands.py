"""``factorloc map``: build maps from recordings, and from building maps."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from factorloc.cli.console import Threads, console, progress_bar, use_threads
from factorloc.cli.facades_command import facades
from factorloc.cli.recording import Mount, reader_options
from factorloc.cli.selection import SELECTION_HELP, select_scans

__all__ = ["map_app"]

map_app = typer.Typer(
    help="Build maps from recordings with known poses, or from building maps.",
    no_args_is_help=True,
    rich_markup_mode="rich",
)
map_app.command()(facades)


@map_app.command()
def build(
    log: Annotated[Path, typer.Argument(help="Recording whose poses are known, such as a corrected CARMEN log.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Map file to write.")] = Path("map.h5"),
    poses: Annotated[
        Path | None, typer.Option(help="TUM trajectory of the body, instead of the recording's own truth.")
    ] = None,
    scans: Annotated[str, typer.Option(help=SELECTION_HELP)] = "all",
    resolution: Annotated[
        float | None,
        typer.Option(min=0.001, help="Edge length of a cell, m; 0.1 in the plane and 0.2 in space if not given."),
    ] = None,
    frame: Annotated[str, typer.Option(help="Name of the map's frame.")] = "map",
    carve: Annotated[bool, typer.Option(help="Rays without return carve free space up to the maximum range.")] = True,
    picture: Annotated[bool, typer.Option(help="Draw the map beside the file.")] = True,
    mount: Mount = None,
    threads: Threads = None,
) -> None:
    """Accumulate hits, misses and path lengths of every ray into a map.

    [bold]Examples[/bold]

    [green]factorloc map build intel-corrected.log.gz -o intel.h5[/green]

    [green]factorloc map build intel-corrected.log.gz --scans even --resolution 0.05 -o intel.h5[/green]

    [green]factorloc map build kitti/sequences/07 -o street.h5[/green]
    """
    from factorloc.datasets import open_drive
    from factorloc.errors import DataError
    from factorloc.mapping import BrickStatistics, RayStatistics, top_view, write_map
    from factorloc.trajectory import Trajectory
    from factorloc.viewer import plot_map_and_trajectories, save_figure

    use_threads(threads)
    drive = open_drive(log, **reader_options(mount))
    planar = drive.dimension == 2
    if poses is not None:
        path = Trajectory.read_tum(poses, planar=planar).at(drive.stamps)
    elif drive.truth is not None:
        path = drive.truth
    else:
        raise DataError(f"{log}: holds no true poses; give a corrected log, or a trajectory with --poses")
    rows = select_scans(len(drive), scans)
    chosen = [drive.scans[row] for row in rows]
    if not carve:
        chosen = [scan.select(scan.is_return) for scan in chosen]
    path = path.select(rows)
    resolution = resolution or (0.1 if planar else 0.2)
    kind = RayStatistics if planar else BrickStatistics
    with progress_bar("mapping", len(chosen)) as progress:
        statistics = kind.from_scans(chosen, path.poses, resolution=resolution, frame=frame, progress=progress)
    write_map(output, statistics, provenance={"recording": log.name, "scans": scans, "carve": str(carve)})
    grid = statistics.grid
    size = " x ".join(f"{(high - low):.1f}" for low, high in zip(grid.origin, grid.upper, strict=True))
    left_out = ", ".join(f"{count} rays {reason}" for reason, count in statistics.left_out.items() if count)
    console.print(
        f"{output}: {len(chosen)} scans, {int(statistics.hits.sum())} hits, {size} m at {resolution} m"
        + (f"; left out {left_out}" if left_out else "")
    )
    for report in drive.reports:
        console.print(f"[dim]{report}[/dim]", soft_wrap=True)
    if picture:
        file = output.with_suffix(".png")
        save_figure(plot_map_and_trajectories(top_view(statistics), grid.extent, {"mapping drive": path}), file)
        console.print(f"picture: {file}")
