"""Beliefs in a corridor against a slow, plain computation of the same, and a small run of the whole experiment."""

import itertools
import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from scipy.special import logsumexp

from benchmarks import corridor, posterior_simulation
from benchmarks._corridor_kernels import fire, traverse
from benchmarks.corridor import (
    ALGORITHMS,
    CONJUGATE,
    DECAY,
    MAXIMUM,
    MODELS,
    REFLECTION,
    TRUE,
    UNIFORM,
    Conventions,
    Observations,
)
from benchmarks.posterior_simulation import SETTINGS, Settings, paired_t
from factorloc.config import read_config
from factorloc.errors import ConfigError

N = 6
Ray = tuple[int, float, bool]  # voxels passed, length in the one that reflects, whether any did
Prior = tuple[float, float] | None
PRIORS = {
    REFLECTION: {MAXIMUM: None, UNIFORM: (1.0, 1.0), CONJUGATE: (0.4, 0.7)},
    DECAY: {MAXIMUM: None, UNIFORM: (1.0, 0.0), CONJUGATE: (0.4, 0.7), TRUE: (1.0, 1.0)},
}
ALL = [Conventions(ray=ray, end=end) for ray in ("forward", "voxel") for end in ("open", "ring")]


def log(value: float) -> float:
    return math.log(value) if value > 0 else -math.inf


def naive_voxel(model: str, H: float, M: float, R: float, prior: Prior, r: float, hit: bool) -> float:
    """Logarithm of the published likelihood of one voxel, as it is printed."""
    if model == REFLECTION:
        a, b = prior or (0.0, 0.0)
        return log((H + a if hit else M + b) / (H + a + M + b))
    if prior is None:
        return -H / R * r + (log(H / R) if hit else 0.0)
    a, b = prior
    return (H + a) * log((R + b) / (R + b + r)) + (log((H + a) / (R + b + r)) if hit else 0.0)


def naive_likelihood(model: str, seen: Observations, prior: Prior, pose: int, ray: Ray, forward: bool) -> float:
    passed, length, returned = ray
    stop = pose + passed if returned else (N if forward else pose + 1)
    if returned and stop >= N:
        return -math.inf
    cells = [(seen.hits[0, i], seen.misses[0, i], seen.path[0, i]) for i in range(N)]
    total = sum(naive_voxel(model, *cells[i], prior, 1.0, False) for i in range(pose, stop))
    return total + naive_voxel(model, *cells[stop], prior, length, True) if returned else total


def naive_run(model: str, seen: Observations, prior: Prior, rays: list[Ray],
              conventions: Conventions) -> tuple[list[float], list[float], int]:  # fmt: skip
    """Log belief at the true pose and sum of squared beliefs by step, and resets: a histogram shifted step by step."""
    belief = np.zeros(N)  # logarithms
    possible = np.ones(N, bool)
    truth, squares, resets = [], [], 0
    for x, ray in enumerate(rays):
        if x:
            belief, possible = np.roll(belief, 1), np.roll(possible, 1)
            if conventions.end == "open":
                belief[0], possible[0] = -np.inf, False
        belief = belief + [
            naive_likelihood(model, seen, prior, pose, ray, conventions.ray == "forward") for pose in range(N)
        ]
        if belief.max() == -np.inf:
            belief, resets = np.where(possible, 0.0, -np.inf), resets + 1
        belief = belief - logsumexp(belief)
        truth.append(belief[x])
        squares.append(np.exp(2 * belief).sum())
    return truth, squares, resets


def draw(model: str, visits: int, seed: int, conventions: Conventions) -> tuple[Observations, list[Ray]]:
    rng = np.random.default_rng(seed)
    seen = corridor.observe(model, (1, N), visits, rng)
    passed, lengths, returned = np.zeros(N, np.int64), np.zeros(N), np.zeros(N, bool)
    energies = rng.standard_exponential(N)
    fire(seen.depths[0], energies, conventions.ray == "forward", passed, lengths, returned)
    return seen, list(zip(passed.tolist(), lengths.tolist(), returned.tolist(), strict=True))


def kernel_run(model: str, seen: Observations, prior: Prior, rays: list[Ray],
               conventions: Conventions) -> np.ndarray:  # fmt: skip
    known = corridor.voxels(model, seen, None if prior is None else (np.array([prior[0]]), np.array([prior[1]])))
    silent = np.cumsum(known.miss[0, ::-1])[::-1].copy() if conventions.ray == "forward" else known.miss[0]
    passed, lengths, returned = (np.array(column) for column in zip(*rays, strict=True))
    out = np.zeros(6)
    traverse(np.zeros(N), conventions.end == "ring", passed, lengths, returned, known.form, known.first[0],
             known.second[0], known.miss[0], silent, 1e-6, out)  # fmt: skip
    return out


