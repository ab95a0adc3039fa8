"""Pole factors: Jacobians by differences, the mixture against a plain one, and associations that must not be wrong."""

import gtsam
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from factorloc.errors import GeometryError, MapError
from factorloc.factors import ScanTerm
from factorloc.factors.pole_association import JointCompatibility, MaxMixture, NearestNeighbour
from factorloc.factors.pole_detections import PoleDetections, PoleLandmarks, PoleMixture
from factorloc.factors.pole_factors import (
    known_poles_factor,
    landmark_factors,
    landmark_priors,
    pole_rows,
    vertical_line_rows,
)
from factorloc.factors.pole_term import PoleTerm
from factorloc.geometry import se2, se3
from factorloc.mapping.poles import Poles

KEY = 7


def some_poles(rng: np.random.Generator, positions: np.ndarray) -> Poles:
    n = len(positions)
    bottom = rng.uniform(-0.5, 0.5, n)
    spans = np.column_stack([bottom, bottom + rng.uniform(1, 4, n)])
    return Poles(positions, rng.uniform(0.1, 0.4, n), spans, rng.uniform(0.6, 1.0, n))


def scene(seed: int, local_maps: int = 6) -> tuple[PoleDetections, PoleLandmarks, np.ndarray]:
    """Landmarks, and detections of some of them among clutter, from known poses."""
    rng = np.random.default_rng(seed)
    landmarks = some_poles(rng, rng.uniform(-30, 30, (60, 2)))
    poses = np.column_stack([rng.uniform(-10, 10, (local_maps, 2)), rng.uniform(-np.pi, np.pi, local_maps)])
    maps = []
    for pose in poses:
        seen = landmarks.select(rng.random(60) < 0.3).transformed(se2.inverse(pose))
        noisy = Poles(seen.positions + rng.normal(0, 0.08, (len(seen), 2)), seen.widths, seen.spans, seen.scores)
        maps.append(Poles.joined([noisy, some_poles(rng, rng.uniform(-15, 15, (3, 2)))]))
    return PoleDetections.of(maps), PoleLandmarks(landmarks, rng.uniform(0.3, 1.0, 60)), poses


def naive_cost(detections, landmarks, mixture, pose, number, blur) -> float:
    """The mixture, one pair at a time."""
    local, total = detections.local_map(number), 0.0
    usual, spread = detections.poles.scores.mean(), detections.poles.scores.std()
    places = se2.transform(pose, local.positions)
    for k in range(len(local)):
        worth = mixture.score_slope * (local.scores[k] - usual) / spread if spread > 0 else 0.0
        clutter = mixture.clutter * np.exp(-np.clip(worth, -mixture.attribute_cap, mixture.attribute_cap))
        variance = mixture.sigma**2 + mixture.landmark_sigma**2 + blur**2
        best = 0.0
        for m in range(len(landmarks)):
            d = places[k] - landmarks.poles.positions[m]
            density = np.exp(-0.5 * d @ d / variance) / (2 * np.pi * variance)
            width = 0.5 * ((local.widths[k] - landmarks.poles.widths[m]) / mixture.width_sigma) ** 2
            tall = np.diff(local.spans[k])[0] - np.diff(landmarks.poles.spans[m])[0]
            height = 0.5 * (tall / mixture.height_sigma) ** 2
            cost = -np.log(max(landmarks.probabilities[m] * density / clutter, 1e-300))
            cost += min(width, mixture.attribute_cap) + min(height, mixture.attribute_cap)
            best = min(best, cost)
        total += best
    return total


def test_the_term_is_the_mixture_pair_by_pair() -> None:
    detections, landmarks, poses = scene(1)
    term = PoleTerm(detections, landmarks)
    assert isinstance(term, ScanTerm)
    rng = np.random.default_rng(2)
    for level, blur in enumerate(term.blurs):
        off = poses + rng.normal(0, 0.3, poses.shape) * [1, 1, 0.05]
        found = term.batch(off, level)
        for n, pose in enumerate(off):
            wanted = naive_cost(detections, landmarks, term.mixture, pose, n, blur)
            assert found.cost[n] == pytest.approx(wanted, abs=1e-9)
        assert (found.cost >= term.least_cost(level) - 1e-9).all()
        assert term.cost(off[[3]], level, [3]) == pytest.approx(found.cost[[3]])


