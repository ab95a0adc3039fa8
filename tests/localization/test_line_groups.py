"""Cores of lines: what they weigh, that they lie within their hulls, and that sets with them keep the truth."""

from dataclasses import replace

import numpy as np
from facade_street import crossing, points_on
from hypothesis import given
from hypothesis import strategies as st
from test_facade_localization import facing, line_of

from factorloc.intervals import Interval
from factorloc.localization import find_correspondences
from factorloc.localization.correspondence import Correspondence
from factorloc.localization.feasible_set import intersect_correspondences
from factorloc.localization.feasible_settings import FeasibleSettings
from factorloc.localization.line_groups import LineGroups
from factorloc.localization.line_weights import weights_of
from factorloc.localization.wall_lines import WallLines
from factorloc.result import Bounds

POSE = np.array([0.3, -0.2, 0.1])

some_lines = st.lists(
    st.tuples(st.integers(0, 4), st.floats(0.002, 0.45), st.booleans(), st.floats(0.02, 0.4)), min_size=0, max_size=12
)


def line(facade, doubt, cored, core_doubt):
    hull, core = Interval(-0.1, 0.1), Interval(-0.02, 0.02)
    return Correspondence(
        facade, np.zeros(2), hull, hull, 50, 0.1, 1.0, (-1.0, 1.0), (-5.0, 5.0), doubt,
        (core, core) if cored else None, core_doubt,
    )  # fmt: skip


@given(some_lines)
def test_every_facade_counts_once_and_its_core_a_part_of_it(drawn):
    found = [line(*one) for one in drawn]
    groups = LineGroups.of(found)
    assert groups.count == len(found)
    assert len(groups.lines) == len(found) + sum(one.core is not None for one in found)
    np.testing.assert_array_equal(groups.facades, np.unique([one.facade for one in found]).astype(int))
    assert groups.groups[0] == 0
    assert groups.groups[-1] == len(groups.lines)
    assert (np.diff(groups.groups) > 0).all()
    sources = groups.sources
    for k, (first, last) in enumerate(zip(groups.groups[:-1], groups.groups[1:], strict=True)):
        assert len(set(sources[first:last])) == 1
        inner = k >= len(groups.facades)
        assert all((one.alpha.width < 0.1) == inner for one in groups.lines[first:last])
    for k, facade in enumerate(groups.facades):
        own = min((one for one in found if one.facade == facade), key=lambda one: one.doubt)
        assert groups.doubts[k] == own.doubt
        cores = [j for j in range(len(groups.facades), len(groups.weights)) if sources[groups.groups[j]] == facade]
        if not cores:
            assert groups.weights[k] == weights_of(np.array([own.doubt]))[0]
            continue
        (core,) = cores
        assert groups.weights[k] >= 1
        assert groups.weights[core] >= 0
        q = groups.lines[groups.groups[core]].core_doubt
        inside = 1.0 - own.doubt - q
        if own.doubt < inside:
            # Outside of everything, outside of the core: odds of p and of q to those of being inside.
            assert abs(groups.weights[k] + groups.weights[core] - 8 * np.log(inside / own.doubt)) <= 0.51 + 0.5
        if own.doubt < 0.8 * q and q < inside:
            assert abs(groups.weights[core] - 8 * np.log(inside / q)) <= 0.51


def test_cores_lie_within_their_hulls_and_are_narrower():
    rng = np.random.default_rng(3)
    facades, true = crossing(rng)
    walls = WallLines(facades)
    points = points_on(true, facing(walls, POSE), POSE, rng)[0]
    found = find_correspondences(points, walls, Bounds.around(POSE, 3.0, np.radians(3.0))).found
    assert len(found) > 5
    for one in found:
        for hull, core in zip((one.alpha, one.d), one.core, strict=True):
            assert hull.lo <= core.lo < core.hi <= hull.hi
    assert sum(float(one.core[0].width) for one in found) < 0.7 * sum(float(one.alpha.width) for one in found)


def cored(one, slack):
    return replace(
        one, core=(Interval.around(float(one.alpha.mid), slack), Interval.around(float(one.d.mid), slack)),
        core_doubt=0.1,
    )  # fmt: skip


def test_sets_with_right_cores_are_smaller_and_hold_the_truth():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        facades, true = crossing(rng)
        walls = WallLines(facades)
        pose = np.array([*rng.uniform(-4, 4, 2), rng.uniform(-np.pi, np.pi)])
        start = Bounds.around(pose, 4.0, np.radians(5.0))
        plain = tuple(
            replace(one, alpha=Interval.around(float(one.alpha.mid), 0.06), d=Interval.around(float(one.d.mid), 0.4))
            for one in (line_of(walls, true, row, pose) for row in facing(walls, pose)[:6])
        )
        narrow = tuple(cored(one, 0.01) for one in plain)
        settings = FeasibleSettings(confidence=0.99)
        with_cores = intersect_correspondences(narrow, walls, start, settings)
        without = intersect_correspondences(plain, walls, start, settings)
        assert with_cores.bounds.contains(pose)
        assert with_cores.failed == without.failed == 0
        assert np.ptp(with_cores.bounds.orientation) < 0.8 * np.ptp(without.bounds.orientation)


def test_a_line_outside_of_its_core_costs_less_than_a_false_one():
    """The core of one line is wrong: the truth stays in the set, and no facade is in conflict."""
    rng = np.random.default_rng(4)
    facades, true = crossing(rng)
    walls = WallLines(facades)
    found = [cored(line_of(walls, true, row, POSE, slack=0.9), 0.02) for row in facing(walls, POSE)[:5]]
    alpha, d = found[0].core
    found[0] = replace(found[0], core=(alpha, d + 0.85))
    start = Bounds.around(POSE, 4.0, np.radians(4.0))
    feasible = intersect_correspondences(tuple(found), walls, start, FeasibleSettings(confidence=0.9999))
    assert feasible.bounds.contains(POSE)
    assert feasible.conflicts == ()
