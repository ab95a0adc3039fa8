"""Registration finds a scan's pose from around it, and says truthfully what it found."""

import numpy as np
import pytest

from factorloc import _jit
from factorloc.errors import ConfigError, GeometryError
from factorloc.factors import DecayRateTerm, DistanceFieldTerm, PosePrior
from factorloc.geometry import se2
from factorloc.localization import RegistrationSettings, register_many

SCANS = np.array([0, 9, 20, 33, 46])


def starts_around(poses: np.ndarray, distance: float, turn: float) -> np.ndarray:
    """Eight starts around each pose, (8, S, 3)."""
    angle = np.arange(8) * np.pi / 4
    offsets = np.column_stack([distance * np.cos(angle), distance * np.sin(angle), turn * (-1.0) ** np.arange(8)])
    return poses + offsets[:, None]


@pytest.fixture(scope="module")
def found(office):
    starts = starts_around(office.truth[SCANS], 0.7, np.radians(10)).reshape(-1, 3)
    return register_many(office.term, starts, np.tile(SCANS, 8)), starts


def test_poses_are_found_from_all_around(office, found) -> None:
    result, _ = found
    errors = result.poses - np.tile(office.truth[SCANS], (8, 1))
    distance, turn = np.hypot(*errors[:, :2].T), np.abs(errors[:, 2])
    right = (distance < 0.05) & (turn < np.radians(1))
    assert right.mean() >= 0.85
    assert right.reshape(8, -1).any(0).all()
    best = np.argmin(result.costs.reshape(8, -1), 0)
    assert right.reshape(8, -1)[best, np.arange(len(SCANS))].all(), "the cheapest is right"
    assert result.best == np.argmin(result.costs)


def test_a_likelihood_field_finds_them_as_well(office) -> None:
    term = DistanceFieldTerm(office.statistics, [office.drive.scans[k] for k in SCANS], 0.2)
    starts = starts_around(office.truth[SCANS], 0.4, np.radians(6))
    result = register_many(term, starts.reshape(-1, 3), np.tile(np.arange(len(SCANS)), 8))
    errors = np.hypot(*(result.poses.reshape(starts.shape) - office.truth[SCANS])[..., :2].T)
    assert (errors < 0.08).mean() > 0.7


def test_what_is_reported_is_what_the_term_says(office, found) -> None:
    result, starts = found
    index = np.tile(SCANS, 8)
    there = office.term.batch(result.poses, -1, index)
    assert result.costs == pytest.approx(there.cost, rel=1e-9)
    assert result.hessians == pytest.approx(there.hessian, rel=1e-9)
    assert (result.costs < office.term.cost(starts, -1, index)).all()
    assert (result.iterations <= 40 * len(office.term.blurs)).all()
    assert result.converged.mean() > 0.9
    assert (np.abs(result.poses[:, 2]) <= np.pi).all()


def test_a_registered_scan_stays_where_it_is(office, found) -> None:
    result, _ = found
    again = register_many(office.term, result.poses, np.tile(SCANS, 8), levels=[-1])
    assert (again.costs <= result.costs + 1e-9).all()
    assert np.median(np.abs(again.poses - result.poses).max(1)) < 1e-3


def test_guesses_do_not_depend_on_each_other_or_on_threads(office) -> None:
    starts = starts_around(office.truth[SCANS], 0.3, 0.1)[0]
    most = _jit.set_threads(None)
    try:
        together = register_many(office.term, starts, SCANS)
        _jit.set_threads(1)
        alone = register_many(office.term, starts, SCANS)
    finally:
        assert _jit.set_threads(None) == most
    assert (together.poses == alone.poses).all()
    for row, scan in enumerate(SCANS):
        single = register_many(office.term, starts[row][None], [scan])
        assert single.poses[0] == pytest.approx(together.poses[row], abs=1e-6)
        own = register_many(DecayRateTerm(office.pyramid, [office.drive.scans[scan]], 0.2), starts[row][None])
        assert own.poses[0] == pytest.approx(together.poses[row], abs=1e-6)


def test_guesses_are_left_as_they_were(office) -> None:
    guess = office.truth[:1] + 0.1
    before = guess.copy()
    register_many(office.term, guess)
    assert (guess == before).all()