def test_its_gradient_is_that_of_its_cost_while_pairs_stay() -> None:
    detections, landmarks, poses = scene(3)
    rng = np.random.default_rng(4)
    term = PoleTerm(detections, landmarks, information=0.7)
    for level in range(len(term.blurs)):
        off = poses + rng.normal(0, 0.05, poses.shape) * [1, 1, 0.05]
        found = term.batch(off, level)
        step = 1e-6
        for axis in np.eye(3):
            ahead, behind = (term.cost(se2.compose(off, se2.exp(s * step * axis)), level) for s in (1, -1))
            assert found.gradient @ axis == pytest.approx((ahead - behind) / (2 * step), rel=1e-4, abs=1e-4)


def test_its_hessian_is_gauss_and_newtons() -> None:
    detections, landmarks, poses = scene(5)
    term = PoleTerm(detections, landmarks, blurs=(0.0,))
    matches, _ = term.matches(poses)
    assert (matches >= 0).sum() > 20
    variance = term.mixture.sigma**2 + term.mixture.landmark_sigma**2
    found = term.batch(poses)
    for n, pose in enumerate(poses):
        mine = (detections.pose_of == n) & (matches >= 0)
        _, J = pole_rows(pose, detections.poles.positions[mine], landmarks.poles.positions[matches[mine]])
        J = J.reshape(-1, 3)
        assert found.hessian[n] == pytest.approx(J.T @ J / variance)


@given(st.integers(0, 2**32 - 1))
def test_jacobians_of_rows_are_differences(seed) -> None:
    rng = np.random.default_rng(seed)
    step = 1e-6
    pose = rng.uniform(-3, 3, 3)
    points, there = rng.uniform(-20, 20, (4, 3)), rng.uniform(-20, 20, (4, 2))
    _, jacobian = pole_rows(pose, points[:, :2], there)
    for i, axis in enumerate(np.eye(3)):
        ends = [pole_rows(se2.compose(pose, se2.exp(s * step * axis)), points[:, :2], there)[0] for s in (1, -1)]
        assert jacobian[:, :, i] == pytest.approx((ends[0] - ends[1]) / (2 * step), abs=1e-6)
    pose = se3.exp(rng.uniform(-1, 1, 6) * [1, 1, 3, 9, 9, 9])
    _, jacobian = vertical_line_rows(pose, points, there)
    for i, axis in enumerate(np.eye(6)):
        ends = [vertical_line_rows(pose @ se3.exp(s * step * axis), points, there)[0] for s in (1, -1)]
        assert jacobian[:, :, i] == pytest.approx((ends[0] - ends[1]) / (2 * step), abs=1e-6)


@pytest.mark.parametrize("spatial", [False, True])
def test_the_custom_factor_has_the_jacobian_of_its_residual_and_pays_for_null(spatial) -> None:
    detections, landmarks, poses = scene(6)
    local = detections.local_map(0)
    association = NearestNeighbour(0.4)
    factor = known_poles_factor(KEY, local, landmarks, association, spatial=spatial)
    native = gtsam.Pose3(se3.from_se2(poses[0])) if spatial else gtsam.Pose2(*poses[0])
    values = gtsam.Values()
    values.insert(KEY, native)
    A, b = factor.linearize(values).jacobian()
    assert 0.5 * b @ b == pytest.approx(factor.error(values))
    unmatched = association.associate(local, landmarks, poses[0]) < 0
    assert unmatched.any()
    assert factor.error(values) >= 4.5 * unmatched.sum()
    step = 1e-6
    for i, axis in enumerate(np.eye(A.shape[1])):
        ends = []
        for sign in (1, -1):
            moved = gtsam.Values()
            moved.insert(KEY, native.retract(sign * step * axis))
            ends.append(-factor.linearize(moved).jacobian()[1])
        assert A[:, i] == pytest.approx((ends[0] - ends[1]) / (2 * step), abs=1e-5)


