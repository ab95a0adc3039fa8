import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from factorloc.errors import EvaluationError
from factorloc.evaluation import associate
from factorloc.evaluation.association import check_associated
from factorloc.trajectory import Trajectory


def run(stamps, **names):
    """A trajectory whose x is its row, so that rows can be told apart."""
    stamps = np.asarray(stamps, float)
    poses = np.column_stack([np.arange(len(stamps)), np.zeros((len(stamps), 2))])
    return Trajectory(stamps, poses, **names)


def rows(trajectory):
    return trajectory.positions[:, 0].astype(int).tolist()


def test_nearest_within_the_limit_and_the_rest_counted():
    matched = associate(run([0.0, 0.1, 0.2, 0.9]), run([0.004, 0.109, 0.095, 0.25]))
    assert rows(matched.estimate) == [0, 1]
    assert rows(matched.truth) == [0, 2]
    assert (len(matched), matched.unmatched_estimate, matched.unmatched_truth) == (2, 2, 2)


def test_a_pose_is_used_once():
    matched = associate(run([1.000, 1.004]), run([1.003]))
    assert rows(matched.estimate) == [1]
    assert matched.unmatched_estimate == 1


def test_repeated_stamps_are_paired_in_order():
    matched = associate(run([1, 2, 2, 2, 3]), run([2, 1, 2]))
    assert list(zip(rows(matched.estimate), rows(matched.truth), strict=True)) == [(0, 1), (1, 0), (2, 2)]
    assert (matched.unmatched_estimate, matched.unmatched_truth) == (2, 0)


def test_order_of_the_estimate_is_kept_although_times_run_backwards():
    matched = associate(run([5, 3, 4]), run([3, 4, 5, 6]))
    assert rows(matched.estimate) == [0, 1, 2]
    assert rows(matched.truth) == [2, 0, 1]


@given(
    st.lists(st.integers(0, 40), min_size=1, max_size=25),
    st.lists(st.integers(0, 40), min_size=1, max_size=25),
    st.integers(0, 3),
)
def test_pairs_are_unique_near_and_leave_no_pair_of_equal_stamps(a, b, limit):
    estimate, truth = run(a), run(b)
    shared = sum(min(a.count(s), b.count(s)) for s in set(a))
    try:
        matched = associate(estimate, truth, limit)
    except EvaluationError:
        assert min(abs(s - t) for s in a for t in b) > limit
        return
    assert np.abs(matched.estimate.stamps - matched.truth.stamps).max() <= limit
    for trajectory in (matched.estimate, matched.truth):
        assert len(set(rows(trajectory))) == len(matched)
    assert (matched.estimate.stamps == matched.truth.stamps).sum() == shared
    swapped = associate(truth, estimate, limit)
    assert len(swapped) == len(matched)


def test_matched_rows_pass_the_check():
    matched = associate(run([1.7e9, 1.7e9 + 1]), run([1.7e9 + 0.01, 1.7e9 + 1.01]), 0.011)
    check_associated(matched.estimate, matched.truth, 0.011)


@pytest.mark.parametrize("stamps", [[10.0, 11.0], []])
def test_no_overlap_is_an_error(stamps):
    with pytest.raises(EvaluationError, match="no overlap"):
        associate(run(stamps), run([0.0, 1.0]))


def test_negative_limit_is_an_error():
    with pytest.raises(EvaluationError, match="max_difference"):
        associate(run([0]), run([0]), -1)


@pytest.mark.parametrize(
    ("estimate", "truth", "field"),
    [
        (run([0, 1]), run([0, 1, 2]), "length: 2 poses against 3"),
        (run([]), run([]), "length: both .* empty"),
        (run([0, 1]), run([0, 1.5]), "stamps: row 1 .* 0.5 s apart"),
        (run([0], world="odom"), run([0]), "world: .*'odom'.*'map'"),
        (run([0], body="laser"), run([0]), "body: .*'laser'.*'body'"),
        (run([0]).to_3d(), run([0]), "dimension: .*3-D.*2-D"),
    ],
)
def test_what_cannot_be_compared_says_why(estimate, truth, field):
    with pytest.raises(EvaluationError, match=field) as caught:
        check_associated(estimate, truth)
    assert "\n" not in str(caught.value)
