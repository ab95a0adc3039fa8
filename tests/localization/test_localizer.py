"""One call from map and drive to both results."""

from dataclasses import replace

import numpy as np
import pytest

from factorloc.errors import ConfigError, GeometryError, MapError
from factorloc.factors import DecayRateTerm, DistanceFieldTerm, PosePrior
from factorloc.localization import LocalizationSettings, localize, smooth, track
from factorloc.localization.prepared_map import PreparedMap
from factorloc.mapping import RayStatistics


@pytest.fixture(scope="module")
def localization(office):
    return localize(office.statistics, office.drive.scans, office.drive.odometry, office.prior.pose)


def test_a_drive_is_localized_with_defaults(office, localization) -> None:
    for result in (localization.tracked, localization.smoothed):
        assert np.sqrt((office.errors(result.trajectory.poses) ** 2).mean()) < 0.03
        assert (result.trajectory.stamps == office.drive.stamps).all()
        assert result.trajectory.world == office.statistics.grid.frame


def test_it_is_tracking_and_then_smoothing(office, localization, tracked, smoothed) -> None:
    assert localization.tracked.trajectory.poses == pytest.approx(tracked.trajectory.poses, abs=1e-9)
    assert localization.smoothed.trajectory.poses == pytest.approx(smoothed.trajectory.poses, abs=1e-9)
    assert localization.smoothed.cost == pytest.approx(smoothed.cost)


def test_the_error_of_the_map_is_added_to_every_covariance(office, localization, tracked, smoothed) -> None:
    settings = LocalizationSettings()
    floor = np.diag([settings.map_position**2, settings.map_position**2, 0.003**2])
    pairs = [(localization.tracked, tracked), (localization.smoothed, smoothed)]
    for ours, bare in pairs:
        assert ours.trajectory.covariances == pytest.approx(bare.trajectory.covariances + floor, rel=1e-6)


def few(office, n: int = 4):
    return office.statistics, office.drive.scans[:n], office.drive.odometry[: n - 1]


def test_a_prior_of_its_own_is_a_start(office) -> None:
    settings = LocalizationSettings(start_position=0.3, start_heading=0.1)
    pose = office.truth[0] + [0.1, 0.1, 0.02]
    by_pose = localize(*few(office), pose, settings=settings)
    by_prior = localize(*few(office), PosePrior.from_sigmas(pose, 0.3, 0.1))
    assert by_pose.smoothed.trajectory.poses == pytest.approx(by_prior.smoothed.trajectory.poses)
    assert by_pose.smoothed.residuals["prior"] == pytest.approx(by_prior.smoothed.residuals["prior"])


def test_settings_reach_every_part(office) -> None:
    statistics, scans, motions = few(office)
    settings = LocalizationSettings(
        information=0.1,
        blurs=(0.4, 0.2, 0.05),
        smoothing_blur=0.2,
        map_position=0.0,
        map_heading=0.0,
        odometry={"huber": 3.0},
        tracking={"start_grid": 2},
        registration={"max_iterations": 9},
        optimizer={"max_iterations": 3},
    )
    ours = localize(statistics, scans, motions, office.prior, settings=settings)
    term = PreparedMap.of(statistics, settings).term(scans)
    assert (term.information, term.blurs) == (0.1, (0.4, 0.2, 0.05))
    parts = {"noise": settings.odometry, "prior": office.prior}
    tracked = track(term, motions, settings=settings.tracking, registration=settings.registration, **parts)
    smoothed = smooth(term, motions, tracked.trajectory.poses, levels=[1, 2], settings=settings.optimizer, **parts)
    assert ours.tracked.trajectory.poses == pytest.approx(tracked.trajectory.poses)
    assert ours.smoothed.trajectory.poses == pytest.approx(smoothed.trajectory.poses)
    assert ours.smoothed.trajectory.covariances == pytest.approx(smoothed.trajectory.covariances)
    assert {step.level for step in ours.smoothed.history} <= {0.2, 0.05}


def test_a_map_blurred_more_than_asked_is_smoothed_on_its_finest_level(office) -> None:
    settings = LocalizationSettings(blurs=(0.5, 0.3), smoothing_blur=0.1, tracking={"track_blur": 0.1})
    result = localize(*few(office), office.truth[0], settings=settings)
    assert {step.level for step in result.smoothed.history} == {0.3}


def test_the_model_is_chosen_by_name(office) -> None:
    statistics, scans, motions = few(office)
    assert isinstance(PreparedMap.of(statistics).term(scans), DecayRateTerm)
    field = LocalizationSettings(model="distance-field", blurs=(0.5, 0.0))
    term = PreparedMap.of(statistics, field).term(scans)
    assert isinstance(term, DistanceFieldTerm)
    assert (term.information, term.blurs) == (0.2, (0.5, 0.0))
    result = localize(statistics, scans, motions, office.truth[0] + 0.05, settings=field)
    assert np.hypot(*(result.smoothed.trajectory.poses - office.truth[:4])[:, :2].T).max() < 0.1


def test_motions_nobody_measured_reach_both_passes(office) -> None:
    statistics, scans, motions = few(office)
    result = localize(statistics, scans, motions, office.truth[0], known=[True, False, True])
    assert result.tracked.rejected["motions not measured"] == 1
    assert result.smoothed.rejected["motions not measured"] == 1
    assert len(result.smoothed.residuals["odometry"]) == 2


def test_progress_is_told(office) -> None:
    scans, steps = [], []
    result = localize(*few(office), office.truth[0], progress=scans.append, on_iteration=steps.append)
    assert scans == [1, 2, 3, 4]
    assert tuple(steps) == result.smoothed.history


def test_the_frame_of_the_map_is_that_of_the_results(office) -> None:
    statistics, scans, motions = few(office)
    moved = RayStatistics(
        replace(statistics.grid, frame="building"), statistics.hits, statistics.misses, statistics.path_fixed
    )
    result = localize(moved, scans, motions, office.truth[0])
    assert {result.tracked.trajectory.world, result.smoothed.trajectory.world} == {"building"}


def test_a_start_outside_the_map_is_refused(office) -> None:
    with pytest.raises(MapError, match=r"start: \(-50.00, 3.00\) m lies outside the map; give a pose within"):
        localize(*few(office), [-50, 3, 0])
    with pytest.raises(MapError, match="outside"):
        localize(*few(office), PosePrior.from_sigmas([500, 0, 0], 1, 1))


def test_what_does_not_fit_is_refused(office) -> None:
    statistics, scans, motions = few(office)
    for arguments, line in [
        ((statistics, scans, motions[:2], office.truth[0]), "expected 3 motions between 4 scans"),
        ((statistics, [], motions, office.truth[0]), "none given"),
        ((statistics, scans, motions, office.truth[0, :2]), "prior pose"),
        ((statistics, scans, motions, [np.nan, 0, 0]), "prior pose"),
    ]:
        with pytest.raises(GeometryError, match=line):
            localize(*arguments)
    with pytest.raises(MapError, match="decreasing"):
        localize(*few(office), office.truth[0], settings=LocalizationSettings(blurs=()))
    with pytest.raises(ConfigError, match="model"):
        LocalizationSettings(model="guess")
