import math

import numpy as np
import pytest
from carmen_corridor import flaser, odom
from hypothesis import given
from hypothesis import strategies as st

from factorloc.datasets.carmen_lines import LineError, parse_flaser, parse_odom, parse_robotlaser

POSE = st.tuples(*[st.floats(-1e3, 1e3)] * 3)
TAIL = "7.5 robot 0.5"


def robotlaser(ranges: list[float], start: float, resolution: float, limit: float, remissions: str, axis: str) -> str:
    values = " ".join(map(str, ranges))
    head = f"ROBOTLASER1 0 {start} 3.1 {resolution} {limit} 0.01 0 {len(ranges)} {values}"
    return f"{head} {remissions} 1 2 0.3 0.9 2 0.3 0.1 0.2 0.3 0.4 {axis} {TAIL}"


@pytest.mark.parametrize(("beams", "degrees"), [(180, 1.0), (181, 1.0), (360, 0.5), (361, 0.5)])
def test_beams_start_right_and_are_whole_or_half_degrees_apart(beams: int, degrees: float) -> None:
    line = parse_flaser(flaser([1.0] * beams, (0, 0, 0), (0, 0, 0), 0, 0).split())
    angles = line.layout.angles()
    np.testing.assert_allclose(np.degrees(angles), -90 + degrees * np.arange(beams), atol=1e-12)
    assert len(angles) == beams


@given(POSE, POSE, st.floats(-1e9, 1e9), st.lists(st.floats(0, 90), min_size=180, max_size=180))
def test_a_flaser_line_gives_back_what_was_written(laser, robot, key: float, ranges: list[float]) -> None:
    line = parse_flaser(flaser(ranges, laser, robot, key, key + 1, ".17g").split())
    assert (line.laser_pose, line.robot_pose, line.key, line.stamp) == (laser, robot, key, key + 1)
    np.testing.assert_allclose(line.ranges, ranges, atol=0.005 + 1e-9)


@pytest.mark.parametrize(("remissions", "axis"), [("0", "0.5"), ("3 0.1 0.2 0.3", "0.5"), ("", "")])
def test_a_robotlaser_line_carries_its_own_beams_in_both_forms(remissions: str, axis: str) -> None:
    line = parse_robotlaser(robotlaser([1.0, 2.0, 3.0], -0.7, 0.6, 30.0, remissions, axis).split())
    np.testing.assert_allclose(line.layout.angles(), [-0.7, -0.1, 0.5])
    assert line.layout.max_range == 30
    assert line.ranges == [1, 2, 3]
    assert (line.laser_pose, line.robot_pose) == ((1, 2, 0.3), (0.9, 2, 0.3))
    assert (line.key, line.stamp) == (7.5, 0.5)


def test_an_odom_line_gives_pose_and_logger_time() -> None:
    assert parse_odom(odom((1, -2, 0.5), 7).split()) == (1, -2, 0.5, 7)


def test_infinity_is_a_range() -> None:
    line = parse_flaser(flaser([math.inf] * 180, (0, 0, 0), (0, 0, 0), 0, 0).split())
    assert line.ranges == [math.inf] * 180


GOOD = flaser([1.5] * 180, (0, 0, 0), (0, 0, 0), 1, 2).split()


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (GOOD[:1], "cut short"),
        (GOOD[:100], "number of fields"),
        (["FLASER", "x", *GOOD[2:]], "not a whole number"),
        (["FLASER", "0", *GOOD[182:]], "not positive"),
        (["FLASER", "179", *GOOD[3:]], "unknown angles"),
        ([*GOOD[:9], "oops", *GOOD[10:]], "not a number"),
        ([*GOOD[:9], "nan", *GOOD[10:]], "range is NaN"),
        ([*GOOD[:8], "nan", "-1", *GOOD[10:]], "range is NaN"),
        ([*GOOD[:9], "-0.1", *GOOD[10:]], "range is negative"),
        ([*GOOD[:9], "-inf", *GOOD[10:]], "range is negative"),
        ([*GOOD[:8], "inf", "-inf", *GOOD[10:]], "range is negative"),
        ([*GOOD[:184], "nan", *GOOD[185:]], "pose or time is not finite"),
        ([*GOOD[:-1], "inf"], "pose or time is not finite"),
    ],
)
def test_a_damaged_flaser_line_says_why(words: list[str], reason: str) -> None:
    with pytest.raises(LineError, match=reason):
        parse_flaser(words)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (robotlaser([1.0, 2.0], 0, 0.5, 0, "0", "1"), "out of bounds"),
        (robotlaser([1.0, 2.0], 0, -0.5, 30, "0", "1"), "out of bounds"),
        (robotlaser([1.0, 2.0], 0, math.nan, 30, "0", "1"), "out of bounds"),
        (robotlaser([1.0, 2.0], 0, 0.5, 30, "5", "1"), "number of fields"),
        (robotlaser([1.0, -2.0], 0, 0.5, 30, "0", "1"), "range is negative"),
        ("ROBOTLASER1 0 1 2", "cut short"),
        ("ROBOTLASER1 0 -1.5 3.1 0.5 30 0 0 4 1 2 3 4", "cut short"),
    ],
)
def test_a_damaged_robotlaser_line_says_why(line: str, reason: str) -> None:
    with pytest.raises(LineError, match=reason):
        parse_robotlaser(line.split())


@pytest.mark.parametrize("line", ["ODOM 1 2 3", "ODOM 1 2 nan 0 0 0 0 robot 0", "ODOM 1 2 x 0 0 0 0 robot 0"])
def test_a_damaged_odom_line_is_an_error(line: str) -> None:
    with pytest.raises(LineError, match="ODOM"):
        parse_odom(line.split())
