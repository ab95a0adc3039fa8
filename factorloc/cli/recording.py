"""Options of all commands that read recordings."""

from __future__ import annotations

from typing import Annotated, Any

import typer

__all__ = ["Mount", "reader_options"]

Mount = Annotated[
    tuple[float, float, float, float, float, float] | None,
    typer.Option(
        metavar="X Y Z ROLL PITCH YAW",
        help="Where the lidar sits on the body, m and degrees, for recordings in space without calibration.",
    ),
]
"""Option for the pose of a lidar on the body."""


def reader_options(mount: tuple[float, ...] | None) -> dict[str, Any]:
    """Return the options of a reader that were given on the command line."""
    if mount is None:
        return {}
    import numpy as np
    from scipy.spatial.transform import Rotation

    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xyz", mount[3:], degrees=True).as_matrix()
    pose[:3, 3] = mount[:3]
    return {"T_body_sensor": pose}
