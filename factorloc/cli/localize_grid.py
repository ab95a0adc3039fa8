"""What ``factorloc localize`` runs in a map of cells: the smoother, or Monte Carlo localization."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from factorloc.cli.console import console
from factorloc.cli.localize_methods import Method, by_particles, by_smoothing

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from factorloc.datasets import Drive
    from factorloc.mapping import BrickStatistics, RayStatistics

__all__ = ["localize_in_grid"]


def localize_in_grid(
    statistics: RayStatistics | BrickStatistics,
    map_name: str,
    drive: Drive,
    start: npt.NDArray[np.float64] | None,
    method: Method,
    config: Path | None,
    output: Path,
    *,
    model: str,
    floor: float,
    particles: int | None,
    height: float,
    seed: int,
    scans: str,
    plots: bool,
) -> None:
    """Localize a drive and write trajectories, metrics and figures into a new run folder.

    Parameters
    ----------
    statistics : RayStatistics or BrickStatistics
        The map.
    map_name : str
        What its file is called.
    drive : Drive
        Scans and odometry; judged by its truth, if it has one.
    start : ndarray, shape (3,) or (4, 4), optional
        About where it begins; anywhere in free space by default.
    method : Method
        Smoother or particles. Only particles begin anywhere.
    config : Path, optional
        Settings of the method.
    output : Path
        Folder of all runs.
    model : str
        Sensor model of the particles.
    floor : float
        Least rate (1/m) or probability of its most likely maps.
    particles : int, optional
        How many at most.
    height : float
        Of a start anywhere in space, m.
    seed : int
        Of the particles.
    scans : str
        Which scans of the recording these are, for the account.
    plots : bool
        Whether to draw.
    """
    from factorloc.localization.run_folder import RunFolder, new_run_folder

    filtered = method is Method.MCL or start is None
    if filtered:
        settings, results = by_particles(
            statistics, drive, start, config, model=model, floor=floor, particles=particles, height=height, seed=seed
        )
    else:
        assert start is not None
        settings, results = by_smoothing(statistics, drive, start, config)
    folder = RunFolder(new_run_folder(output), plots)
    folder.write_settings(settings)
    for name, result in results.items():
        folder.write_result(name, result)
    folder.write_account(
        results, map=map_name, recording=drive.name, scans=scans, method=method.value,
        model=model if filtered else None, seed=seed if filtered else None,
        reports=[str(report) for report in drive.reports],
    )  # fmt: skip
    paths = {name: result.trajectory for name, result in results.items()}
    if drive.truth is not None:
        for name, report in folder.write_evaluation(paths, drive.truth).items():
            console.print(report.table(name))
    folder.draw(statistics, paths, results, drive.truth)
    for name, result in results.items():
        console.print(f"{name}: {result.summary()}, {result.seconds:.2f} s")
    console.print(f"results: {folder.folder} (also {output / 'latest'})")
