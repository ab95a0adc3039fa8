import numpy as np
import pytest

from factorloc.result import Iteration, Result, StopReason
from factorloc.viewer import plot_cost_history


def result(path, costs, levels=None, damping=1e-3, stop=StopReason.CONVERGED):
    levels = [0.0] * len(costs) if levels is None else levels
    history = tuple(Iteration(level, cost, damping, 1) for level, cost in zip(levels, costs, strict=True))
    return Result(path(), 0.0, history, stop)


def test_one_line_a_level_over_all_iterations(path):
    upper, lower = plot_cost_history(result(path, [9, 8, 7, 6, 5], [0.8, 0.8, 0.4, 0, 0])).axes
    lines = [line for line in upper.lines if not line.get_label().startswith("_")]
    assert [line.get_label() for line in lines] == ["blur 0.8 m", "blur 0.4 m", "map itself"]
    np.testing.assert_array_equal(np.concatenate([line.get_xydata() for line in lines])[:, 0], [1, 2, 3, 4, 5])
    np.testing.assert_array_equal(np.concatenate([line.get_xydata() for line in lines])[:, 1], [9, 8, 7, 6, 5])
    assert upper.get_title(loc="right") == StopReason.CONVERGED.value
    assert lower.get_yscale() == "log"


@pytest.mark.parametrize(("costs", "scale"), [([100, 1], "log"), ([100, 90], "linear"), ([100, -1], "linear")])
def test_scale_follows_the_costs(path, costs, scale):
    assert plot_cost_history(result(path, costs)).axes[0].get_yscale() == scale


def test_undamped_steps_have_a_linear_axis(path):
    assert plot_cost_history(result(path, [2, 1], damping=0.0)).axes[1].get_yscale() == "linear"


def test_without_iterations_the_reason_is_written(path):
    (axes,) = plot_cost_history(result(path, [], stop=StopReason.SEQUENTIAL)).axes
    assert StopReason.SEQUENTIAL.value in axes.texts[0].get_text()
