"""Degenerate scans and maps: every sensor model answers with numbers or with a clear error, never with NaN."""

import warnings

import numpy as np
import pytest

from factorloc.errors import MapError
from factorloc.mapping import BrickStatistics, Grid, RayStatistics
from factorloc.mapping.sensor_models import SENSOR_MODELS, make_sensor_model
from factorloc.scan import RayStatus, Scan

Statistics = RayStatistics | BrickStatistics

LIMITS = (0.1, 20.0)


def fan(dimension: int, status: RayStatus = RayStatus.RETURN, rays: int = 60) -> Scan:
    """Rays of 3 m, or out of range, all around."""
    length = {RayStatus.RETURN: 3.0, RayStatus.BELOW_MINIMUM: LIMITS[0], RayStatus.NO_RETURN: LIMITS[1]}[status]
    directions = np.random.default_rng(0).standard_normal((rays, dimension))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    return Scan(directions, np.full(rays, length), np.full(rays, status, np.uint8), LIMITS)


def room(dimension: int, status: RayStatus = RayStatus.RETURN) -> Statistics:
    """Map of one scan, sparse in space."""
    grid = Grid((-5.0,) * dimension, 0.5, (20,) * dimension)
    if dimension == 2:
        return RayStatistics.from_scans([fan(2, status)], np.zeros((1, 3)), grid=grid)
    return BrickStatistics.from_scans([fan(3, status)], np.eye(4)[None], grid=grid)


def pose(dimension: int, x: float) -> np.ndarray:
    if dimension == 2:
        return np.array([x, 0.0, 0.0])
    T = np.eye(4)
    T[0, 3] = x
    return T


@pytest.mark.parametrize("name", SENSOR_MODELS)
@pytest.mark.parametrize("dimension", [2, 3])
def test_scans_that_say_nothing_and_poses_outside_the_map_are_answered(dimension: int, name: str) -> None:
    model = make_sensor_model(room(dimension), name)
    for scan in (*(fan(dimension, status) for status in RayStatus), fan(dimension, rays=1).select(np.zeros(0, int))):
        for x in (0.0, 1e4):  # in the middle of the map, and far outside
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                each = model.log_likelihood(scan, pose(dimension, x))
                sums = model.scan_log_likelihoods(scan, np.stack([pose(dimension, x)] * 3))
            assert each.shape == (len(scan),)
            assert not (np.isnan(each) | (each == np.inf)).any()
            assert sums == pytest.approx([each.sum()] * 3, rel=1e-5, abs=1e-4)


@pytest.mark.parametrize("name", SENSOR_MODELS)
@pytest.mark.parametrize("dimension", [2, 3])
def test_maps_without_a_reflection_are_refused(dimension: int, name: str) -> None:
    grid = Grid((-5.0,) * dimension, 0.5, (20,) * dimension)
    empty = RayStatistics.empty(grid) if dimension == 2 else BrickStatistics.empty(grid)
    for statistics in (empty, room(dimension, RayStatus.NO_RETURN)):
        with pytest.raises(MapError, match=r"map: no cell (was hit|is occupied); (there is nothing|lower)"):
            make_sensor_model(statistics, name)