def test_a_factor_in_space_stands_the_vehicle_beside_its_poles() -> None:
    _, landmarks, poses = scene(7)
    rng = np.random.default_rng(8)
    truth = se3.from_se2(poses[0]) @ se3.exp(np.array([0.02, -0.03, 0.0, 0.0, 0.0, 0.0]))
    truth[2, 3] = 1.2
    spans = landmarks.poles.spans
    middle = np.column_stack([landmarks.poles.positions, spans.mean(1)])
    seen = se3.transform(se3.inverse(truth), middle)
    half = np.diff(spans, axis=1)[:, 0] / 2
    there = np.column_stack([seen[:, 2] - half, seen[:, 2] + half])
    local = Poles(seen[:, :2], landmarks.poles.widths, there, landmarks.poles.scores)
    graph = gtsam.NonlinearFactorGraph()
    graph.push_back(known_poles_factor(KEY, local, landmarks, NearestNeighbour(1.0), spatial=True))
    wide = gtsam.noiseModel.Isotropic.Sigma(6, 10.0)
    graph.push_back(gtsam.PriorFactorPose3(KEY, gtsam.Pose3(truth), wide))  # the height is free
    values = gtsam.Values()
    values.insert(KEY, gtsam.Pose3(truth @ se3.exp(rng.normal(0, 0.01, 6))))
    found = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize().atPose3(KEY).matrix()
    assert found[:2, 3] == pytest.approx(truth[:2, 3], abs=1e-3)
    assert se3.to_se2(found)[2] == pytest.approx(poses[0][2], abs=1e-3)


def test_landmarks_as_variables_are_found_together_with_the_poses() -> None:
    rng = np.random.default_rng(9)
    landmarks = rng.uniform(-20, 20, (12, 2))
    poses = np.column_stack([np.linspace(-5, 5, 8), np.zeros(8), np.linspace(0, 0.5, 8)])
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    pairs = [(n, m) for n in range(8) for m in range(12)]
    points = np.array([se2.transform(se2.inverse(poses[n]), landmarks[m]) for n, m in pairs])
    points[5] += 3.0  # one that is wrong
    for factor in landmark_factors([n for n, _ in pairs], [100 + m for _, m in pairs], points, 0.1):
        graph.push_back(factor)
    for factor in landmark_priors(range(100, 112), landmarks + rng.normal(0, 0.02, (12, 2)), 0.02):
        graph.push_back(factor)
    for n, pose in enumerate(poses):
        values.insert(n, gtsam.Pose2(*(pose + rng.normal(0, 0.2, 3))))
    for m, position in enumerate(landmarks):
        values.insert(100 + m, position + rng.normal(0, 0.2, 2))
    found = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    for n, pose in enumerate(poses):
        native = found.atPose2(n)
        assert [native.x(), native.y(), native.theta()] == pytest.approx(pose, abs=0.05)


def test_what_makes_no_landmark_factor_is_refused() -> None:
    with pytest.raises(GeometryError, match="no bearing"):
        list(landmark_factors([1], [2], [[0.0, 0.0]], 0.1))
    with pytest.raises(GeometryError, match="1 poses, 2 landmarks"):
        list(landmark_factors([1], [2, 3], [[1.0, 0.0]], 0.1))


def test_nearest_neighbours_keep_to_the_gate_and_the_mixture_to_its_odds() -> None:
    detections, landmarks, poses = scene(10)
    local = detections.local_map(2)
    places = se2.transform(poses[2], local.positions)
    found = NearestNeighbour(0.5).associate(local, landmarks, poses[2])
    apart = np.linalg.norm(places[:, None] - landmarks.poles.positions, axis=2)
    assert ((found >= 0) == (apart.min(1) <= 0.5)).all()
    assert (found[found >= 0] == apart.argmin(1)[found >= 0]).all()
    likely = MaxMixture().associate(local, landmarks, poses[2])
    assert (likely[:-3] >= 0).mean() > 0.8
    doubted = PoleLandmarks(landmarks.poles, np.full(len(landmarks), 1e-9))
    assert (MaxMixture().associate(local, doubted, poses[2]) == -1).all()
    for policy in (NearestNeighbour(), MaxMixture(), JointCompatibility(np.eye(3))):
        assert len(policy.associate(Poles.none(), landmarks, poses[2])) == 0
        assert (policy.associate(local, landmarks.select(np.zeros(60, bool)), poses[2]) == -1).all()


