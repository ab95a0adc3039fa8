"""Point clouds for Open3D, the optional library whose wheel needs libraries of the system."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from factorloc.errors import MissingLibraryError
from factorloc.geometry import se2, se3

if TYPE_CHECKING:
    from factorloc.scan import Scan

__all__ = ["load_open3d", "to_open3d"]

_SYSTEM_PACKAGES = "libusb-1.0-0 libgl1 libx11-6 libgomp1"


def load_open3d() -> Any:
    """Import Open3D, late, and say what is missing when that fails.

    Raises
    ------
    MissingLibraryError
        If Open3D is not installed, or a system library it links to is not there.
    """
    try:
        import open3d
    except ModuleNotFoundError as error:
        raise MissingLibraryError("open3d is not installed: pip install 'factorloc[open3d]'") from error
    except (ImportError, OSError) as error:
        reason = " ".join(str(error).split())
        raise MissingLibraryError(
            f"open3d cannot be loaded ({reason}): apt install {_SYSTEM_PACKAGES}; it also needs glibc 2.35 or newer"
        ) from error
    return open3d


def to_open3d(scan: Scan, T_world_body: npt.ArrayLike | None = None) -> Any:
    """Turn the returns of a scan into an ``open3d.geometry.PointCloud``.

    Parameters
    ----------
    scan : Scan
        Planar scans are laid into z = 0.
    T_world_body : array_like, shape (3,) or (4, 4), optional
        Pose of the body; the points are in the body frame without it.

    Returns
    -------
    open3d.geometry.PointCloud
        One point a return, m.

    Raises
    ------
    MissingLibraryError
        If Open3D cannot be imported.
    """
    open3d = load_open3d()
    points = scan.points()
    if scan.dimension == 2:
        points = se2.transform(scan.T_body_sensor, points)
        points = points if T_world_body is None else se2.transform(T_world_body, points)
        points = np.column_stack([points, np.zeros(len(points))])
    else:
        points = se3.transform(scan.T_body_sensor, points)
        points = points if T_world_body is None else se3.transform(T_world_body, points)
    cloud = open3d.geometry.PointCloud()
    cloud.points = open3d.utility.Vector3dVector(points)
    return cloud
