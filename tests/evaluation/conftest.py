"""Random drives and disturbed copies of them, for all tests of the room."""

from collections.abc import Callable

import numpy as np
import pytest

from factorloc.geometry import se2, se3
from factorloc.trajectory import Trajectory

Pair = tuple[Trajectory, Trajectory]


def _drive(dimension: int, poses: int = 120, noise: float = 0.05, seed: int = 0) -> Pair:
    """An estimate and its truth: a winding drive, disturbed in the body frame."""
    rng = np.random.default_rng(seed)
    if dimension == 2:
        group, steps = se2, np.column_stack([rng.uniform(0.2, 0.9, poses), np.zeros(poses), rng.normal(0, 0.2, poses)])
    else:
        group = se3
        steps = np.column_stack([rng.normal(0, 0.1, (poses, 3)), rng.uniform(0.2, 0.9, poses), np.zeros((poses, 2))])
    truth = [group.identity()]
    for motion in group.exp(steps[1:]):
        truth.append(group.compose(truth[-1], motion))
    stamps = np.arange(poses) * 0.1
    estimate = group.compose(np.array(truth), group.exp(rng.normal(0, noise, steps.shape)))
    return Trajectory(stamps, estimate), Trajectory(stamps, np.array(truth))


@pytest.fixture(scope="session")
def drive() -> Callable[..., Pair]:
    return _drive
