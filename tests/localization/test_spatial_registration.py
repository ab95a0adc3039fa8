"""Registration in space finds a scan's pose from around it, and a single scan's result says what is known."""

import numpy as np
import pytest
from spatial_room import distances, room, turns

from factorloc import _jit
from factorloc.errors import GeometryError, MapError, OptimizationError
from factorloc.factors import DecayRateTerm, PosePrior
from factorloc.factors.level_tables import LevelTables
from factorloc.factors.spatial_scan_term import SpatialScanTerm
from factorloc.geometry import se2, se3
from factorloc.localization import MeasurementSettings, PreparedMap, RegistrationSettings, register, register_many
from factorloc.mapping import BrickStatistics, Grid, RayStatistics
from factorloc.result import StopReason
from factorloc.scan import RayStatus

ALL = np.arange(14)
OFFSET = np.array([0.02, -0.03, 0.1, 0.25, -0.2, 0.1])


@pytest.fixture(scope="module")
def found():
    here = room()
    guesses = se3.compose(here.truth, se3.exp(np.where(ALL[:, None] % 2, OFFSET, -OFFSET)))
    return register_many(here.term, guesses, ALL), guesses


def test_poses_are_found_from_around(found) -> None:
    result, guesses = found
    errors = room().errors(result.poses)
    assert distances(errors).max() < 0.06
    assert np.median(distances(errors)) < 0.015
    assert turns(errors).max() < np.radians(0.6)
    assert se3.as_poses(result.poses).shape == (14, 4, 4), "still rigid"
    assert np.abs(room().errors(guesses)[:, 3:]).max() > 0.2


def test_what_is_reported_is_what_the_term_says(found) -> None:
    result, guesses = found
    term = room().term
    there = term.batch(result.poses)
    assert result.costs == pytest.approx(there.cost, rel=1e-9)
    assert result.hessians == pytest.approx(there.hessian, rel=1e-7, abs=1e-6)
    assert (result.costs < term.cost(guesses)).all()
    assert (result.iterations <= 40 * len(term.blurs)).all()
    assert result.best == np.argmin(result.costs)
    again = register_many(term, result.poses, ALL, levels=[-1])
    assert (again.costs <= result.costs + 1e-9).all()


def test_with_enough_steps_every_level_converges() -> None:
    settings = RegistrationSettings(max_iterations=200)
    assert register_many(room().term, room().truth, ALL, settings=settings).converged.all()
    once = register_many(room().term, room().truth, ALL, settings=RegistrationSettings(max_iterations=1))
    assert (once.iterations <= len(room().term.blurs)).all()


def test_guesses_do_not_depend_on_each_other_or_on_threads(found) -> None:
    result, guesses = found
    most = _jit.set_threads(None)
    try:
        _jit.set_threads(1)
        alone = register_many(room().term, guesses, ALL)
    finally:
        assert _jit.set_threads(None) == most
    assert np.array_equal(result.poses, alone.poses)
    (own,) = register_many(room().term, guesses[5:6], [5]).poses
    assert np.array_equal(own, result.poses[5])


def test_guesses_are_left_as_they_were() -> None:
    guess = room().truth[:1].copy()
    register_many(room().term, guess)
    assert np.array_equal(guess, room().truth[:1])


def test_a_firm_prior_outweighs_the_scan_and_a_loose_one_does_not() -> None:
    truth, term = room().truth[4], room().term
    wrong = se3.compose(truth, se3.exp(OFFSET))
    firm = register_many(term, wrong[None], [4], prior=PosePrior.from_sigmas(wrong, 1e-5, 1e-5))
    assert np.abs(se3.log(se3.between(wrong, firm.poses[0]))).max() < 5e-3
    prior = PosePrior.from_sigmas(wrong, 1.0, 0.2)
    loose = register_many(term, wrong[None], [4], prior=prior)
    assert distances(se3.log(se3.between(truth, loose.poses[0]))) < 0.03
    # The cost holds the prior's, by rotation vector and translation in its frame; the Hessian is the scan's alone.
    moved = se3.between(wrong, loose.poses[0])
    r = np.concatenate([se3.log(moved)[:3], moved[:3, 3]])
    own = term.batch(loose.poses, -1, [4])
    assert loose.costs[0] == pytest.approx(own.cost[0] + 0.5 * r @ prior.information @ r, rel=1e-6)
    assert loose.hessians[0] == pytest.approx(own.hessian[0], rel=1e-7, abs=1e-6)


