"""What ``factorloc localize --facades`` runs: interval tracking and bounded least squares among facades."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from factorloc.cli.console import console, progress_bar

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from factorloc.config import Block
    from factorloc.datasets import Drive
    from factorloc.localization.interval_tracking import FacadeTrack
    from factorloc.mapping import FacadeMap

__all__ = ["localize_among_facades"]


def _open_facades(path: Path) -> FacadeMap:
    """Read a facade map, or make one of a building map with the declared errors of OpenStreetMap."""
    from factorloc.datasets import read_buildings
    from factorloc.mapping import FacadeMap, is_facade_map, read_facade_map

    if path.suffix.lower() in (".h5", ".hdf5") and is_facade_map(path):
        return read_facade_map(path)
    found = FacadeMap.from_outlines(read_buildings(path))
    shift, vertex = found.uncertainty.shift, found.uncertainty.vertex
    console.print(
        f"{path.name}: declared errors are those of OpenStreetMap, shift {shift:g} m and corners {vertex:g} m "
        "(choose others with factorloc map facades)",
        soft_wrap=True, markup=False,
    )  # fmt: skip
    return found


def _track(
    facade_map: FacadeMap,
    drive: Drive,
    start: npt.NDArray[np.float64],
    known_to: tuple[float, float],
    config: Path | None,
) -> tuple[Block, FacadeTrack]:
    """Track a drive; returns the settings and what came of it.

    Parameters
    ----------
    facade_map : FacadeMap
        The map.
    drive : Drive
        Scans and odometry.
    start : ndarray, shape (3,)
        Middle of where it begins, m and rad.
    known_to : (float, float)
        Half sides of the box around it, m and deg.
    config : Path, optional
        Settings.

    Raises
    ------
    DataError
        If a motion between two scans was not measured.
    """
    import numpy as np

    from factorloc.config import read_config
    from factorloc.errors import DataError
    from factorloc.geometry import se3
    from factorloc.localization.facade_settings import FacadeDriveSettings
    from factorloc.localization.interval_tracking import track_facades
    from factorloc.localization.wall_lines import WallLines
    from factorloc.mapping.facade_points import facade_points
    from factorloc.result import Bounds

    settings = FacadeDriveSettings() if config is None else read_config(config, FacadeDriveSettings)
    if not np.all(drive.odometry_known):
        missing = int((~np.asarray(drive.odometry_known)).sum())
        raise DataError(f"{drive.name}: {missing} motions were not measured; feasible sets need a bound of each")
    motions = drive.odometry if drive.dimension == 2 else se3.to_se2(drive.odometry)
    with progress_bar("reducing scans", len(drive)) as progress:
        scans = []
        for scan in drive.scans:
            scans.append(facade_points(scan, settings.errors, settings.reduction))
            progress(len(scans))
    box = Bounds.around(start, known_to[0], np.radians(known_to[1]))
    with progress_bar("tracking among facades", len(drive)) as progress:
        track = track_facades(
            scans, drive.stamps, motions, WallLines(facade_map.facades), box, guess=start,
            settings=settings.localization, progress=progress,
        )  # fmt: skip
    for k in np.flatnonzero(track.violated):
        conflicts = ", ".join(str(facade) for facade in track.steps[k].feasible.conflicts)
        console.print(f"scan {k}: assumptions violated; facades in conflict: {conflicts}", markup=False)
    return settings, track


def localize_among_facades(
    facades: Path,
    drive: Drive,
    start: npt.NDArray[np.float64],
    known_to: tuple[float, float],
    config: Path | None,
    output: Path,
    plots: bool,
) -> None:
    """Track a drive among facades and write trajectory, bounds and figures into a new run folder."""
    from factorloc.localization.run_folder import RunFolder, new_run_folder

    facade_map = _open_facades(facades)
    settings, track = _track(facade_map, drive, start, known_to, config)
    folder = RunFolder(new_run_folder(output), plots)
    folder.write_settings(settings)
    folder.write_result("tracked", track.result)
    assert track.result.bounds is not None
    folder.write_bounds("tracked", track.result.bounds, track.violated)
    folder.write_account(
        {"tracked": track.result}, map=facades.name, recording=drive.name, method="facades",
        attribution=facade_map.attribution, reports=[str(report) for report in drive.reports],
    )  # fmt: skip
    folder.draw_bounds(facade_map, "tracked", track.result)
    console.print(f"tracked: {track.result.summary()}, {track.result.seconds:.2f} s")
    if facade_map.attribution:
        console.print(f"map: {facade_map.attribution}", markup=False)
    console.print(f"results: {folder.folder} (also {output / 'latest'})")
