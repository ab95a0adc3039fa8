"""As many particles as the belief's spread needs."""

import numpy as np
import pytest
from scipy.stats import chi2

from factorloc.errors import ConfigError
from factorloc.geometry import se3
from factorloc.localization.kld import KldSettings, PoseBins, enough_particles, kld_bound


def test_the_bound_is_the_quantile_of_chi_square() -> None:
    bins = np.array([2, 3, 5, 10, 50, 400, 5000])
    for epsilon, confidence in ((0.05, 0.99), (0.01, 0.9)):
        exact = chi2.ppf(confidence, bins - 1) / (2 * epsilon)
        # Wilson and Hilferty are off by 2 percent at two bins and by nothing soon.
        assert kld_bound(bins, epsilon, confidence) == pytest.approx(exact, rel=0.025)
        assert kld_bound(bins[3:], epsilon, confidence) == pytest.approx(exact[3:], rel=2e-3)
    assert kld_bound([0, 1], 0.05, 0.99).tolist() == [1, 1]


def test_the_bound_keeps_its_promise() -> None:
    """Of samples as large as the bound, as many as promised diverge less than epsilon."""
    rng = np.random.default_rng(5)
    truth = rng.dirichlet(np.full(40, 30.0))
    count = int(np.ceil(kld_bound(40, 0.05, 0.95)))
    drawn = rng.multinomial(count, truth, 4000) / count
    divergence = np.where(drawn > 0, drawn * np.log(np.where(drawn > 0, drawn, 1) / truth), 0).sum(1)
    assert (divergence < 0.05).mean() == pytest.approx(0.95, abs=0.02)


def test_draws_are_counted_until_they_are_enough() -> None:
    settings = KldSettings(least=10, most=5000)
    rng = np.random.default_rng(1)
    for bins in (2, 7, 60):
        draws = rng.integers(bins, size=5000)
        found = enough_particles(draws, settings)
        met = [len(set(draws[:n].tolist())) for n in (found - 1, found)]
        bound = kld_bound(met, settings.epsilon, settings.confidence)
        assert found - 1 < bound[0]
        assert found >= bound[1]


def test_the_number_keeps_to_its_limits() -> None:
    assert enough_particles(np.zeros(900), KldSettings(least=300, most=900)) == 300
    assert enough_particles(np.arange(900), KldSettings(least=300, most=900)) == 900
    assert enough_particles(np.zeros(100), KldSettings(least=300, most=900)) == 900
    assert enough_particles(np.arange(50), KldSettings(least=50, most=50)) == 50
    assert enough_particles(np.zeros(1), KldSettings(least=1, most=1)) == 1


def test_bins_of_heading_go_round() -> None:
    bins = PoseBins(0.5, np.radians(10))
    assert bins.headings == 36
    index = bins.index([[0.1, 0.6, np.pi], [0.4, 0.9, -np.pi + 1e-9], [-0.1, 0.0, 0.0]])
    assert index.tolist() == [[0, 1, 0], [0, 1, 0], [-1, 0, 18]]
    assert PoseBins(1.0, np.pi).headings == 2


def test_bins_of_space_have_heights_and_no_tilt() -> None:
    bins = PoseBins(0.5, np.radians(10))
    level = se3.from_se2([[0.1, 0.6, 0.3]])
    tilted = se3.compose(level, se3.exp([0.2, 0, 0, 0, 0, 0]))
    raised = level.copy()
    raised[0, 2, 3] = 0.7
    assert bins.index(level).tolist() == bins.index(tilted).tolist() == [[0, 1, 0, 19]]
    assert bins.index(raised).tolist() == [[0, 1, 1, 19]]


@pytest.mark.parametrize("scale", [1.0, 1e13])
def test_numbers_are_equal_where_bins_are(scale: float) -> None:
    rng = np.random.default_rng(2)
    poses = se3.from_se2(rng.normal(0, 1, (60, 3)) * [scale, scale, 1])
    poses = np.concatenate([poses, poses])
    poses[:, 2, 3] = np.repeat(rng.normal(0, scale, 60), 2)[np.r_[0:120:2, 1:120:2]]
    bins = PoseBins(0.5, 0.2)
    index, number = bins.index(poses), bins.number(poses)
    assert ((index[:, None] == index).all(-1) == (number[:, None] == number)).all()


def test_settings_that_cross_are_refused() -> None:
    with pytest.raises(ConfigError, match="least 5 is above most 4"):
        KldSettings(least=5, most=4)
    for wrong in ({"epsilon": 0}, {"confidence": 0.4}, {"heading_bin": 4}, {"position_bin": 0}):
        with pytest.raises(ConfigError, match=next(iter(wrong))):
            KldSettings(**wrong)