@pytest.mark.parametrize("conventions", ALL, ids=str)
@pytest.mark.parametrize(("model", "visits"), list(itertools.product(MODELS, (1, 3))))
def test_beliefs_are_those_of_a_histogram_shifted_step_by_step(
    model: str, visits: int, conventions: Conventions
) -> None:
    resets = 0
    for seed in range(40):
        seen, rays = draw(model, visits, seed, conventions)
        for prior in PRIORS[model].values():
            truth, squares, lost = naive_run(model, seen, prior, rays, conventions)
            out = kernel_run(model, seen, prior, rays, conventions)
            finite = [value for value in truth if value > -math.inf]
            floored = [max(value, math.log(1e-6)) for value in truth]
            expected = [np.exp(truth).sum(), sum(floored), sum(finite), N - len(finite), lost, sum(squares)]
            np.testing.assert_allclose(out, expected, rtol=1e-9, atol=1e-12)
            resets += lost
    assert resets > 0 or visits > 1  # most likely maps of one visit contradict the rays


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("prior", ["MLM", "FMP conjugate"])
def test_all_rays_from_a_pose_together_have_probability_one(model: str, prior: str) -> None:
    seen, _ = draw(model, 3, 5, ALL[0])
    chosen = PRIORS[model][prior]

    def probability(pose: int, passed: int, length: float, returned: bool) -> float:
        return math.exp(naive_likelihood(model, seen, chosen, pose, (passed, length, returned), True))

    steps = (np.arange(2000) + 0.5) / 2000 if model == DECAY else [0.5]
    for pose in range(N):
        returns = [np.mean([probability(pose, passed, s, True) for s in steps]) for passed in range(N - pose)]
        assert sum(returns) + probability(pose, 0, 1.0, False) == pytest.approx(1.0, abs=1e-5)


def test_a_miss_that_is_nearly_impossible_refutes_nothing() -> None:
    """A rate of 10,000 in every voxel: the belief is far below the smallest number there is, but it is a belief."""
    ones = np.ones((1, N))
    seen = Observations(ones, ones, 0 * ones, 1e-4 * ones)
    out = kernel_run(DECAY, seen, None, [(0, 1.0, False)] * N, Conventions(ray="voxel", end="ring"))
    np.testing.assert_allclose(out, [1.0, N * math.log(1 / N), N * math.log(1 / N), 0.0, 0.0, 1.0])


def test_rays_end_where_their_depth_is_used_up() -> None:
    passed, lengths, returned = np.zeros(3, np.int64), np.zeros(3), np.zeros(3, bool)
    depths, energies = np.array([1.0, 2.0, 0.5]), np.array([2.0, 2.6, 0.25])
    fire(depths, energies, True, passed, lengths, returned)
    np.testing.assert_array_equal(passed, [1, 2, 0])
    np.testing.assert_array_equal(returned, [True, False, True])
    np.testing.assert_allclose(lengths, [0.5, 1.0, 0.5])
    fire(depths, energies, False, passed, lengths, returned)
    np.testing.assert_array_equal(returned, [False, False, True])
    np.testing.assert_array_equal(passed, [1, 1, 0])


@pytest.mark.parametrize("model", MODELS)
def test_observations_have_the_frequencies_of_the_model(model: str) -> None:
    seen = corridor.observe(model, (2000, 5), 4, np.random.default_rng(1))
    np.testing.assert_array_equal(seen.hits + seen.misses, 4)
    assert (seen.hits / 4).mean() == pytest.approx(0.5, abs=0.02)  # E mu, and E 1 - exp(-lambda) of Gamma(1, 1)
    if model == DECAY:
        # The expected number of hits is the rate times the expected path, in every voxel.
        assert (seen.hits - seen.depths * seen.path).mean() == pytest.approx(0.0, abs=0.06)


def test_moments_give_back_the_prior_they_came_from() -> None:
    rng = np.random.default_rng(2)
    alpha, beta = corridor.beta_by_moments(rng.beta(2.0, 0.7, (1, 400_000)))
    assert (alpha[0], beta[0]) == (pytest.approx(2.0, rel=0.02), pytest.approx(0.7, rel=0.02))
    alpha, beta = corridor.gamma_by_moments(rng.gamma(2.0, 1 / 0.7, (1, 400_000)))
    assert (alpha[0], beta[0]) == (pytest.approx(2.0, rel=0.02), pytest.approx(0.7, rel=0.02))


