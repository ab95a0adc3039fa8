"""The best combination of candidates is the best of all combinations."""

import itertools

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from strategies import floats

from factorloc.factors import DecayRateTerm, OdometryNoise, odometry_factors
from factorloc.geometry import se2
from factorloc.localization.candidates import best_sequence, choose_poses


@st.composite
def chains(draw: st.DrawFn):
    n, c = draw(st.integers(1, 5)), draw(st.integers(1, 3))
    costs = floats(-10, 10)
    return draw(arrays(np.float64, (n, c), elements=costs)), draw(arrays(np.float64, (n - 1, c, c), elements=costs))


def total(unary, pairwise, path) -> float:
    n = len(unary)
    return float(unary[np.arange(n), path].sum() + sum(pairwise[k][path[k], path[k + 1]] for k in range(n - 1)))


@given(chains())
def test_the_best_sequence_is_the_best_of_all(chain) -> None:
    unary, pairwise = chain
    n, c = unary.shape
    found = best_sequence(unary, pairwise)
    best = min(total(unary, pairwise, list(path)) for path in itertools.product(range(c), repeat=n))
    assert np.isclose(total(unary, pairwise, found), best, atol=1e-9)


def test_chosen_poses_cost_the_whole_graph_the_least(office) -> None:
    n = 6
    rng = np.random.default_rng(6)
    term = DecayRateTerm(office.pyramid, office.drive.scans[:n], 0.002)
    motions, noise = office.drive.odometry[: n - 1], OdometryNoise(huber=0.7, least_turn=0.01, least_length=0.02)
    candidates = [office.truth[:n] + rng.normal(0, [0.06, 0.06, 0.04], (n, 3)) for _ in range(3)]
    keys = [X(k) for k in range(n)]
    for known in (np.ones(n - 1, bool), np.array([True, True, False, True, True])):
        for prior in (office.prior, None):
            graph = gtsam.NonlinearFactorGraph()
            if prior is not None:
                graph.push_back(prior.factor(keys[0]))
            for factor in odometry_factors(keys, motions, noise, known):
                graph.push_back(factor)
            costs = {}
            for path in itertools.product(range(3), repeat=n):
                poses = np.array([candidates[c][k] for k, c in enumerate(path)])
                values = gtsam.Values()
                for key, pose in zip(keys, poses, strict=True):
                    values.insert(key, gtsam.Pose2(*pose))
                costs[path] = graph.error(values) + term.cost(poses).sum()
            best = min(costs, key=costs.get)
            chosen = choose_poses(candidates, term, motions, noise, known, prior)
            assert np.abs(chosen - [candidates[c][k] for k, c in enumerate(best)]).max() == 0
            greedy = tuple(np.argmin([term.cost(c) for c in candidates], 0))
            assert greedy != best, "motions have a say"


def test_a_single_candidate_is_taken(office) -> None:
    n = 3
    term = DecayRateTerm(office.pyramid, office.drive.scans[:n])
    known = np.ones(n - 1, bool)
    chosen = choose_poses([office.truth[:n]], term, np.zeros((n - 1, 3)), OdometryNoise(), known, None)
    assert (chosen == office.truth[:n]).all()
    assert np.abs(se2.log(se2.between(chosen, office.truth[:n]))).max() < 1e-12