def test_jointly_compatible_pairs_see_through_a_shift_that_fools_the_nearest() -> None:
    rng = np.random.default_rng(11)
    row = np.column_stack([np.arange(8) * 2.0 + rng.uniform(-0.4, 0.4, 8), np.full(8, 4.0)])
    landmarks = PoleLandmarks(some_poles(rng, row))
    truth, believed = np.array([5.0, 0.0, 0.0]), np.array([6.2, 0.0, 0.0])
    local = landmarks.poles.select(slice(1, 7)).transformed(se2.inverse(truth))
    nearest = NearestNeighbour(2.0).associate(local, landmarks, believed)
    assert (nearest != np.arange(1, 7)).any()
    joint = JointCompatibility(np.diag([1.0, 0.1, 0.02]) ** 2, sigma=0.1).associate(local, landmarks, believed)
    assert joint.tolist() == list(range(1, 7))


def test_jointly_compatible_pairs_leave_out_what_does_not_move_with_the_rest() -> None:
    rng = np.random.default_rng(12)
    landmarks = PoleLandmarks(some_poles(rng, rng.uniform(-15, 15, (9, 2))))
    seen = landmarks.poles.positions.copy()
    seen[4] += [0.9, -0.6]
    local = Poles(seen, landmarks.poles.widths, landmarks.poles.spans, landmarks.poles.scores)
    joint = JointCompatibility(np.diag([0.5, 0.5, 0.02]) ** 2, sigma=0.1).associate(local, landmarks, np.zeros(3))
    assert joint[4] == -1
    assert np.delete(joint, 4).tolist() == [0, 1, 2, 3, 5, 6, 7, 8]


def test_packed_detections_are_unpacked_selected_and_cut() -> None:
    detections, _, poses = scene(13)
    assert len(detections) == len(poses)
    kept = np.arange(len(detections.poles)) % 2 == 0
    assert len(detections.select(kept).poles) == kept.sum()
    part = detections.rows(2, 5)
    assert len(part) == 3
    assert part.local_map(0).positions == pytest.approx(detections.local_map(2).positions)
    with pytest.raises(GeometryError, match="offsets end at 1"):
        PoleDetections(detections.poles, np.array([0, 1]))
    with pytest.raises(MapError, match="none; a map without poles"):
        PoleTerm(detections, PoleLandmarks(Poles.none()))
    with pytest.raises(MapError, match="one probability above 0"):
        PoleLandmarks(detections.poles, np.zeros(len(detections.poles)))
    with pytest.raises(GeometryError, match="does not fit 6 local maps"):
        PoleTerm(detections, scene(13)[1]).cost(poses, scan_of_pose=np.arange(6) + 1)
    assert not PoleMixture(score_slope=0.0).replaced(sigma=0.2).score_slope


@given(st.floats(0.1, 100.0), st.floats(-50.0, 50.0))
def test_what_a_score_is_worth_does_not_depend_on_its_unit(factor: float, shift: float) -> None:
    detections, _, _ = scene(3)
    poles = detections.poles
    scaled = Poles(poles.positions, poles.widths, poles.spans, factor * poles.scores + shift)
    mixture = PoleMixture()
    expected = detections.columns(mixture)[:, 3]
    assert expected.std() > 0.1
    assert PoleDetections(scaled, detections.offsets).columns(mixture)[:, 3] == pytest.approx(expected, abs=1e-6)
    alike = Poles(poles.positions, poles.widths, poles.spans, np.full(len(poles), shift))
    assert PoleDetections(alike, detections.offsets).columns(mixture)[:, 3] == pytest.approx(np.log(mixture.clutter))
