"""A filter takes itself for lost when scans fit worse than they used to."""

import numpy as np
import pytest

from factorloc.errors import ConfigError
from factorloc.localization.recovery import Recovery, RecoverySettings


def after(*likelihoods: float, **settings: float) -> Recovery:
    recovery = Recovery(RecoverySettings(**settings))
    for likelihood in likelihoods:
        recovery = recovery.updated(likelihood)
    return recovery


def test_nothing_is_drawn_anew_while_all_is_well() -> None:
    assert after().share == 0
    assert after(0.4).share == 0
    assert after(*[0.4] * 50).share == 0
    rising = after(0.01, 0.02, 0.1, 0.4, 0.4, 0.4)
    assert rising.averages[1] > rising.averages[0]
    assert rising.share == 0


def test_averages_forget_at_their_rates() -> None:
    recovery = after(1.0, 2.0, 4.0, slow=0.01, fast=0.5)
    slow = np.array([0.99**2, 0.99, 1])
    fast = np.array([0.25, 0.5, 1])
    values = np.array([1, 2, 4])
    assert recovery.averages == pytest.approx((slow @ values / slow.sum(), fast @ values / fast.sum()))


def test_the_share_follows_the_drop() -> None:
    recovery = after(*[0.4] * 100, *[0.04] * 10)
    slow, fast = recovery.averages
    assert recovery.share == pytest.approx(1 - fast / slow)
    assert 0.8 < recovery.share < 0.9
    assert after(*[0.4] * 100, *[0.04] * 10, most=0.1).share == 0.1
    # A drop that is tolerated, one that lasts for a scan only, and one that is over.
    assert after(*[0.4] * 100, *[0.2] * 10).share == 0
    assert after(*[0.4] * 100, 0.04).share == 0
    assert after(*[0.4] * 100, *[0.04] * 10, *[0.4] * 3).share == 0
    assert after(*[0.4] * 100, *[0.2] * 10, tolerance=1.5).share > 0


def test_what_was_drawn_is_given_time() -> None:
    recovery = after(*[0.4] * 5, *[0.001] * 8).acted()
    assert recovery.averages[1] == pytest.approx(recovery.averages[0])
    assert recovery.averages[0] == after(*[0.4] * 5, *[0.001] * 8).averages[0]
    waited = 0
    while recovery.share == 0:
        recovery, waited = recovery.updated(0.001), waited + 1
    assert 3 <= waited <= 6


def test_scans_nobody_explains_count_as_zero() -> None:
    assert after(0.0, 0.0).share == 0  # nothing to compare with
    assert after(*[0.4] * 20, *[0.0] * 20).share == 0.9


def test_settings_out_of_order_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"slow 0.3 must be below fast 0.3"):
        RecoverySettings(slow=0.3)
    with pytest.raises(ConfigError, match="tolerance"):
        RecoverySettings(tolerance=0.5)
