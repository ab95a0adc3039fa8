"""``factorloc info``: what a file holds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from factorloc.cli.console import console

__all__ = ["info"]


def info(
    path: Annotated[
        Path, typer.Argument(help="A map, a map of poles or of buildings, a recording, or the folder of a run.")
    ],
) -> None:
    """Tell what a map, a recording or a run holds.

    [bold]Examples[/bold]

    [green]factorloc info intel.h5[/green]

    [green]factorloc info town.osm[/green]

    [green]factorloc info intel.clf.bz2[/green]

    [green]factorloc info poles.geojson[/green]

    [green]factorloc info results/latest[/green]
    """
    from factorloc.datasets import BUILDING_READERS, READERS
    from factorloc.mapping import is_pole_map

    if path.is_dir() and (path / "run.json").exists():
        _show("run", _run_facts(path))
    elif is_pole_map(path):
        _show("pole map", _pole_facts(path))
    elif path.suffix in (".h5", ".hdf5"):
        _show(*_map_facts(path))
    elif path.is_file() and any(known.matches(path) for known in BUILDING_READERS):
        _show("building map", _building_facts(path))
    elif path.is_dir() and not any(reader.matches(path) for reader in READERS):
        _show("run", _run_facts(path))
    else:
        _show("recording", _drive_facts(path))


def _show(kind: str, facts: dict[str, str]) -> None:
    from rich.table import Table

    table = Table.grid(padding=(0, 2))
    table.add_row("[bold]kind[/bold]", kind)
    for name, value in facts.items():
        table.add_row(f"[bold]{name}[/bold]", value)
    console.print(table)


def _map_facts(path: Path) -> tuple[str, dict[str, str]]:
    from factorloc.cli.facades_command import facade_facts
    from factorloc.mapping import is_facade_map, read_facade_map, read_map_info

    if is_facade_map(path):
        return "facade map", facade_facts(read_facade_map(path))
    found = read_map_info(path)
    grid = found.grid
    return "map", {
        "cells": " x ".join(map(str, grid.shape)),
        "resolution": f"{grid.resolution} m",
        "frame": grid.frame,
        "lowest corner": ", ".join(f"{value:.2f}" for value in grid.origin) + " m",
        "highest corner": ", ".join(f"{value:.2f}" for value in grid.upper) + " m",
        "scans": str(found.scans),
        "in memory": f"{found.cell_bytes / 2**20:.1f} MiB",
        "left out": ", ".join(f"{count} {reason}" for reason, count in found.left_out.items()) or "nothing",
        **{f"provenance: {name}": value for name, value in found.provenance.items()},
    }


def _building_facts(path: Path) -> dict[str, str]:
    from factorloc.datasets import read_buildings

    found = read_buildings(path)
    frame = found.frame
    return {
        "buildings": str(len(found)),
        "heights": f"known of {sum(outline.height is not None for outline in found.outlines)}",
        "middle": "" if frame is None else f"longitude {frame.longitude:.7f}°, latitude {frame.latitude:.7f}°",
        "left out": ", ".join(f"{count} {reason}" for reason, count in found.left_out.items()) or "nothing",
        "mended": ", ".join(f"{deed}: {count}" for deed, count in found.mended.items()) or "nothing",
        **({"notes": "; ".join(found.notes)} if found.notes else {}),
        **({"attribution": found.attribution} if found.attribution else {}),
    }


def _pole_facts(path: Path) -> dict[str, str]:
    import numpy as np

    from factorloc.mapping import read_pole_map

    found = read_pole_map(path)
    place, rates = found.georeference, found.detection_rates
    facts = {"poles": str(len(found)), "frame": found.frame}
    if len(found):
        low, high = found.positions.min(0), found.positions.max(0)
        facts["from"] = ", ".join(f"{value:.2f}" for value in low) + " m"
        facts["to"] = ", ".join(f"{value:.2f}" for value in high) + " m"
        facts["widths"] = f"{found.poles.widths.min():.2f} to {found.poles.widths.max():.2f} m"
        if np.isfinite(rates).any():
            facts["found where in view"] = f"{np.nanmean(rates):.0%} of the times"
    facts["sessions"] = ", ".join(found.sessions)
    facts["coordinate system"] = "none: local coordinates only"
    if place is not None:
        east, north, yaw = place.T_crs_map.tolist()
        facts["coordinate system"] = place.crs
        facts["origin"] = f"east {east:.3f} m, north {north:.3f} m, x axis {np.degrees(yaw):.2f} deg from east"
    return facts | {f"provenance: {name}": value for name, value in found.provenance.items()}


def _drive_facts(path: Path) -> dict[str, str]:
    import numpy as np

    from factorloc.datasets import open_drive

    drive = open_drive(path)
    scan = drive.scans[0]
    returns = np.mean([s.is_return.mean() for s in drive.scans])
    known = int(drive.odometry_known.sum())
    facts = {
        "scans": str(len(drive)),
        "beams": str(len(scan)),
        "range": f"{scan.range_limits[0]:g} to {scan.range_limits[1]:g} m, {returns:.1%} of the rays return",
        "odometry": f"{known} of {len(drive) - 1} motions, {drive.dead_reckoning().length:.1f} m",
        "truth": "none" if drive.truth is None else f"{len(drive.truth)} poses, {drive.truth.length:.1f} m",
    }
    for number, report in enumerate(drive.reports):
        facts["file" if len(drive.reports) == 1 else f"file {number + 1}"] = str(report)
    return facts


def _run_facts(path: Path) -> dict[str, str]:
    import json

    from factorloc.errors import DataError

    account = path / "run.json"
    try:
        facts = json.loads(account.read_text(encoding="utf-8"))
        results = facts["results"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DataError(f"{account}: missing or damaged; is {path} the folder of a run?") from error
    shown = {name: str(facts[name]) for name in ("map", "recording", "scans", "written") if name in facts}
    for name, result in results.items():
        shown[name] = f"{result['poses']} poses over {result['length_m']:.1f} m; {result['stop']}"
    return shown