@pytest.mark.parametrize(
    ("guesses", "arguments", "line"),
    [
        (np.eye(4), {}, "expected rows, one pose each"),
        (np.zeros((2, 3)), {}, "guesses"),
        (2 * np.eye(4)[None], {}, "guesses"),
        (np.full((1, 4, 4), np.nan), {}, "guesses"),
        (np.eye(4)[None], {"scan_of_guess": [14]}, "indices below 14"),
        (np.eye(4)[None], {"scan_of_guess": [-1]}, "indices below 14"),
        (np.eye(4)[None], {"scan_of_guess": [0, 1]}, "indices below 14"),
        (np.eye(4)[None], {"levels": []}, "at least one"),
        (np.eye(4)[None], {"levels": [5]}, "the map has 5"),
    ],
)
def test_guesses_that_do_not_fit_are_refused(guesses, arguments, line) -> None:
    with pytest.raises(GeometryError, match=line):
        register_many(room().term, guesses, **arguments)


# ---- one scan ----


@pytest.mark.parametrize("k", [0, 6, 11])
def test_a_scan_is_registered_in_space(k) -> None:
    here = room()
    guess = se3.compose(here.truth[k], se3.exp(OFFSET))
    result = register(here.scans[k], here.prepared, guess)
    (pose,) = result.trajectory.poses
    error = here.errors(pose[None], slice(k, k + 1))
    assert distances(error) < 0.06
    assert turns(error) < np.radians(0.6)
    assert result.trajectory.stamps == [here.scans[k].stamp]
    assert result.trajectory.world == "map"
    (covariance,) = result.trajectory.covariances
    assert covariance == pytest.approx(covariance.T)
    excess = covariance - here.prepared.floor
    hessian = here.prepared.term([here.scans[k]]).batch(pose[None]).hessian[0]
    assert excess == pytest.approx(np.linalg.inv(hessian), rel=1e-5, abs=1e-9)
    assert (error[0] @ np.linalg.solve(covariance, error[0])) / 6 < 2
    assert result.cost == pytest.approx(here.prepared.term([here.scans[k]]).cost(pose[None])[0])
    assert result.residuals["scan"] == pytest.approx([result.cost])
    assert result.stop in (StopReason.CONVERGED, StopReason.MAX_ITERATIONS)
    left = result.rejected["rays without return or left out"]
    assert left == len(here.scans[k]) - len(here.prepared.term([here.scans[k]]).rays.ranges) > 0


def test_a_prior_is_a_guess_that_holds() -> None:
    here = room()
    wrong = se3.compose(here.truth[3], se3.exp(OFFSET))
    held = register(here.scans[3], here.prepared, PosePrior.from_sigmas(wrong, 1e-4, 1e-4))
    assert np.abs(se3.log(se3.between(wrong, held.trajectory.poses[0]))).max() < 0.02
    loose = register(here.scans[3], here.prepared, PosePrior.from_sigmas(wrong, 1, 1))
    assert distances(here.errors(loose.trajectory.poses, slice(3, 4))) < 0.06
    assert np.linalg.det(held.trajectory.covariances[0]) < np.linalg.det(loose.trajectory.covariances[0])


def test_a_scan_is_registered_in_the_plane_by_the_same_call(office) -> None:
    prepared = PreparedMap.of(office.statistics)
    scan = office.drive.scans[9]
    guess = se2.compose(office.truth[9], [0.2, -0.15, 0.05])
    result = register(scan, prepared, guess)
    (pose,), (covariance,) = result.trajectory.poses, result.trajectory.covariances
    assert np.hypot(*(pose - office.truth[9])[:2]) < 0.05
    hessian = prepared.term([scan]).batch(pose[None]).hessian[0]
    assert covariance - prepared.floor == pytest.approx(np.linalg.inv(hessian), rel=1e-6, abs=1e-12)
    held = register(scan, prepared, PosePrior.from_sigmas(guess, 1e-4, 1e-4))
    assert held.trajectory.poses[0] == pytest.approx(guess, abs=0.01)


