"""A result says why it stopped, in one line."""

import numpy as np
import pytest

from factorloc.result import Iteration, Result, StopReason
from factorloc.trajectory import Trajectory


@pytest.mark.parametrize("stop", list(StopReason))
def test_the_summary_names_poses_cost_iterations_and_the_reason(stop: StopReason) -> None:
    history = tuple(Iteration(level=0.0, cost=cost, damping=1e-4, trials=1) for cost in (9.0, 4.0, 2.5))
    result = Result(Trajectory(np.arange(2.0), np.zeros((2, 3))), 2.5, history, stop)
    assert result.iterations == 3
    assert result.converged == stop.value.startswith("converged")
    assert result.summary() == f"2 poses, cost 2.50, 3 iterations, {stop.value}"
