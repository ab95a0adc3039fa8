"""Persistence of poles, against what one would say of them."""

import numpy as np
import pytest
from pole_street import make_street, poles_at

from factorloc.factors import PoleDetections, PosePrior
from factorloc.localization.landmark_smoother import smooth_landmarks
from factorloc.localization.moved_poles import find_moved_groups, visibility
from factorloc.localization.pole_persistence import PersistenceSettings, persistence
from factorloc.mapping.pole_map import PoleMap


def trust(seen, in_view) -> np.ndarray:
    names = tuple(f"session {k}" for k in range(np.shape(seen)[1]))
    return persistence(PoleMap(poles_at(np.zeros((len(seen), 2))), np.array(seen), np.array(in_view), names))


def test_what_was_seen_again_is_trusted_and_what_was_missed_is_not() -> None:
    again, new, missed, unvisited = trust(
        [[5, 6, 5], [5, 0, 0], [5, 0, 0], [5, 0, 0]], [[8, 8, 8], [8, 0, 0], [8, 9, 9], [8, 0, 0]]
    )
    assert again > 0.95
    assert missed == pytest.approx(PersistenceSettings().least)
    assert missed < new < again
    assert new == unvisited


def test_what_appeared_just_now_has_less_trust_than_what_stood_for_long() -> None:
    old, fresh = trust([[4, 4, 4], [0, 0, 4]], [[6, 6, 6], [6, 6, 6]])
    assert fresh < old
    assert fresh == pytest.approx(PersistenceSettings().new, abs=0.05)


def test_counts_of_landmarks_are_by_local_maps() -> None:
    street = make_street(length=60, seed=7)
    detections = PoleDetections.of(street.local_maps)
    places = detections.placed(street.truth)
    apart = np.hypot(*(places[:, None] - street.mapped[None]).transpose(2, 0, 1))
    matches = np.where(apart.min(1) < 0.4, apart.argmin(1), -1)
    seen, in_view = visibility(street.truth, detections, matches, street.mapped, 12.0)
    assert (seen <= in_view).all()
    assert (seen.sum() / in_view.sum()) == pytest.approx(0.7, abs=0.1)
    missed, groups = find_moved_groups(street.truth, detections, matches, street.mapped)
    assert len(missed) == 0
    assert groups == []


def test_landmarks_and_poses_are_found_from_odometry_and_known_associations() -> None:
    street = make_street(length=120, seed=8)
    detections = PoleDetections.of(street.local_maps)
    places = detections.placed(street.truth)
    apart = np.hypot(*(places[:, None] - street.there[None]).transpose(2, 0, 1))
    right = apart.min(1) < 0.4
    found = smooth_landmarks(
        street.motions, detections.pose_of[right], apart.argmin(1)[right], detections.poles.positions[right],
        PosePrior.from_sigmas(street.truth[0], 0.01, 0.001), sigma=0.08, covariances=street.covariances,
    )  # fmt: skip
    assert np.hypot(*(found.poses[:, :2] - street.truth[:, :2]).T).max() < 0.5
    often = found.counts >= 5
    assert np.hypot(*(found.landmarks[often] - street.there[: len(often)][often]).T).max() < 0.6
    anchored = smooth_landmarks(
        street.motions, detections.pose_of[right], apart.argmin(1)[right], detections.poles.positions[right],
        PosePrior.from_sigmas(street.truth[0], 0.01, 0.001), sigma=0.08, covariances=street.covariances,
        known_landmarks=street.mapped, landmark_sigma=0.05,
    )  # fmt: skip
    assert np.hypot(*(anchored.poses[:, :2] - street.truth[:, :2]).T).max() < 0.15
