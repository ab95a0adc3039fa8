"""``factorloc map poles``: a map of poles from a recording in space."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from factorloc.cli.console import Threads, console, progress_bar, use_threads
from factorloc.cli.recording import Mount, reader_options
from factorloc.cli.selection import SELECTION_HELP, select_scans

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from factorloc.mapping import PoleDetectionRates, PoleMappingSettings
    from factorloc.scan import Scan
    from factorloc.trajectory import Trajectory

__all__ = ["EPSILON", "poles"]

EPSILON = "epsilon of a second drive"
"""Name in the provenance of a map, 1/m."""

_BACKGROUND_SCANS = 60  # of a picture
_BACKGROUND_EDGE = 0.3  # m


def poles(
    recording: Annotated[Path, typer.Argument(help="Recording in space whose poses are known.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Map to write: .geojson, or .h5 for our own file.")
    ] = Path("poles.geojson"),
    poses: Annotated[Path | None, typer.Option(help="TUM trajectory of the body, instead of the truth.")] = None,
    scans: Annotated[str, typer.Option(help=SELECTION_HELP)] = "all",
    settings: Annotated[
        str,
        typer.Option(
            help="How poles are found: evidence (likelihood ratios, for most lidars), kitti or nclt (as published), or "
            "a TOML or JSON file of settings."
        ),
    ] = "evidence",
    refine: Annotated[
        bool, typer.Option(help="Register the scans with each other first: for poses that sway, as those of a GNSS do.")
    ] = False,
    second: Annotated[
        Path | None,
        typer.Option(
            help="Another recording, with true poses in the same frame: says how often poles are found there, and what "
            "else is, for the particle filter."
        ),
    ] = None,
    frame: Annotated[str, typer.Option(help="Name of the map's frame.")] = "map",
    origin: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="LAT LON YAW", help="Where the frame lies: degrees; its x axis from east, to the left."),
    ] = None,
    picture: Annotated[bool, typer.Option(help="Draw the map beside the file.")] = True,
    mount: Mount = None,
    threads: Threads = None,
) -> None:
    """Map the poles beside a drive: lamps, signs, trunks, whatever stands upright and free.

    [bold]Examples[/bold]

    [green]factorloc map poles kitti/sequences/07 -o poles.geojson[/green]

    [green]factorloc map poles world/sequences/00 --second world/sequences/01[/green]

    [green]factorloc map poles 2011_09_26/2011_09_26_drive_0005_sync --origin 49.0112 8.4229 0[/green]
    """
    from dataclasses import replace

    import numpy as np

    from factorloc.datasets import open_drive
    from factorloc.errors import DataError
    from factorloc.mapping import BrickStatistics, Georeference, PoleMapper, top_view, write_pole_map
    from factorloc.trajectory import Trajectory
    from factorloc.viewer import plot_pole_map, save_figure

    use_threads(threads)
    chosen = _settings(settings)
    drive = open_drive(recording, **reader_options(mount))
    if drive.dimension == 2:
        raise DataError(f"{recording}: scans in the plane; poles are found in space")
    if poses is not None:
        path = Trajectory.read_tum(poses).at(drive.stamps)
    elif drive.truth is not None:
        path = drive.truth
    else:
        raise DataError(f"{recording}: holds no true poses; give a trajectory with --poses")
    rows = select_scans(len(drive), scans)
    used, path = [drive.scans[row] for row in rows], path.select(rows)
    place = None if origin is None else Georeference.at(origin[0], origin[1], float(np.radians(origin[2])))
    if refine:
        path = _refined(used, path)
    mapper = PoleMapper(chosen)
    with progress_bar("poles", mapper.count(path), "local maps") as progress:
        mapper.add(recording.name, used, path, progress)
    origin_of = {"recording": recording.name, "scans": scans, "settings": settings}
    found = mapper.finish(frame, origin_of | ({"refined": "yes"} if refine else {}), place)
    rates = None if second is None else _rates(second, found.positions, chosen, mount)
    if rates is not None:
        found = replace(found, provenance={**found.provenance, EPSILON: repr(rates.epsilon)})
    write_pole_map(output, found)
    size = np.ptp(found.positions, axis=0)
    console.print(
        f"{output}: {len(found)} poles, {size[0]:.1f} x {size[1]:.1f} m, "
        f"from {len(used)} scans over {path.length:.1f} m"
    )
    if rates is not None:
        console.print(f"{second}: {rates}", soft_wrap=True)
    for report in drive.reports:
        console.print(f"[dim]{report}[/dim]", soft_wrap=True)
    if picture:
        some = np.unique(np.linspace(0, len(used) - 1, min(len(used), _BACKGROUND_SCANS)).round().astype(np.int64))
        below = BrickStatistics.from_scans(
            [used[k] for k in some], path.poses[some], resolution=_BACKGROUND_EDGE, frame=frame
        )
        file = output.with_suffix(".png")
        save_figure(plot_pole_map(found, top_view(below), below.grid.extent, trajectory=path), file)
        console.print(f"picture: {file}")


def _refined(scans: Sequence[Scan], path: Trajectory) -> Trajectory:
    from factorloc.localization.trajectory_refinement import refine_trajectory

    with progress_bar("registration", len(scans)) as progress:
        refined = refine_trajectory(scans, path, progress=progress)
    console.print(str(refined), soft_wrap=True)
    return refined.trajectory


def _rates(
    recording: Path, positions: npt.NDArray[np.float64], settings: PoleMappingSettings, mount: Mount
) -> PoleDetectionRates:
    from factorloc.datasets import open_drive
    from factorloc.errors import DataError
    from factorloc.mapping import PoleDetectionRates, local_maps

    drive = open_drive(recording, **reader_options(mount))
    if drive.dimension == 2 or drive.truth is None:
        raise DataError(f"{recording}: a second drive needs scans in space and true poses, in the frame of the map")
    return PoleDetectionRates.of(positions, local_maps(drive.scans, drive.truth, settings.poles))


def _settings(name: str) -> PoleMappingSettings:
    from factorloc.config import read_config
    from factorloc.mapping import BY_EVIDENCE, KITTI_LIKE, NCLT_LIKE
    from factorloc.mapping import PoleMappingSettings as Settings

    known = {
        # A slack joins what fitted axes leave apart; a pole seen only once is mostly something else.
        "evidence": Settings(poles=BY_EVIDENCE, confirmations=2, window=3, slack=0.1),
        "kitti": Settings(poles=KITTI_LIKE),
        "nclt": Settings(poles=NCLT_LIKE),
    }
    return known[name] if name in known else read_config(name, Settings)