def test_a_scan_that_says_nothing_is_refused(office) -> None:
    here = room()
    silent = here.scans[0].select(here.scans[0].status == RayStatus.NO_RETURN)
    with pytest.raises(GeometryError, match="no ray has a return"):
        register(silent, here.prepared, here.truth[0])
    # One ray holds no pose, but a prior does.
    single = here.scans[0].select(np.arange(len(here.scans[0])) == np.flatnonzero(here.scans[0].status == 0)[0])
    far = here.truth[0].copy()
    far[:3, 3] += 100.0
    with pytest.raises(OptimizationError, match="does not determine the pose here; give a prior"):
        register(single, here.prepared, far)
    prior = PosePrior.from_sigmas(far, 0.1, 0.1)
    (covariance,) = register(single, here.prepared, prior).trajectory.covariances
    assert covariance == pytest.approx(prior.covariance + here.prepared.floor)
    with pytest.raises(MapError, match="of 2 dimensions, the map has 3"):
        register(office.drive.scans[0], here.prepared, here.truth[0])
    with pytest.raises(MapError, match="of 3 dimensions, the map has 2"):
        register(here.scans[0], PreparedMap.of(office.statistics), office.truth[0])


@pytest.mark.parametrize("guess", [np.zeros(3), np.eye(3), np.eye(4)[None], np.full((4, 4), np.nan), 3 * np.eye(4)])
def test_a_guess_that_is_no_pose_is_refused(guess) -> None:
    with pytest.raises(GeometryError):
        register(room().scans[0], room().prepared, guess)


def test_a_planar_prior_is_refused_in_space() -> None:
    with pytest.raises(GeometryError):
        register(room().scans[0], room().prepared, PosePrior.from_sigmas(np.zeros(3), 1.0, 0.1))


# ---- maps made ready ----


def test_a_prepared_map_in_space() -> None:
    prepared = room().prepared
    assert isinstance(prepared.levels, LevelTables)
    assert (prepared.dimension, prepared.grid) == (3, room().statistics.grid)
    assert prepared.levels.blurs == (4.0, 1.0, 0.5, 0.25, 0.0)
    assert prepared.quick_levels == [0, 2, 3, 4]
    assert prepared.information == 0.5
    assert prepared.floor == pytest.approx(np.diag([0.001] * 3 + [0.02] * 3) ** 2)
    term = prepared.term(room().scans[:2])
    assert isinstance(term, SpatialScanTerm)
    assert (term.scans, term.information) == (2, 0.5)


def test_settings_make_another_map() -> None:
    settings = MeasurementSettings(information=0.1, blurs=(0.4, 0.0), rays=50, map_position=0.1, map_heading=0.2)
    prepared = PreparedMap.of(room().statistics, settings)
    assert prepared.quick_levels == [0, 1, 2]
    assert prepared.levels.blurs == (4.0, 0.4, 0.0)
    term = prepared.term(room().scans[:2])
    assert np.diff(term.rays.offsets).tolist() == [50, 50]
    assert term.information == prepared.information == 0.1
    assert prepared.floor == pytest.approx(np.diag([0.2] * 3 + [0.1] * 3) ** 2)
    assert PreparedMap.of(room().statistics, MeasurementSettings(blurs=(0.0,))).quick_levels == [0, 1]


def test_dense_and_sparse_statistics_make_one_map() -> None:
    window = Grid(room().statistics.grid.origin, 0.2, (30, 20, 32))
    dense = room().statistics.window(window)
    one, other = PreparedMap.of(dense), PreparedMap.of(BrickStatistics.from_dense(dense))
    assert np.array_equal(one.levels.primary, other.levels.primary)
    assert np.array_equal(one.levels.directory, other.levels.directory)


def test_maps_that_cannot_be_made_ready_are_refused(office) -> None:
    with pytest.raises(MapError, match="'distance-field' is for planar maps"):
        PreparedMap.of(room().statistics, MeasurementSettings(model="distance-field"))
    with pytest.raises(MapError, match="holds no hit"):
        PreparedMap.of(RayStatistics.empty(Grid((0, 0, 0), 0.5, (4, 4, 4))))
    planar = PreparedMap.of(office.statistics)
    assert (planar.dimension, planar.information, planar.quick_levels) == (2, 0.2, None)
    assert isinstance(planar.term(office.drive.scans[:2]), DecayRateTerm)
    assert planar.floor == pytest.approx(np.diag([0.02, 0.02, 0.003]) ** 2)
    with pytest.raises(MapError, match="of 3 dimensions, the map has 2"):
        planar.term(room().scans[:1])
