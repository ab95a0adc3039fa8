"""``factorloc localize``: a recording in a map."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from factorloc.cli.console import Threads, use_threads
from factorloc.cli.localize_facades import localize_among_facades
from factorloc.cli.localize_grid import localize_in_grid
from factorloc.cli.localize_methods import Method
from factorloc.cli.pole_localization import localize_among_poles
from factorloc.cli.recording import Mount, read_recording, starting_pose
from factorloc.cli.selection import SELECTION_HELP

__all__ = ["localize"]


def localize(
    map_file: Annotated[
        Path,
        typer.Argument(
            metavar="[MAP]", help="Map file of [green]factorloc map build[/green]; none with --poles, --facades."
        ),
    ],
    log: Annotated[
        Path | None, typer.Argument(help="Recording; where it holds no odometry, its lidar scans give some.")
    ] = None,
    facades: Annotated[
        Path | None,
        typer.Option(help="Building map, or file of [green]factorloc map facades[/green], instead of MAP."),
    ] = None,
    known_to: Annotated[
        tuple[float, float], typer.Option(metavar="M DEG", help="With --facades: how well the start is known.")
    ] = (5.0, 5.0),
    poles: Annotated[
        Path | None, typer.Option(help="Map of poles (.geojson, .h5, .npz) to localize in, instead of MAP.")
    ] = None,
    truth: Annotated[
        Path | None, typer.Option(help="Corrected log that belongs to a raw one: its scans are localized and judged.")
    ] = None,
    poses: Annotated[
        Path | None, typer.Option(help="TUM trajectory of the body to begin with and to judge by, instead of a truth.")
    ] = None,
    start: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="X Y HEADING", help="About where the drive begins: m, m, degrees."),
    ] = None,
    height: Annotated[float, typer.Option(help="Height of the start in a map in space, m.")] = 0.0,
    anywhere: Annotated[
        bool, typer.Option("--global", help="Start anywhere in the free space of the map; with --method mcl.")
    ] = False,
    method: Annotated[Method, typer.Option(help="Smoothing of a factor graph, or Monte Carlo localization.")] = (
        Method.SMOOTHER
    ),
    model: Annotated[
        str,
        typer.Option(
            help="Sensor model of the particles: end-point, decay-rate, decay-rate-posterior, reflection or "
            "reflection-posterior."
        ),
    ] = "end-point",
    floor: Annotated[
        float,
        typer.Option(
            min=0, help="Least decay rate (1/m), or probability, of decay-rate and reflection; 0 excludes rays."
        ),
    ] = 0.01,
    particles: Annotated[int | None, typer.Option(min=1, help="Most particles; fewer where few are enough.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of the particles.")] = 0,
    scans: Annotated[str, typer.Option(help=SELECTION_HELP)] = "all",
    config: Annotated[Path | None, typer.Option(help="Settings, TOML or JSON; see settings.json of any run.")] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of all runs.")] = Path("results"),
    plots: Annotated[bool, typer.Option(help="Draw figures.")] = True,
    mount: Mount = None,
    threads: Threads = None,
) -> None:
    """Track a recording scan by scan, smooth the whole of it, and write trajectories, metrics and figures.

    Without --start the drive begins at the first pose of its truth. With --method mcl particles are filtered instead.

    [bold]Examples[/bold]

    [green]factorloc localize intel.h5 intel.clf.bz2 --start 0.6 0.0 -20[/green]

    [green]factorloc localize intel.h5 intel.clf.bz2 --truth intel-corrected.log.gz --scans odd[/green]

    [green]factorloc localize street.h5 kitti/sequences/07 --scans odd[/green]

    [green]factorloc localize intel.h5 intel.clf.bz2 --method mcl --global[/green]

    [green]factorloc localize --facades town.osm kitti/sequences/07 --start 12 3 90[/green]

    [green]factorloc localize --poles town.geojson kitti/sequences/07[/green]
    """
    from factorloc.errors import ConfigError
    from factorloc.geometry import se3
    from factorloc.mapping import read_map, read_pole_map

    use_threads(threads)
    if anywhere and (method is Method.SMOOTHER or start is not None):
        raise ConfigError("--global: begins anywhere, by particles; use it with --method mcl and without --start")
    if poles is not None and facades is not None:
        raise ConfigError("--poles, --facades: two maps; give one")
    landmarks = poles or facades
    if landmarks is not None:
        if log is not None or anywhere:
            raise ConfigError(
                f"{landmarks}: takes the place of MAP, and begins somewhere; give one recording, no --global"
            )
        log = map_file
    elif log is None:
        raise ConfigError("LOG: missing; give a map and a recording, or --poles or --facades and a recording")
    # Maps are read first: a wrong one is told at once.
    statistics = None if landmarks is not None else read_map(map_file)
    pole_map = None if poles is None else read_pole_map(poles)
    drive = read_recording(log, mount=mount, truth=truth, poses=poses, scans=scans)
    if statistics is not None:
        pose = None if anywhere else starting_pose(drive, start, height)
        localize_in_grid(
            statistics, map_file.name, drive, pose, method, config, output, model=model, floor=floor,
            particles=particles, height=height, seed=seed, scans=scans, plots=plots,
        )  # fmt: skip
        return
    pose = starting_pose(drive, start, height)
    if facades is not None:
        planar_pose = pose if drive.dimension == 2 else se3.to_se2(pose)
        localize_among_facades(facades, drive, planar_pose, known_to, config, output, plots)
    elif poles is not None and pole_map is not None:
        localize_among_poles(
            pole_map, poles.name, drive, pose, method, config, output, particles=particles, seed=seed, plots=plots
        )
