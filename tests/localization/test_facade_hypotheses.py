"""Several beliefs of a drive among facades: where they begin, what scans tell of them, and which one is believed."""

import numpy as np
import pytest
from facade_street import SHIFT, crossing, points_on
from hypothesis import given
from hypothesis import strategies as st
from test_facade_localization import facing

from factorloc.intervals import Box
from factorloc.localization.facade_hypotheses import (
    Hypothesis,
    HypothesisSettings,
    chosen,
    poses_of,
    weighed,
    without_twins,
)
from factorloc.localization.facade_places import FacadePlaces, PlaceSettings
from factorloc.localization.facade_settings import FacadeSettings
from factorloc.localization.facade_tracker import FacadeTracker
from factorloc.localization.feasible_layers import Layer
from factorloc.localization.least_squares_settings import LeastSquaresSettings
from factorloc.localization.wall_belief import WallBelief
from factorloc.localization.wall_lines import WallLines
from factorloc.mapping.facade_points import FacadePoints
from factorloc.mapping.facades import Facades
from factorloc.result import Bounds

POSE = np.array([0.3, -0.2, 0.1])


def at(x, score, fit=0.0):
    return Hypothesis(WallBelief.of_pose(np.array([x, 0.0, 0.0]), np.eye(3)), score, fit=fit)


def places_of(walls, **settings):
    return FacadePlaces(walls, PlaceSettings(**settings), LeastSquaresSettings())


@pytest.fixture(scope="module")
def scene():
    """Walls of a crossing as mapped, the true ones, and a scan of them."""
    rng = np.random.default_rng(11)
    facades, true = crossing(rng)
    walls = WallLines(facades)
    return walls, true, points_on(true, facing(walls, POSE), POSE, rng)[0]


def test_of_hypotheses_near_each_other_the_better_is_kept():
    every = [at(0.0, 1.0), at(0.3, 5.0), at(4.0, 2.0), at(8.0, 0.0), at(12.0, -3.0)]
    kept = without_twins(every, HypothesisSettings(most=3))
    assert [one.score for one in kept] == [5.0, 2.0, 0.0]
    assert chosen(kept).score == 5.0


@given(st.lists(st.tuples(st.floats(-50, 0), st.floats(-2000, 0)), min_size=1, max_size=6))
def test_a_scan_speaks_against_those_that_fit_worse_but_never_too_much(beliefs):
    settings = HypothesisSettings()
    before = [at(5.0 * k, score, fit) for k, (score, fit) in enumerate(beliefs)]
    told = np.array([new.score - old.score for new, old in zip(weighed(before, settings), before, strict=True)])
    fits = np.array([one.fit for one in before])
    behind = fits.max() - fits
    assert (told <= 0.0).all()
    assert (told >= -settings.most_told - 1e-9).all()
    np.testing.assert_allclose(told[behind <= settings.spared], 0.0, atol=1e-9)
    assert (np.diff(told[np.argsort(behind)]) <= 1e-9).all()
    expected = np.clip(settings.novelty * (settings.spared - behind), -settings.most_told, 0.0)
    np.testing.assert_allclose(told, expected, atol=1e-9)


def test_a_belief_is_asked_around_its_pose_as_far_as_it_is_unsure():
    belief = WallBelief.of_pose(POSE, np.diag([0.2, 0.1, 0.01]) ** 2)
    poses = poses_of(belief, 1.5)
    assert poses.shape == (27, 3)
    np.testing.assert_allclose(poses[0], POSE)
    np.testing.assert_allclose(np.abs(poses - POSE).max(0), [0.3, 0.15, 0.015])
    np.testing.assert_allclose(poses_of(belief, 0.0), np.tile(POSE, (27, 1)))


def test_points_tell_the_place(scene):
    walls, _, points = scene
    places = places_of(walls)
    scores = places.scores(points, POSE + np.array([[0, 0, 0], [3, 0, 0], [0, -3, 0], [0, 0, 0.2]]))
    assert (scores[0] > scores[1:] + 30).all()
    bounds = Bounds.around(POSE + np.array([2.0, -1.5, 0.05]), 5.0, np.radians(5.0))
    best = places.best(points, bounds, 4)
    assert best.shape == (4, 3)
    assert np.hypot(*(best[0] - POSE)[:2]) < 1.0
    assert all(bounds.contains(place) for place in best)
    apart = np.hypot(*(best[:, None, :2] - best[None, :, :2]).transpose(2, 0, 1))
    assert (apart[np.triu_indices(4, 1)] >= PlaceSettings().apart).all()
    assert (np.diff(places.scores(points, best)) <= 0).all()


def test_a_wide_set_is_searched_on_a_wider_grid(scene, monkeypatch):
    walls, _, points = scene
    places, asked = places_of(walls, most_poses=500), []
    usual = places.scores
    monkeypatch.setattr(places, "scores", lambda points, poses: asked.append(len(poses)) or usual(points, poses))
    best = places.best(points, Bounds.around(POSE, 20.0, np.radians(10.0)), 2)
    assert 300 < asked[0] < 700
    assert len(best) == 2