def test_beta_moments_are_the_published_formulas() -> None:
    mu = np.random.default_rng(3).random((1, 50))
    E, var = mu.mean(), mu.var()
    alpha, beta = corridor.beta_by_moments(mu)
    assert alpha[0] == pytest.approx(-E * (E**2 - E + var) / var)
    assert beta[0] == pytest.approx((E - var + E * var - 2 * E**2 + E**3) / var)


def test_degenerate_moments_are_told_apart() -> None:
    alpha, beta = corridor.beta_by_moments(np.array([[0.0, 1.0, 1.0], [0.5, 0.5, 0.5], [0.0, 0.0, 0.0]]))
    np.testing.assert_array_equal(alpha, [0.0, np.nan, np.nan])
    np.testing.assert_array_equal(beta, [0.0, np.nan, np.nan])
    alpha, _ = corridor.gamma_by_moments(np.array([[0.0, 0.0], [1.0, 1.0], [np.inf, 1.0], [1.0, 2.0]]))
    np.testing.assert_array_equal(np.isnan(alpha), [True, True, True, False])


def test_after_one_visit_the_fitted_prior_is_none_and_the_posterior_the_most_likely_map() -> None:
    beliefs = corridor.simulate(REFLECTION, 1, 60, 20, 1, ALL[0], 1e-6)
    np.testing.assert_array_equal(beliefs.of(CONJUGATE, "rho"), beliefs.of(MAXIMUM, "rho"))
    assert beliefs.no_moments == 0
    assert (beliefs.of(UNIFORM, "rho") != beliefs.of(MAXIMUM, "rho")).any()


@pytest.mark.parametrize("model", MODELS)
def test_first_runs_do_not_depend_on_how_many_follow(model: str) -> None:
    few, many = (corridor.simulate(model, 2, runs, 10, 7, ALL[0], 1e-6) for runs in (30, 120))
    np.testing.assert_array_equal(few.values, many.values[:30])
    assert not np.array_equal(many.values[:50], many.values[50:100])


@pytest.mark.parametrize("model", MODELS)
def test_a_right_belief_is_at_the_truth_what_it_claims_to_be(model: str) -> None:
    """On a ring of voxels that are seen once each, the posterior with the true prior is exact, so it is calibrated."""
    beliefs = corridor.simulate(model, 2, 2000, 20, 3, Conventions(ray="voxel", end="ring"), 1e-6)

    def deviations(algorithm: str) -> float:
        excess = beliefs.of(algorithm, "claimed") - beliefs.of(algorithm, "rho")
        return float(excess.mean() / (excess.std() / math.sqrt(len(excess))))

    assert abs(deviations(TRUE)) < 4
    assert deviations(MAXIMUM) > 10
    for other in ALGORITHMS:
        assert beliefs.of(TRUE, "log floored").mean() >= beliefs.of(other, "log floored").mean()


def test_the_paired_test_is_scipy_s() -> None:
    a, b = np.random.default_rng(4).normal([[0.2], [0.0]], 1.0, (2, 50))
    expected = stats.ttest_rel(a, b, alternative="greater")
    assert paired_t(a, b) == (pytest.approx(expected.statistic), pytest.approx(expected.pvalue))
    assert paired_t(b, a)[1] == pytest.approx(1 - expected.pvalue)
    assert all(map(math.isnan, paired_t(a, a)))


def test_a_quick_run_writes_its_report_and_its_picture(tmp_path: Path) -> None:
    small = read_config(SETTINGS, Settings).replaced(
        quick_runs=20, visits=(1, 2, 4), judged={REFLECTION: (2,), DECAY: (4,)}
    )
    (tmp_path / "small.json").write_text(small.model_dump_json(), encoding="utf-8")
    files = ["--json", str(tmp_path / "p.json"), "--plot", str(tmp_path / "p.svg")]
    code = posterior_simulation.main(["--quick", "--settings", str(tmp_path / "small.json"), *files])
    report = json.loads((tmp_path / "p.json").read_text(encoding="utf-8"))
    assert code == (0 if all(goal["met"] for goal in report["goals"]) else 1)
    assert len(report["goals"]) == 6
    assert report["settings"]["runs made"] == 20
    assert 0 < report["figures"]["REF, n = 4, FMP conjugate: rho"]["value"] < 1
    assert report["figures"]["REF, n = 1, FMP conjugate over MLM: p of rho"]["value"] is None
    assert "<svg" in (tmp_path / "p.svg").read_text(encoding="utf-8")


def test_judged_visits_are_among_those_made() -> None:
    with pytest.raises(ConfigError, match="judged"):
        read_config(SETTINGS, Settings).replaced(visits=(1, 2))