def test_the_pyramid_reaches_farther_than_the_finest_level(office) -> None:
    starts = starts_around(office.truth[SCANS], 0.7, np.radians(10)).reshape(-1, 3)
    index = np.tile(SCANS, 8)

    def right(levels):
        errors = register_many(office.term, starts, index, levels=levels).poses - np.tile(office.truth[SCANS], (8, 1))
        return (np.hypot(*errors[:, :2].T) < 0.05).mean()

    assert right(None) > right([-1]) + 0.3
    assert right(range(5)) == right([0, 1, 2, -2, -1]) == right(None)


def test_a_firm_prior_outweighs_the_scan_and_a_loose_one_does_not(office) -> None:
    truth, wrong = office.truth[9], office.truth[9] + [0.3, 0.0, 0.0]
    firm = register_many(office.term, wrong[None], [9], prior=PosePrior.from_sigmas(wrong, 1e-4, 1e-4))
    assert firm.poses[0] == pytest.approx(wrong, abs=5e-3)
    prior = PosePrior.from_sigmas(wrong, 1.0, 0.2)
    loose = register_many(office.term, wrong[None], [9], prior=prior)
    assert loose.poses[0] == pytest.approx(truth, abs=0.03)
    offset = se2.log(se2.between(prior.pose, loose.poses[0]))
    cost = office.term.cost(loose.poses, -1, [9])[0] + 0.5 * offset @ prior.information @ offset
    assert loose.costs[0] == pytest.approx(cost, rel=1e-3)


def test_priors_hold_in_the_frame_of_their_body(office) -> None:
    pose = np.array([*office.truth[9, :2], 2.0])
    prior = PosePrior(pose, np.diag([4.0, 0.01, 0.04]))
    blind = DecayRateTerm(office.pyramid, [office.drive.scans[0].select(np.zeros(109, bool))])
    start = se2.compose(pose, [0.4, 0.3, 0.1])
    still = RegistrationSettings(max_iterations=1, max_translation=1e-12, max_rotation=1e-12)
    assert register_many(blind, start[None], prior=prior, settings=still).costs[0] == pytest.approx(
        0.5 * (0.4**2 / 4 + 0.3**2 / 0.01 + 0.1**2 / 0.04), rel=1e-6
    )
    assert register_many(blind, start[None], prior=prior).poses[0] == pytest.approx(pose, abs=1e-3)


def test_steps_are_as_short_as_asked(office) -> None:
    settings = RegistrationSettings(max_iterations=1, max_translation=0.02, max_rotation=0.01)
    start = office.truth[9] + [0.5, 0.3, 0.15]
    result = register_many(office.term, start[None], [9], levels=[0], settings=settings)
    moved = se2.log(se2.between(start, result.poses[0]))
    assert 0 < np.hypot(*moved[:2]) <= 0.02 + 1e-12
    assert abs(moved[2]) <= 0.01 + 1e-12
    assert result.iterations.tolist() == [1]
    assert not result.converged[0]


@pytest.mark.parametrize(
    ("guesses", "arguments", "line"),
    [
        (np.zeros(3), {}, "expected rows"),
        (np.zeros((2, 2)), {}, "rows"),
        (np.full((1, 3), np.nan), {}, "NaN"),
        (np.zeros((2, 3)), {"scan_of_guess": [0]}, "2 indices"),
        (np.zeros((1, 3)), {"scan_of_guess": [999]}, "indices below 57"),
        (np.zeros((1, 3)), {"levels": [5]}, "the map has 5"),
        (np.zeros((1, 3)), {"levels": []}, "at least one"),
    ],
)
def test_what_does_not_fit_is_refused(office, guesses, arguments, line) -> None:
    with pytest.raises(GeometryError, match=line):
        register_many(office.term, guesses, **arguments)


def test_settings_out_of_range_are_refused() -> None:
    with pytest.raises(ConfigError, match="max_iterations"):
        RegistrationSettings(max_iterations=0)
    limits = RegistrationSettings(max_iterations=7, tolerance=0.5).limits
    assert limits == pytest.approx([7, 1.0, 0.2, 0.5, 1e-4, 1e-3])
