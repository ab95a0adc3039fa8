"""Lidars as sold: beam tables, resolution, range and noise after their data sheets, at ten turns a second.

Each function takes settings of :class:`~factorloc.simulation.spatial_lidar.SpatialLidar` that replace those of the data
sheet, for example ``vlp_16(T_body_sensor=mount, dropout=0.02)``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from factorloc.simulation.spatial_lidar import SpatialLidar

__all__ = ["hdl_32e", "hdl_64e", "os_128", "vlp_16"]


def hdl_64e(**settings: Any) -> SpatialLidar:
    """Velodyne HDL-64E: 32 beams from 2 to -8.33 degrees, 32 from -8.83 to -24.33; 0.1728 degrees a column, 120 m."""
    upper, lower = 2.0 - np.arange(32) / 3, -8.83 - np.arange(32) / 2
    return _model(np.concatenate([upper, lower]), 2083, (0.9, 120.0), 0.02, settings)


def hdl_32e(**settings: Any) -> SpatialLidar:
    """Velodyne HDL-32E: 32 beams from 10.67 to -30.67 degrees; 2170 columns, 100 m."""
    return _model(32 / 3 - np.arange(32) * 4 / 3, 2170, (1.0, 100.0), 0.02, settings)


def vlp_16(**settings: Any) -> SpatialLidar:
    """Velodyne VLP-16: 16 beams from 15 to -15 degrees; 0.2 degrees a column, 100 m."""
    return _model(15.0 - np.arange(16) * 2, 1800, (0.5, 100.0), 0.03, settings)


def os_128(**settings: Any) -> SpatialLidar:
    """A lidar of 128 beams evenly from 22.5 to -22.5 degrees, as of the Ouster OS1; 1024 columns (or 2048), 120 m."""
    return _model(np.linspace(22.5, -22.5, 128), 1024, (0.5, 120.0), 0.02, settings)


def _model(
    degrees: npt.NDArray[np.floating[Any]],
    columns: int,
    range_limits: tuple[float, float],
    range_sigma: float,
    settings: dict[str, Any],
) -> SpatialLidar:
    sheet = {"columns": columns, "range_limits": range_limits, "range_sigma": range_sigma}
    return SpatialLidar(**{"elevations": tuple(np.deg2rad(degrees).tolist()), **sheet, **settings})
