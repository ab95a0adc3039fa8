"""``factorloc demo``: the whole chain on a simulated building."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from factorloc.cli.console import Threads, console, progress_bar, use_threads

__all__ = ["demo"]


def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of all runs.")] = Path("results"),
    seed: Annotated[int, typer.Option(help="Seed of the simulation.")] = 1,
    plots: Annotated[bool, typer.Option(help="Draw figures.")] = True,
    threads: Threads = None,
) -> None:
    """Simulate a building with glass and plants, map it on one drive and localize a second from a wrong start.

    [bold]Example[/bold]

    [green]factorloc demo[/green]
    """
    import time

    import numpy as np

    from factorloc._jit import cache_folder, compile_seconds
    from factorloc.geometry import se2
    from factorloc.localization import LocalizationSettings, localize
    from factorloc.localization.run_folder import RunFolder, new_run_folder
    from factorloc.mapping import RayStatistics, write_map
    from factorloc.simulation import integrate_odometry, office_plan, office_routes, simulate_drive
    from factorloc.trajectory import Trajectory

    use_threads(threads)
    began = time.perf_counter()
    folder = RunFolder(new_run_folder(output), plots)
    plan, (mapping_route, second_route) = office_plan(), office_routes()
    first = simulate_drive(plan, mapping_route, seed=seed, name="mapping drive")
    second = simulate_drive(plan, second_route, seed=seed + 1, name="second drive")

    with progress_bar("mapping the first drive", len(first)) as progress:
        statistics = RayStatistics.from_scans(first.scans, first.truth.poses, progress=progress)
    write_map(folder.folder / "map.h5", statistics, provenance={"recording": "simulated office, first drive"})

    # The true start is 0.9 m and 9 degrees away from where we say it is.
    wrong = se2.compose(second.truth.poses[0], [0.7, -0.56, np.radians(9.0)])
    settings = LocalizationSettings()
    with progress_bar("localizing the second", len(second)) as progress:
        found = localize(statistics, second.scans, second.odometry, wrong, settings=settings, progress=progress)

    odometry = Trajectory(second.stamps, integrate_odometry(wrong, second.odometry))
    results = {"tracked": found.tracked, "smoothed": found.smoothed}
    paths = {"odometry": odometry, **{name: result.trajectory for name, result in results.items()}}
    folder.write_settings(settings)
    for name, result in results.items():
        folder.write_result(name, result)
    second.truth.write_tum(folder.folder / "truth.tum")
    folder.write_account(results, map="map.h5", recording=second.name, seed=seed)
    reports = folder.write_evaluation(paths, second.truth)
    folder.draw(statistics, paths, results, second.truth)
    _show(reports, statistics.grid.cells)

    compiled = compile_seconds()
    total = time.perf_counter() - began
    kept = f"; kernels are kept in {cache_folder}" if compiled else ""
    console.print(f"[dim]{total:.1f} s, of which {compiled:.1f} s compiling{kept}[/dim]", soft_wrap=True)
    for role, path in folder.files.items():
        if path.suffix == ".png":
            console.print(f"picture: {path} ({role})", soft_wrap=True)
    console.print(f"all files: {folder.folder} (also {output / 'latest'})", soft_wrap=True)
    console.print(
        "\nWith your own data:\n"
        "  factorloc map build LOG-corrected.log.gz --scans even -o my.h5\n"
        "  factorloc localize my.h5 LOG.clf --truth LOG-corrected.log.gz --scans odd\n"
    )


def _show(reports: object, cells: int) -> None:
    from typing import cast

    from rich.table import Table

    from factorloc.evaluation import Report

    table = Table(title=f"Errors against the truth in a map of {cells} cells", title_justify="left")
    for header in ("", "RMSE (m)", "95 % (m)", "max (m)", "heading RMSE (deg)"):
        table.add_column(header, justify="right" if header else "left")
    names = {"odometry": "before: odometry", "tracked": "after: tracked", "smoothed": "after: smoothed"}
    for name, report in cast("dict[str, Report]", reports).items():
        position = report.metrics["absolute translation"]
        heading = report.metrics["absolute heading"].in_degrees()
        figures = (position.rmse, position.percentile_95, position.max, heading.rmse)
        table.add_row(names[name], *(f"{figure:.3f}" for figure in figures))
    console.print(table)
