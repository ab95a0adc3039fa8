"""A drive in space is tracked from a wrong start, smoothed, and localized by one call."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from spatial_room import distances, room, turns

from factorloc.errors import GeometryError, MapError
from factorloc.factors import PosePrior
from factorloc.factors.spatial_scan_term import SpatialScanTerm
from factorloc.geometry import se3
from factorloc.localization import (
    LocalizationSettings,
    PreparedMap,
    RegistrationSettings,
    TrackingSettings,
    find_start,
    localize,
    smooth,
    track,
)
from factorloc.result import StopReason
from factorloc.scan import RayStatus

QUICK = TrackingSettings(start_grid=2)


@pytest.fixture(scope="module")
def localization():
    here = room()
    return localize(here.prepared, here.scans, here.odometry, here.prior, covariances=here.covariances)


def nees(result) -> np.ndarray:
    """Squared errors over what was expected of them, per degree of freedom."""
    errors = room().errors(result.trajectory.poses, slice(len(result.trajectory.poses)))
    return np.einsum("ni,nij,nj->n", errors, np.linalg.inv(result.trajectory.covariances), errors) / 6


def test_a_drive_is_localized(localization) -> None:
    assert distances(room().errors(room().prior.pose[None], slice(1))) > 0.35
    for result in (localization.tracked, localization.smoothed):
        errors = room().errors(result.trajectory.poses)
        assert distances(errors).max() < 0.05
        assert np.median(distances(errors)) < 0.012
        assert turns(errors).max() < np.radians(0.5)
        assert result.trajectory.stamps == pytest.approx([scan.stamp for scan in room().scans])
        assert result.trajectory.world == "map"
        assert se3.as_poses(result.trajectory.poses).shape == (14, 4, 4)


def test_covariances_are_sane(localization) -> None:
    for result in (localization.tracked, localization.smoothed):
        covariances = result.trajectory.covariances
        assert covariances == pytest.approx(covariances.swapaxes(1, 2))
        sigmas = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
        assert np.linalg.eigvalsh(covariances).min() > 0
        assert (sigmas[:, :3] >= 0.001).all()
        assert (sigmas[:, 3:] >= 0.02).all(), "no surer than the map"
        assert (sigmas[:, :3] < np.radians(1)).all()
        assert (sigmas[:, 3:] < 0.05).all()
        assert 0.003 < nees(result).mean() < 1
    bare = [r.trajectory.covariances - room().prepared.floor for r in (localization.tracked, localization.smoothed)]
    traces = [np.trace(c, axis1=1, axis2=2) for c in bare]
    assert (traces[1] <= 1.2 * traces[0]).mean() > 0.7, "the future helps"


def test_results_say_what_was_done(localization) -> None:
    tracked, smoothed = localization.tracked, localization.smoothed
    assert tracked.stop is StopReason.SEQUENTIAL
    assert set(tracked.residuals) == {"scan"}
    assert set(smoothed.residuals) == {"prior", "odometry", "scan"}
    assert [len(smoothed.residuals[kind]) for kind in ("prior", "odometry", "scan")] == [1, 13, 14]
    assert smoothed.cost == pytest.approx(sum(part.sum() for part in smoothed.residuals.values()))
    assert smoothed.residuals["scan"] == pytest.approx(room().term.cost(smoothed.trajectory.poses))
    assert {step.level for step in smoothed.history} <= {0.25, 0.0}


def few(n: int = 4):
    here = room()
    return here.prepared, here.scans[:n], here.odometry[: n - 1]


def test_it_is_tracking_and_then_smoothing() -> None:
    prepared, scans, motions = few()
    prior, covariances = room().prior, room().covariances[:3]
    settings = LocalizationSettings(tracking=QUICK)
    ours = localize(prepared, scans, motions, prior, covariances=covariances, settings=settings)
    term = prepared.term(scans)
    tracked = track(term, motions, prior, covariances=covariances, settings=QUICK)
    smoothed = smooth(term, motions, tracked.trajectory.poses, prior=prior, covariances=covariances)
    for found, bare in [(ours.tracked, tracked), (ours.smoothed, smoothed)]:
        assert found.trajectory.poses == pytest.approx(bare.trajectory.poses, abs=1e-9)
        assert found.trajectory.covariances == pytest.approx(bare.trajectory.covariances + prepared.floor)
        assert found.cost == pytest.approx(bare.cost)


def test_smoothing_never_raises_the_cost_of_its_start() -> None:
    here = room()
    rng = np.random.default_rng(3)
    start = se3.compose(here.truth, se3.exp(rng.normal(0, [0.01] * 3 + [0.1] * 3, (14, 6))))
    found = smooth(here.term, here.odometry, start, prior=here.prior)
    assert found.residuals["scan"].sum() < here.term.cost(start).sum()
    assert distances(here.errors(found.trajectory.poses)).max() < 0.05
    for before, after in pairwise(found.history):
        assert before.level != after.level or before.cost >= after.cost


def test_the_start_is_looked_for_all_over_its_prior() -> None:
    here = room()
    fixed = RegistrationSettings(max_iterations=1, max_translation=1e-9, max_rotation=1e-9)
    root = np.random.default_rng(2).uniform(-0.05, 0.05, (6, 6)) + np.diag([0.02, 0.03, 0.1, 0.4, 0.3, 0.1])
    prior = PosePrior(here.truth[0], root @ root.T)
    starts = find_start(here.term, prior, settings=TrackingSettings(start_grid=3), registration=fixed).poses
    offsets = se3.log(se3.between(prior.pose, starts))
    whitened = np.linalg.solve(np.linalg.cholesky(prior.covariance), offsets.T).T
    assert len(np.unique(np.round(whitened, 5), axis=0)) == 27
    # Over x, y and heading: a vehicle stands on its wheels.
    assert whitened[:, [0, 1, 5]] == pytest.approx(np.zeros((27, 3)), abs=1e-5)
    assert np.unique(np.round(whitened[:, [2, 3, 4]], 5)) == pytest.approx([-1, 0, 1])
    found = find_start(here.term, here.prior, settings=QUICK)
    assert distances(here.errors(found.poses[found.best][None], slice(1))) < 0.05


def test_blind_scans_leave_what_odometry_and_prior_say() -> None:
    here = room()
    prepared, scans, motions = few()
    blind = [scan.select(scan.status == RayStatus.NO_RETURN) for scan in scans]
    term = prepared.term(blind)
    prior = PosePrior.from_sigmas(here.truth[0], 0.05, 0.01)
    covariances = here.covariances[:3]
    tracked = track(term, motions, prior, covariances=covariances, settings=QUICK)
    smoothed = smooth(term, motions, tracked.trajectory.poses, prior=prior, covariances=covariances)
    pose, covariance = here.truth[0], prior.covariance
    for k in range(4):
        if k:
            pose = se3.compose(pose, motions[k - 1])
            carried = se3.adjoint(se3.inverse(motions[k - 1]))
            covariance = carried @ covariance @ carried.T + covariances[k - 1]
        for result in (tracked, smoothed):
            assert result.trajectory.poses[k] == pytest.approx(pose, abs=1e-5)
            scale = np.sqrt(np.diag(covariance))
            assert result.trajectory.covariances[k] / np.outer(scale, scale) == pytest.approx(
                covariance / np.outer(scale, scale), abs=1e-3
            )


def test_motions_nobody_measured_are_searched_for() -> None:
    here = room()
    prepared, scans, motions = few()
    gap = motions.copy()
    gap[1] = np.eye(4)
    result = localize(
        prepared, scans, gap, here.truth[0], known=[True, False, True], settings=LocalizationSettings(tracking=QUICK)
    )
    for part in (result.tracked, result.smoothed):
        assert part.rejected["motions not measured"] == 1
        assert distances(here.errors(part.trajectory.poses, slice(4))).max() < 0.05
    assert len(result.smoothed.residuals["odometry"]) == 2


def test_the_map_itself_serves_as_well_as_one_prepared() -> None:
    here = room()
    settings = LocalizationSettings(tracking=QUICK, information=0.5)
    _, scans, motions = few(3)
    by_map = localize(here.statistics, scans, motions, here.truth[0], settings=settings)
    by_prepared = localize(here.prepared, scans, motions, here.truth[0], settings=settings)
    assert by_map.smoothed.trajectory.poses == pytest.approx(by_prepared.smoothed.trajectory.poses, abs=1e-9)


def test_the_frame_of_the_map_is_that_of_the_results() -> None:
    here = room()
    moved = replace(here.statistics, grid=replace(here.statistics.grid, frame="hall"))
    result = localize(PreparedMap.of(moved), *few(2)[1:], here.truth[0], settings=LocalizationSettings(tracking=QUICK))
    assert {result.tracked.trajectory.world, result.smoothed.trajectory.world} == {"hall"}


def test_what_does_not_fit_is_refused(office) -> None:
    here = room()
    prepared, scans, motions = few()
    away = here.truth[0].copy()
    away[2, 3] = 50.0
    for start in (away, PosePrior.from_sigmas(away, 1, 1)):
        with pytest.raises(MapError, match=r"start: .* lies outside the map; give a pose within"):
            localize(prepared, scans, motions, start)
    with pytest.raises(MapError, match="start: it has 2 dimensions, the map 3; give a pose of the map's"):
        localize(prepared, scans, motions, np.zeros(3))
    for arguments, line in [
        ((prepared, scans, motions[:2], here.truth[0]), "expected 3 motions between 4 scans"),
        ((prepared, scans, np.zeros((3, 3)), here.truth[0]), "odometry"),
        ((prepared, [], motions, here.truth[0]), "none given"),
        ((prepared, scans, motions, np.full((4, 4), np.nan)), "prior pose"),
        ((prepared, scans, motions, 2 * np.eye(4)), "prior pose"),
    ]:
        with pytest.raises(GeometryError, match=line):
            localize(*arguments)
    with pytest.raises(GeometryError, match="expected a finite 6 x 6 matrix a motion"):
        localize(prepared, scans, motions, here.truth[0], covariances=np.zeros((3, 3, 3)))
    with pytest.raises(MapError, match="of 2 dimensions, the map has 3"):
        localize(prepared, office.drive.scans[:4], motions, here.truth[0])
    term = SpatialScanTerm(prepared.levels, scans)
    with pytest.raises(GeometryError, match="do not fit"):
        smooth(term, motions, here.truth[:3])
