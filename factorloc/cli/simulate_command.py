"""``factorloc simulate``: drives through simulated worlds, as recordings."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from factorloc.cli.console import console, progress_bar

__all__ = ["LidarModel", "SimulatedWorld", "simulate"]


class SimulatedWorld(StrEnum):
    """What is driven through."""

    STREET = "street"
    TOWN = "town"


class LidarModel(StrEnum):
    """What is driven around."""

    HDL_64E = "hdl-64e"
    HDL_32E = "hdl-32e"
    VLP_16 = "vlp-16"
    OS_128 = "os-128"


def simulate(
    world: Annotated[SimulatedWorld, typer.Argument(help="A street, or a session of a town.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of KITTI's odometry layout.")] = Path(
        "simulated"
    ),
    sequence: Annotated[str, typer.Option(help="Number of the sequence in it.")] = "00",
    lidar: Annotated[LidarModel, typer.Option(help="The sensor.")] = LidarModel.HDL_64E,
    seed: Annotated[int, typer.Option(help="Which of all such worlds.")] = 0,
    drive: Annotated[int, typer.Option(min=0, help="Which drive: noise of the sensors; session of the town.")] = 0,
    period: Annotated[float, typer.Option(min=0.01, help="Time between two scans, s.")] = 0.2,
    scans: Annotated[int | None, typer.Option(min=2, help="Most scans; the whole route if not given.")] = None,
    columns: Annotated[
        int | None, typer.Option(min=16, help="Columns a turn; those of the sensor if not given.")
    ] = None,
) -> None:
    """Drive a lidar through a simulated world and write what it saw as a KITTI sequence, with its true poses.

    [bold]Examples[/bold]

    [green]factorloc simulate street -o world --sequence 00[/green]

    [green]factorloc simulate street -o world --sequence 01 --drive 1[/green]

    [green]factorloc map build world/sequences/00 -o street.h5[/green]

    [green]factorloc localize street.h5 world/sequences/01[/green]
    """
    from dataclasses import replace

    from factorloc.simulation import (
        Sessions,
        Town,
        hdl_32e,
        hdl_64e,
        os_128,
        simulate_drive,
        street_route,
        street_world,
        vlp_16,
        write_kitti,
    )

    models = {
        LidarModel.HDL_64E: hdl_64e,
        LidarModel.HDL_32E: hdl_32e,
        LidarModel.VLP_16: vlp_16,
        LidarModel.OS_128: os_128,
    }
    sensor = models[lidar](**({} if columns is None else {"columns": columns}))
    if world is SimulatedWorld.STREET:
        # Another speed, so that no scan is taken where one was before.
        surroundings, route = street_world(seed=seed), street_route(speed=8.0 - 0.7 * (drive % 8))
    else:
        session = Sessions(Town(seed=seed)).session(drive)
        surroundings, route = session.world, session.route
    name = f"{world}-{seed}-{drive}"
    found = simulate_drive(surroundings, route, sensor, seed=drive + 1, period=period, name=name, keep_scans=False)
    if scans is not None and scans < len(found):
        # The format holds no odometry.
        some = slice(scans)
        found = replace(found, scans=found.scans[some], truth=found.truth.select(some), odometry=found.odometry[:0])
    with progress_bar("simulating", len(found)) as progress:
        write_kitti(output, found, sequence, progress=progress)
    console.print(
        f"{output / 'sequences' / sequence}: {len(found)} scans of {lidar}, {found.truth.length:.0f} m, "
        f"through {world} {seed}; true poses in {output / 'poses' / f'{sequence}.txt'}"
    )
