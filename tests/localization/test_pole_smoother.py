"""Smoothing among poles: near the truth, not fooled by a row that moved, and plain words for what is wrong."""

import numpy as np
import pytest
from pole_street import PoleStreet, make_street, poles_at, position_errors

from factorloc.errors import GeometryError, MapError
from factorloc.factors import PoleDetections, PoleLandmarks
from factorloc.geometry import se2, wrap
from factorloc.localization.odometry_calibration import OdometryCalibration
from factorloc.localization.pole_consensus import ConsensusSettings, bridge
from factorloc.localization.pole_filter import PoleFilterSettings, filter_poles
from factorloc.localization.pole_smoother import PoleSmootherSettings, smooth_poles
from factorloc.mapping.poles import Poles

OFF = np.array([1.8, -1.6, 0.08])


@pytest.fixture(scope="module")
def street() -> PoleStreet:
    return make_street(seed=1)


@pytest.fixture(scope="module")
def moved() -> PoleStreet:
    return make_street(bare=(110.0, 190.0), row_shift=1.5, seed=2)


def smoothed(street: PoleStreet, **options):
    about = {"covariances": street.covariances, **options}
    return smooth_poles(street.landmarks, street.local_maps, street.motions, street.truth[0] + OFF, **about)


def test_a_drive_is_found_from_a_start_that_is_off(street) -> None:
    done = smoothed(street)
    errors = position_errors(done.result.trajectory.poses, street.truth)
    assert errors.mean() < 0.06
    assert errors.max() < 0.3
    assert np.degrees(np.abs(wrap(done.result.trajectory.poses[:, 2] - street.truth[:, 2]))).mean() < 0.3
    assert len(done.distrusted) == 0
    assert done.account() == ""
    assert done.result.rejected["detections without landmark"] > 50
    assert done.result.rejected["local maps without poles"] == 150
    covariances = done.result.trajectory.covariances
    e = se2.log(se2.between(done.result.trajectory.poses, street.truth))
    nees = np.einsum("ni,nij,nj->n", e, np.linalg.inv(covariances), e)
    assert 0.1 < nees.mean() / 3 < 3.0


def test_a_row_that_moved_is_named_and_does_not_drag(moved) -> None:
    done = smoothed(moved)
    errors = position_errors(done.result.trajectory.poses, moved.truth)
    assert errors.max() < 0.5
    row = np.flatnonzero(np.hypot(*(moved.there - moved.mapped).T) > 1.0)
    named = np.union1d(done.distrusted, np.concatenate([[], *(group.landmarks for group in done.moved)])).astype(int)
    assert np.isin(row, named).mean() > 0.8
    assert np.isin(named, row).mean() > 0.8
    (group,) = done.moved
    assert np.hypot(*group.shift) == pytest.approx(1.5, abs=0.3)
    assert "contradict odometry" in done.account() or "beside their places" in done.account()


def test_without_consensus_it_would_be_dragged_and_so_is_the_published_filter(moved) -> None:
    alone = PoleSmootherSettings(consensus=ConsensusSettings(rounds=0))
    dragged = smoothed(moved, settings=alone)
    assert position_errors(dragged.result.trajectory.poses, moved.truth).max() > 1.0
    filtered = filter_poles(
        moved.landmarks, moved.local_maps, moved.motions, moved.truth[0], covariances=moved.covariances,
        settings=PoleFilterSettings(particles=1500),
    )  # fmt: skip
    errors = position_errors(filtered.trajectory.poses, moved.truth)
    assert errors[110:190].max() > 1.0
    assert errors[30:100].mean() < 0.4


def test_a_wrong_scale_of_odometry_is_found_and_does_no_harm() -> None:
    street = make_street(scale=1.03, seed=3)
    done = smoothed(street)
    assert done.calibration.scale == pytest.approx(1 / 1.03, abs=0.006)
    assert position_errors(done.result.trajectory.poses, street.truth).max() < 0.4


def test_200_m_without_a_pole_are_bridged_and_reported() -> None:
    street = make_street(length=420, bare=(100.0, 325.0), seed=4)
    done = smoothed(street)
    assert done.result.rejected["metres farthest without a pole"] >= 200
    errors = position_errors(done.result.trajectory.poses, street.truth)
    assert errors[:90].max() < 0.3
    assert errors[345:].max() < 0.3
    assert done.result.rejected["searches"] >= 2
    sigma = np.sqrt(done.result.trajectory.covariances[210, 1, 1])
    assert sigma > 5 * np.sqrt(done.result.trajectory.covariances[40, 1, 1])


