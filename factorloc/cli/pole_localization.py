"""``factorloc localize --poles``: a recording in a map of poles."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from factorloc.cli.console import console, progress_bar
from factorloc.cli.localize_methods import Method

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from factorloc.datasets import Drive
    from factorloc.localization.pole_filter import PoleFilterSettings
    from factorloc.localization.run_folder import RunFolder
    from factorloc.mapping.pole_map import PoleMap
    from factorloc.result import Result
    from factorloc.trajectory import Trajectory

__all__ = ["filter_settings", "localize_among_poles"]


def localize_among_poles(
    pole_map: PoleMap,
    map_name: str,
    drive: Drive,
    start: npt.NDArray[np.float64],
    method: Method,
    config: Path | None,
    output: Path,
    *,
    particles: int | None,
    seed: int,
    plots: bool,
) -> None:
    """Find the poles of a drive, localize it by them, and write what a run leaves.

    Parameters
    ----------
    pole_map : PoleMap
        The map.
    map_name : str
        What its file is called.
    drive : Drive
        Spatial recording.
    start : ndarray, shape (4, 4)
        About where it begins.
    method : Method
        Smoother or particles.
    config : Path, optional
        Settings of the method.
    output : Path
        Folder of all runs.
    particles : int, optional
        How many.
    seed : int
        Of all that is random.
    plots : bool
        Whether to draw.

    Raises
    ------
    DataError
        If the scans are planar.
    """
    from dataclasses import replace

    from factorloc.config import read_config
    from factorloc.errors import DataError
    from factorloc.factors import PoleLandmarks
    from factorloc.geometry import se3
    from factorloc.localization.pole_drive import PoleDrive
    from factorloc.localization.pole_filter import PoleFilterSettings, filter_poles
    from factorloc.localization.pole_persistence import persistence
    from factorloc.localization.pole_smoother import PoleSmootherSettings, smooth_poles
    from factorloc.localization.run_folder import RunFolder, new_run_folder
    from factorloc.mapping.pole_settings import BY_EVIDENCE

    if drive.dimension == 2:
        raise DataError(f"{drive.name}: planar scans; poles are found in scans of space")
    with progress_bar("poles", PoleDrive.count(drive, BY_EVIDENCE)) as progress:
        seen = PoleDrive.of(drive, BY_EVIDENCE, progress=progress)
    about: dict[str, Any] = {
        "known": seen.known, "covariances": seen.covariances, "stamps": seen.stamps, "frame": pole_map.frame,
        "seed": seed,
    }  # fmt: skip
    planar = se3.to_se2(start)
    landmarks = PoleLandmarks(pole_map.poles, persistence(pole_map) if len(pole_map.sessions) > 1 else None)
    folder_facts: dict[str, Any] = {"map": map_name, "recording": drive.name, "method": method.value, "seed": seed}
    result: Result
    settings: PoleSmootherSettings | PoleFilterSettings
    distrusted: list[int] = []
    if method is Method.MCL:
        settings = filter_settings(pole_map) if config is None else read_config(config, PoleFilterSettings)
        if particles is not None:
            settings = settings.replaced(particles=particles)
        result = filter_poles(landmarks, seen.detections, seen.motions, planar, settings=settings, **about)
        name = "filtered"
    else:
        settings = PoleSmootherSettings() if config is None else read_config(config, PoleSmootherSettings)
        done = smooth_poles(landmarks, seen.detections, seen.motions, planar, settings=settings, **about)
        result, name = done.result, "smoothed"
        if done.result.rejected["metres farthest without a pole"] > settings.lost:
            gap = done.result.rejected["metres farthest without a pole"]
            console.print(f"[yellow]{gap} m without a pole of the map: odometry alone holds them[/yellow]")
        if done.account():
            console.print(done.account(), markup=False)
        distrusted = sorted({*done.distrusted.tolist(), *(int(k) for g in done.moved for k in g.landmarks)})
        folder_facts["landmarks distrusted"] = done.distrusted.tolist()
        folder_facts["landmarks moved"] = [
            {"landmarks": g.landmarks.tolist(), "shift_m": g.shift, "missed": g.missed} for g in done.moved
        ]
    folder = RunFolder(new_run_folder(output), plots)
    folder.write_settings(settings)
    folder.write_result(name, result)
    folder.write_account({name: result}, **folder_facts, reports=[str(report) for report in drive.reports])
    # As everywhere, a truth is taken to be in the frame of the map.
    truth = None if drive.truth is None else replace(drive.truth.to_2d(), world=pole_map.frame)
    if truth is not None:
        for which, report in folder.write_evaluation({name: result.trajectory}, truth).items():
            console.print(report.table(which))
    if plots:
        _draw(folder, pole_map, distrusted, result.trajectory, truth)
    kept = {what: count for what, count in result.rejected.items() if count}
    console.print(f"{name}: " + ", ".join(f"{count} {what}" for what, count in kept.items()))
    console.print(f"{name}: {result.summary()}, {result.seconds:.2f} s")
    console.print(f"results: {folder.folder} (also {output / 'latest'})")


def filter_settings(pole_map: PoleMap) -> PoleFilterSettings:
    """Published settings, with the epsilon of the map's second drive if it had one."""
    from factorloc.cli.pole_command import EPSILON
    from factorloc.errors import MapError
    from factorloc.localization.pole_filter import PoleFilterSettings

    told = pole_map.provenance.get(EPSILON)
    if told is None:
        return PoleFilterSettings()
    try:
        return PoleFilterSettings().replaced(epsilon=float(told))
    except ValueError as error:
        raise MapError(f"pole map: {EPSILON}: {told!r} is no positive number; make the map again") from error


def _draw(
    folder: RunFolder, pole_map: PoleMap, distrusted: list[int], path: Trajectory, truth: Trajectory | None
) -> None:
    from factorloc.viewer import plot_map_and_trajectories, save_figure

    paths = {"localized": path} | ({} if truth is None else {"truth": truth})
    figure = plot_map_and_trajectories(None, None, paths, reference=None if truth is None else "truth")
    axes = figure.axes[0]
    x, y = pole_map.positions.T
    axes.scatter(x, y, s=5, color="0.5", zorder=1)
    axes.scatter(x[distrusted], y[distrusted], s=20, color="C3", zorder=3, label="not trusted")
    file = folder.folder / "map.png"
    save_figure(figure, file)
    folder.files["map and paths"] = file
