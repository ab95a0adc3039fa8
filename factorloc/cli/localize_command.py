"""``factorloc localize``: a recording in a map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from factorloc.cli.console import Threads, console, progress_bar, use_threads
from factorloc.cli.localize_facades import localize_among_facades
from factorloc.cli.localize_methods import Method, by_particles, by_smoothing
from factorloc.cli.pole_localization import localize_among_poles
from factorloc.cli.recording import Mount, reader_options
from factorloc.cli.selection import SELECTION_HELP, select_scans

if TYPE_CHECKING:
    from factorloc.datasets import Drive

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
    from dataclasses import replace

    import numpy as np

    from factorloc.datasets import open_drive
    from factorloc.errors import ConfigError, DataError
    from factorloc.geometry import se3
    from factorloc.localization import with_lidar_odometry
    from factorloc.localization.run_folder import RunFolder, new_run_folder
    from factorloc.mapping import read_map, read_pole_map
    from factorloc.trajectory import Trajectory

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
    statistics = None if landmarks is not None else read_map(map_file)
    pole_map = None if poles is None else read_pole_map(poles)
    options = reader_options(mount) if truth is None else {"truth": truth}
    drive: Drive = open_drive(log, **options)
    planar = drive.dimension == 2
    if poses is not None:
        drive = replace(drive, truth=Trajectory.read_tum(poses, planar=planar).at(drive.stamps))
    drive = drive.select(select_scans(len(drive), scans))
    if not planar and not drive.odometry_known.any():
        with progress_bar("lidar odometry", len(drive)) as progress:
            drive = with_lidar_odometry(drive, progress=progress)
    pose = None
    if start is not None:
        pose = np.array([start[0], start[1], np.radians(start[2])])
        if not planar:
            pose = se3.from_se2(pose)
            pose[2, 3] = height
    elif anywhere:
        pass
    elif drive.truth is not None:
        pose = drive.truth.poses[0]
        console.print("start: the first pose of the truth (choose another with --start X Y HEADING)")
    else:
        raise DataError(f"{log}: holds no true poses to start from; say where it begins with --start X Y HEADING")
    if facades is not None:
        assert pose is not None  # else MAP was read
        localize_among_facades(facades, drive, pose if planar else se3.to_se2(pose), known_to, config, output, plots)
        return
    if statistics is None:
        assert poles is not None and pole_map is not None and pose is not None  # else MAP was read
        if planar:
            raise DataError(f"{log}: planar scans; poles are found in scans of space")
        localize_among_poles(
            pole_map, poles.name, drive, pose, method, config, output, particles=particles, seed=seed, plots=plots
        )
        return
    if method is Method.MCL or pose is None:
        settings, results = by_particles(
            statistics, drive, pose, config, model=model, floor=floor, particles=particles, height=height, seed=seed
        )
    else:
        settings, results = by_smoothing(statistics, drive, pose, config)
    folder = RunFolder(new_run_folder(output), plots)
    folder.write_settings(settings)
    for name, result in results.items():
        folder.write_result(name, result)
    folder.write_account(
        results, map=map_file.name, recording=drive.name, scans=scans, method=method.value,
        model=model if method is Method.MCL else None, seed=seed if method is Method.MCL else None,
        reports=[str(report) for report in drive.reports],
    )  # fmt: skip
    paths = {name: result.trajectory for name, result in results.items()}
    if drive.truth is not None:
        truth_in_map = drive.truth
        for name, report in folder.write_evaluation(paths, truth_in_map).items():
            console.print(report.table(name))
    folder.draw(statistics, paths, results, drive.truth)
    for name, result in results.items():
        console.print(f"{name}: {result.summary()}, {result.seconds:.2f} s")
    console.print(f"results: {folder.folder} (also {output / 'latest'})")
