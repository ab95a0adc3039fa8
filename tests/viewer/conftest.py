"""A small map and drives over it, for all tests of the room."""

from collections.abc import Callable

import numpy as np
import pytest

from factorloc.trajectory import Trajectory

Extent = tuple[float, float, float, float]


@pytest.fixture
def room() -> tuple[np.ndarray, Extent]:
    """Walls of a room, 20 m long along x and 10 m along y, in a raster of 30 by 20 m."""
    image = np.zeros((60, 40))
    image[10:50, [10, 29]] = 0.9
    image[[10, 49], 10:30] = 0.9
    return image, (-5.0, 25.0, 0.0, 20.0)


@pytest.fixture
def path() -> Callable[..., Trajectory]:
    def make(shift: float = 0.0, poses: int = 12, world: str = "map") -> Trajectory:
        x = np.linspace(2, 18, poses)
        rows = np.column_stack([x, 10 + shift + np.sin(x), np.zeros(poses)])
        return Trajectory(np.arange(poses) * 0.5, rows, world=world)

    return make