def test_likelihood_is_that_of_the_nearest_wall(scene):
    """Against distances to all segments, point by point; cells of the field are 0.2 m."""
    walls, _, points = scene
    places = places_of(walls, points=10**6, resolution=0.05)
    rng = np.random.default_rng(2)
    poses = POSE + rng.uniform(-1, 1, (5, 3)) * [2.0, 2.0, 0.1]

    def naive(pose):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        ends = points.points @ np.array([[c, s], [-s, c]]) + pose[:2]
        start, along = walls.facades.segments[:, 0], np.diff(walls.facades.segments, axis=1)[:, 0]
        share = ((ends[:, None] - start) * along).sum(-1) / (along**2).sum(-1)
        feet = start + np.clip(share, 0, 1)[..., None] * along
        away = np.minimum(np.hypot(*(ends[:, None] - feet).transpose(2, 0, 1)).min(1), 3.0)
        peak = 0.9 / (places.sigma * np.sqrt(2 * np.pi))
        return np.log(peak * np.exp(-0.5 * (away / places.sigma) ** 2) + 0.1 / 100.0).sum()

    expected = np.array([naive(pose) for pose in poses])
    np.testing.assert_allclose(places.scores(points, poses), expected, rtol=0.03)


def test_the_field_follows_the_drive_and_may_be_empty(scene):
    walls, _, points = scene
    places = places_of(walls)
    near = places.scores(points, POSE[None])[0]
    # 1 km away there is no facade; back again, all is as before.
    assert places.scores(points, POSE[None] + np.array([1000.0, 0.0, 0.0]))[0] == 0.0
    assert places.scores(points, POSE[None])[0] == near
    nothing = FacadePoints(np.empty((0, 2)), Box.around(np.empty((2, 0)), 0.1), np.empty(0, np.int64), {})
    assert places.scores(nothing, POSE[None])[0] == 0.0
    assert len(places.best(nothing, Bounds.around(POSE, 2.0, 0.1), 3)) == 3
    # A set without an area is a place.
    point = Bounds((0.1, 0.1), (np.tile(POSE[:2], (4, 1)),))
    np.testing.assert_allclose(places.best(points, point, 3), POSE[None])


def test_a_field_is_as_sharp_as_the_map_is_sure_but_not_sharper_than_the_grid():
    rng = np.random.default_rng(3)
    facades, _ = crossing(rng)
    count = len(facades)
    rough = Facades(facades.segments, facades.buildings, np.full(count, 4.0), facades.vertex_errors)
    assert places_of(WallLines(facades)).sigma == 0.5
    assert places_of(WallLines(rough)).sigma == pytest.approx(np.hypot(1.0, 0.1), abs=0.01)


def test_a_sure_and_wrong_belief_is_given_up_for_one_that_the_points_speak_for(scene):
    walls, true, points = scene
    rng = np.random.default_rng(12)
    tracker = FacadeTracker(walls, Bounds.around(POSE, 5.0, np.radians(4.0)), None, FacadeSettings())
    tracker.localize(points)
    assert 1 <= len(tracker.hypotheses) <= 4
    assert np.hypot(*(tracker.belief.pose - POSE)[:2]) < 1.0
    # 4 m off in both directions of the streets, and sure of that to 5 cm.
    wrong = WallBelief.of_pose(POSE + np.array([4.0, 4.0, 0.0]), np.diag([0.05, 0.05, 0.002]) ** 2)
    tracker.hypotheses = [Hypothesis(wrong, 0.0)]
    away = []
    for _ in range(15):
        tracker.move(np.zeros(3), np.array([0.01, 0.01, 0.001]))
        step = tracker.localize(points_on(true, facing(walls, POSE), POSE, rng)[0])
        assert step.feasible.bounds.contains(step.estimate.pose)
        assert tracker.known.contains(tracker.belief.pose)
        assert len(tracker.hypotheses) <= 4
        away.append(np.hypot(*(tracker.belief.pose - POSE)[:2]))
    assert away[0] > 0.5
    assert away[-1] < SHIFT


def test_a_drive_begins_where_its_points_fit_though_it_was_told_another_place(scene):
    walls, _, points = scene
    start = Bounds.around(POSE, 5.0, np.radians(4.0))
    tracker = FacadeTracker(walls, start, POSE + np.array([4.5, -4.5, 0.0]), FacadeSettings())
    tracker.localize(points)
    assert np.hypot(*(tracker.belief.pose - POSE)[:2]) < 1.0


def test_a_set_that_leaves_out_a_settled_belief_is_not_trusted_at_once(scene):
    """One scan, and a second, whose set is elsewhere: assumptions violated, sets widened; the third one is believed."""
    walls, _, points = scene
    away = np.array([0.8, 0.0, 0.0])
    tracker = FacadeTracker(walls, Bounds.around(POSE, 2.0, np.radians(3.0)), None, FacadeSettings())
    sure = WallBelief.of_pose(POSE + away, np.diag([0.05, 0.05, 0.005]) ** 2)

    def scanned(scans):
        tracker.scans, tracker.hypotheses = scans, [Hypothesis(sure, 0.0)]
        tracker.layers = (Layer(0.0, (Bounds.around(POSE, 0.4, np.radians(2.0)),)),)
        tracker.known = tracker.layers[0].slices[0]
        return tracker.localize(points)

    # Nothing is settled at the beginning.
    assert not scanned(1).feasible.violated
    tracker.contradictions = 0
    for _ in range(2):
        step = scanned(20)
        assert step.feasible.violated
        assert step.estimate is None
        assert np.ptp(tracker.known.polygons[0], axis=0).min() > 2 * 0.4 + 2.0
    step = scanned(20)
    assert not step.feasible.violated
    assert step.feasible.bounds.contains(step.estimate.pose)


def test_a_belief_that_no_point_speaks_for_contradicts_nothing(scene):
    walls, _, points = scene
    tracker = FacadeTracker(walls, Bounds.around(POSE, 0.4, np.radians(2.0)), None, FacadeSettings())
    tracker.scans = 20
    tracker.hypotheses = [Hypothesis(WallBelief.of_pose(POSE + np.array([6.0, 6.0, 0.0]), 1e-3 * np.eye(3)), 0.0)]
    assert not tracker.localize(points).feasible.violated