def test_an_empty_drive_stays_on_odometry(street) -> None:
    blind = [Poles.none()] * len(street.truth)
    done = smooth_poles(street.landmarks, blind, street.motions, street.truth[0], covariances=street.covariances)
    assert done.result.rejected["local maps without poles"] == len(street.truth)
    assert np.isfinite(done.result.trajectory.poses).all()
    found = filter_poles(street.landmarks, blind, street.motions, street.truth[0],
                         settings=PoleFilterSettings(particles=200))  # fmt: skip
    assert found.rejected["local maps without poles"] == len(street.truth)


def test_duplicates_in_the_map_are_counted_and_left_out(street) -> None:
    twice = np.concatenate([street.mapped, street.mapped[::3] + 0.05])
    done = smooth_poles(
        PoleLandmarks(poles_at(twice)), street.local_maps, street.motions, street.truth[0] + OFF,
        covariances=street.covariances,
    )  # fmt: skip
    assert done.result.rejected["duplicate landmarks"] == len(street.mapped[::3])
    assert position_errors(done.result.trajectory.poses, street.truth).mean() < 0.08


def test_a_map_of_elsewhere_is_refused(street) -> None:
    far = PoleLandmarks(poles_at(street.mapped + np.array([4.5e5, 5.4e6])))
    with pytest.raises(MapError, match="another coordinate system"):
        smooth_poles(far, street.local_maps, street.motions, street.truth[0])
    with pytest.raises(MapError, match="outside"):
        filter_poles(far, street.local_maps, street.motions, street.truth[0])
    with pytest.raises(MapError, match="without poles"):
        smooth_poles(PoleLandmarks(Poles.none()), street.local_maps, street.motions, street.truth[0])


def test_numbers_that_do_not_fit_are_refused(street) -> None:
    with pytest.raises(GeometryError, match="10 motions between 301 local maps"):
        smooth_poles(street.landmarks, street.local_maps, street.motions[:10], street.truth[0])
    with pytest.raises(GeometryError, match="10 motions between 301 local maps"):
        filter_poles(street.landmarks, street.local_maps, street.motions[:10], street.truth[0])


def test_a_motion_nobody_measured_is_made_up_for(street) -> None:
    known = np.ones(len(street.motions), bool)
    known[150] = False
    motions = street.motions.copy()
    motions[150] = 0.0
    done = smooth_poles(
        street.landmarks, street.local_maps, motions, street.truth[0] + OFF, known=known,
        covariances=street.covariances,
    )  # fmt: skip
    assert done.result.rejected["motions not measured"] == 1
    assert position_errors(done.result.trajectory.poses, street.truth).max() < 0.6


def test_a_bridge_meets_both_ends_and_knows_its_error() -> None:
    street = make_street(length=80, seed=5)
    held = np.diag([0.02, 0.02, 0.002]) ** 2
    over = bridge(street.truth[0], street.truth[-1], street.motions, street.covariances, held)
    e = se2.log(se2.between(over.poses, street.truth))
    assert np.hypot(*e[[0, -1], :2].T).max() < 0.05
    nees = np.einsum("ni,nij,nj->n", e, np.linalg.inv(over.covariances), e)
    assert nees.max() < 20
    assert over.closure < 16
    assert over.covariances[40, 1, 1] > over.covariances[1, 1, 1]
    beside = street.truth[-1] + [0.0, 2.0, 0.3]
    assert bridge(street.truth[0], beside, street.motions, street.covariances, held).closure > 16


def test_too_few_stretches_calibrate_nothing() -> None:
    street = make_street(length=80, seed=6)
    found = OdometryCalibration.of(street.truth, street.motions, np.ones(80, bool))
    assert found == OdometryCalibration()
    assert found.applied(street.motions) == pytest.approx(street.motions)


def test_packed_detections_are_taken_as_they_are(street) -> None:
    packed = PoleDetections.of(street.local_maps)
    done = smooth_poles(street.landmarks, packed, street.motions, street.truth[0], covariances=street.covariances)
    assert len(done.matches) == len(packed.poles)
