"""A filter looks elsewhere when strangers explain a scan better than what it believes, and only then."""

import numpy as np
import pytest

from factorloc.errors import ConfigError
from factorloc.localization.initialization import AroundPose
from factorloc.localization.recovery import Elsewhere, RecoverySettings, look_elsewhere

ANYWHERE = AroundPose(np.zeros(3), (10.0, 10.0))
AREA, SIGMA = 400.0, 0.5
SETTINGS = RecoverySettings(probability=0.01, probes=2000, candidates=200_000, most=0.9)


def at_three(poses: np.ndarray) -> np.ndarray:
    """Likelihood of a scan taken at (3, -2), a Gaussian that is 1 there."""
    return -0.5 * ((poses[:, :2] - [3.0, -2.0]) ** 2).sum(1) / SIGMA**2


def looked(log_evidence: float, particles: int = 500, **settings: float) -> Elsewhere | None:
    rng = np.random.default_rng(1)
    return look_elsewhere(log_evidence, at_three, ANYWHERE, SETTINGS.replaced(**settings), particles, rng)


def test_the_share_is_that_of_bayes() -> None:
    anywhere = 2 * np.pi * SIGMA**2 / AREA
    for belief in (1e-3, 1e-4, 1e-6):
        found = looked(np.log(belief))
        odds = 0.01 / 0.99 * anywhere / belief
        assert found is not None
        assert found.share == pytest.approx(min(odds / (1 + odds), 0.9), rel=0.03)
    rare = looked(np.log(1e-6), probability=1e-4)
    assert rare is not None
    odds = 1e-4 * anywhere / 1e-6
    assert rare.share == pytest.approx(odds / (1 + odds), rel=0.03)


def test_what_is_found_explains_the_scan() -> None:
    found = looked(-20.0)
    assert found is not None
    assert found.share == 0.9
    assert found.weights.sum() == pytest.approx(1)
    drawn = found.sample(20_000, np.random.default_rng(2))
    assert drawn[:, :2].mean(0) == pytest.approx([3.0, -2.0], abs=0.03)
    assert drawn[:, :2].std(0) == pytest.approx([SIGMA, SIGMA], rel=0.04)


def test_several_places_are_kept_where_one_explains_the_scan_best() -> None:
    """Strangers are tempered as particles are; the share is not."""

    def peaked(poses: np.ndarray) -> np.ndarray:
        return 1e4 * at_three(poses)

    arguments = (-1e9, peaked, ANYWHERE, SETTINGS.replaced(candidates=2000), 500)
    few, many = (look_elsewhere(*arguments, np.random.default_rng(1), least) for least in (None, 0.05))
    assert few is not None
    assert many is not None
    assert few.share == many.share
    assert 1 / (few.weights**2).sum() < 3
    assert 1 / (many.weights**2).sum() == pytest.approx(100, rel=0.01)


def test_nobody_is_believed_who_is_not_worth_a_particle() -> None:
    assert looked(0.0) is None  # the belief explains the scan as well as can be
    share = 0.01 / 0.99 * 2 * np.pi * SIGMA**2 / AREA / 1e-2
    assert looked(np.log(1e-2), particles=round(0.5 / share)) is None
    assert looked(np.log(1e-2), particles=round(2 / share)) is not None


def test_only_probes_are_asked_while_all_is_well() -> None:
    asked: list[int] = []

    def answer(poses: np.ndarray) -> np.ndarray:
        asked.append(len(poses))
        return at_three(poses)

    for belief, expected in ((0.0, [2000]), (-20.0, [2000, 200_000])):
        asked.clear()
        look_elsewhere(belief, answer, ANYWHERE, SETTINGS, 500, np.random.default_rng(1))
        assert asked == expected


def test_a_scan_the_belief_excludes_is_looked_for_unless_all_do() -> None:
    found = looked(-np.inf)
    assert found is not None
    assert found.share == 0.9
    nothing = look_elsewhere(
        -np.inf, lambda poses: np.full(len(poses), -np.inf), ANYWHERE, SETTINGS, 500, np.random.default_rng(1)
    )
    assert nothing is None


def test_settings_that_contradict_are_refused() -> None:
    with pytest.raises(ConfigError, match="candidates 10 are fewer than probes 20"):
        RecoverySettings(probes=20, candidates=10)
    for wrong in ({"probability": 0}, {"probability": 1}, {"probes": 0}, {"most": 0}):
        with pytest.raises(ConfigError, match=next(iter(wrong))):
            RecoverySettings(**wrong)
