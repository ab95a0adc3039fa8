"""Localization among facades: what is guaranteed, what is conditional, and what is said when it fails."""

from dataclasses import replace

import numpy as np
import pytest
from facade_street import SHIFT, crossing, points_on

from factorloc.errors import GeometryError
from factorloc.evaluation.bounds import bound_coverage, bound_radii
from factorloc.factors import PosePrior
from factorloc.geometry import se2
from factorloc.localization.bounded_least_squares import estimate_in_bounds
from factorloc.localization.bounded_motion import OdometryBounds, propagate, widen
from factorloc.localization.correspondence import Correspondence
from factorloc.localization.correspondences import CorrespondenceSettings, find_correspondences
from factorloc.localization.facade_scan import localize_scan
from factorloc.localization.facade_settings import FacadeSettings
from factorloc.localization.feasible_layers import without_twins
from factorloc.localization.feasible_set import intersect_correspondences
from factorloc.localization.feasible_settings import FeasibleSettings
from factorloc.localization.interval_tracking import track_facades
from factorloc.localization.least_squares_settings import LeastSquaresSettings
from factorloc.localization.line_cells import accumulator_of
from factorloc.localization.wall_lines import WallLines
from factorloc.mapping.facades import Facades
from factorloc.result import Bounds

WIDE = np.array([5.0, 5.0, np.radians(5.0)])


@pytest.fixture(scope="module")
def street():
    rng = np.random.default_rng(2)
    facades, true = crossing(rng)
    return WallLines(facades), true


def facing(walls, pose):
    """Walls that turn their outer side to a pose."""
    away = pose[:2] - walls.centres
    return np.flatnonzero(((walls.normals * away).sum(1) > 1.0) & (np.hypot(*away.T) < 35))


def scene(street, seed):
    walls, true = street
    rng = np.random.default_rng(seed)
    pose = np.array([*rng.uniform(-4, 4, 2), rng.uniform(-np.pi, np.pi)])
    points, of = points_on(true, facing(walls, pose), pose, rng)
    return pose, points, of, Bounds.around(pose + rng.uniform(-1, 1, 3) * WIDE, 5.0, np.radians(5.0))


def test_lines_hold_the_true_walls_about_their_middles(street):
    walls, true = street
    c, s = walls.cos_sin
    for share in (0.0, 0.3, 1.0):
        points = true[:, 0] + share * (true[:, 1] - true[:, 0])
        away = points - walls.centres
        radius = walls.vertex_d + walls.shift_d
        # The true line has one direction in alpha; the range over alpha has to meet d.
        reach = c * away[:, 0] + s * away[:, 1]
        assert ((reach.lo <= radius) & (reach.hi >= -radius)).all()
    along = true[:, 1] - true[:, 0]
    alpha = np.arctan2(-along[:, 0], along[:, 1])
    turned = alpha - 2 * np.pi * np.round((alpha - walls.alpha.mid) / (2 * np.pi))
    assert walls.alpha.contains(turned).all()
    assert walls.hull.contains(np.moveaxis(true, 0, -1).transpose(1, 0, 2)[:, 0]).all()


def test_no_point_of_a_wall_in_sight_is_lost_by_association(street):
    walls = street[0]
    lost = pairs = 0
    for seed in range(20):
        pose, points, of, start = scene(street, seed)
        assert start.contains(pose)
        found = find_correspondences(points, walls, start, CorrespondenceSettings(least_length=0.0))
        for row, mask in zip(found.asked, found.associated, strict=True):
            lost += int((~mask[of == row]).sum())
            pairs += int((of == row).sum())
    assert pairs > 10_000
    assert lost == 0


def test_truth_is_in_the_feasible_set_of_right_correspondences(street):
    walls = street[0]
    sets, truth = [], []
    for seed in range(60):
        pose, points, _, start = scene(street, 100 + seed)
        found = find_correspondences(points, walls, start)
        assert len(found.found) >= 2
        feasible = intersect_correspondences(found.found, walls, start)
        sets.append(feasible.bounds)
        truth.append(pose)
    coverage = bound_coverage(sets, truth)
    assert coverage.share >= 0.98
    assert coverage.mean_radii[0] < 1.5
    assert coverage.mean_radii[2] < np.radians(2.0)


def line_of(walls, true, row, pose, slack=0.02, doubt=0.01):
    """The correspondence of a wall that is seen without any error but a hull of cells."""
    from factorloc.intervals import Interval

    start, end = se2.transform(se2.inverse(pose), true[row])
    normal = np.array([(end - start)[1], -(end - start)[0]]) / np.hypot(*(end - start))
    anchor = se2.transform(se2.inverse(pose), walls.centres[row])
    alpha, d = np.arctan2(normal[1], normal[0]), float(normal @ (start - anchor))
    middle = float((0.5 * (start + end) - anchor) @ [-normal[1], normal[0]])
    return Correspondence(
        int(row), anchor, Interval.around(alpha, 0.005), Interval.around(d, slack), 50, 0.1, 1.0, (middle, middle),
        (-5.0, 5.0), doubt,
    )  # fmt: skip


def test_intersection_never_loses_the_truth_of_right_lines():
    """Monte-Carlo: exact lines of true walls, whatever shifts, poses and starts; not one violation."""
    for seed in range(60):
        rng = np.random.default_rng(seed)
        facades, true = crossing(rng)
        walls = WallLines(facades)
        pose = np.array([*rng.uniform(-4, 4, 2), rng.uniform(-np.pi, np.pi)])
        rows = rng.permutation(facing(walls, pose))[: rng.integers(1, 9)]
        start = Bounds.around(pose + rng.uniform(-1, 1, 3) * WIDE, 5.0, np.radians(5.0))
        found = tuple(line_of(walls, true, row, pose) for row in rows)
        for settings in (FeasibleSettings(confidence=0.01), FeasibleSettings(cells=20)):
            feasible = intersect_correspondences(found, walls, start, settings)
            assert feasible.bounds.contains(pose)
            assert feasible.failed == 0
            assert feasible.conflicts == ()


def test_walls_of_one_building_share_its_shift(street):
    walls, true = street
    pose, turned = np.array([1.0, -2.0, 0.4]), np.radians(45.0)
    corner = [row for row in facing(walls, pose) if walls.facades.buildings[row] == 0]
    assert len(corner) == 2
    spin = np.array([[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]])
    mapped = walls.facades
    moved = np.array([*(spin @ pose[:2]), pose[2] + turned])
    start = Bounds.around(moved, 5.0, np.radians(5.0))
    radii = []
    for buildings in (mapped.buildings, np.arange(len(mapped))):
        slanted = WallLines(Facades(mapped.segments @ spin.T, buildings, mapped.shifts, mapped.vertex_errors))
        found = tuple(line_of(slanted, true @ spin.T, row, moved) for row in corner)
        feasible = intersect_correspondences(found, slanted, start, FeasibleSettings(confidence=0.01, cells=100))
        assert feasible.bounds.contains(moved)
        polygon = feasible.bounds.polygons[0]
        radii.append(np.ptp(polygon, axis=0).max())
    # A box of the shift reaches less far along the axes than two slanted strips, each widened by it.
    assert radii[0] < radii[1] - 2 * SHIFT * 0.3


def test_contradicting_facades_are_named_and_no_pose_is_invented(street):
    walls, true = street
    pose = np.array([0.0, 0.0, 0.1])
    rows = facing(walls, pose)[:6]
    found = [line_of(walls, true, row, pose) for row in rows]
    good = Bounds.around(pose, 5.0, np.radians(5.0))
    shifts = (0.0, 0.0, 6.0, -6.0, 6.0, -6.0)
    wrong = [replace(one, d=one.d + shift) for one, shift in zip(found, shifts, strict=True)]
    feasible = intersect_correspondences(tuple(wrong), walls, good)
    assert feasible.violated
    assert feasible.bounds.polygons == ()
    assert set(feasible.conflicts) <= {int(row) for row in rows}
    assert len(feasible.conflicts) >= 2
    with pytest.raises(GeometryError, match="no pose is possible"):
        feasible.bounds.nearest(pose)


def test_doubtful_lines_give_way_and_feasible_sets_stay_within_the_start(street):
    """A false line of much doubt costs the truth nothing; and whole cells do not reach beyond the start."""
    walls, true = street
    pose = np.array([0.5, -0.3, 0.2])
    rows = facing(walls, pose)[:4]
    found = [line_of(walls, true, row, pose) for row in rows]
    wrong = replace(found[0], d=found[0].d + 4.0, doubt=0.4)
    start = Bounds.around(pose + np.array([0.4, 0.4, 0.0]), 1.0, np.radians(2.0))
    feasible = intersect_correspondences((wrong, *found[1:]), walls, start)
    assert feasible.bounds.contains(pose)
    assert feasible.conflicts == (int(rows[0]),)
    assert feasible.failed == 1
    for part in (feasible.bounds, *(one for layer in feasible.layers for one in layer.slices)):
        for polygon in part.polygons:
            assert all(start.contains([*corner, pose[2]], 1e-5) for corner in polygon)
    sure = intersect_correspondences(tuple(found), walls, start)
    assert sure.failed == 0
    assert bound_radii(sure.bounds)[0] <= bound_radii(feasible.bounds)[0] + 1e-9


def test_without_correspondences_the_start_is_left(street):
    start = Bounds.around(np.zeros(3), 5.0, 0.05)
    feasible = intersect_correspondences((), street[0], start)
    assert feasible.bounds == start
    assert not feasible.violated


def test_most_likely_pose_is_near_the_truth_and_never_outside(street):
    walls = street[0]
    errors, held = [], 0
    for seed in range(15):
        pose, points, _, start = scene(street, 300 + seed)
        step = localize_scan(points, walls, start)
        estimate = step.estimate
        assert step.feasible.bounds.contains(estimate.pose)
        errors.append(np.hypot(*(estimate.pose - pose)[:2]))
        # A tiny set around a pose 1 m off: the solver must stay inside, at its border.
        away = pose + np.array([1.0, 1.0, 0.0])
        tight = Bounds.around(away, 0.2, 0.01)
        found = find_correspondences(points, walls, start)
        inside = estimate_in_bounds(points, found, walls, away, tight)
        assert tight.contains(inside.pose)
        held += inside.held
    assert np.median(errors) < 0.35
    assert held > 0


def test_least_squares_finds_the_exact_pose_without_errors(street):
    walls, true = street
    exact = WallLines(Facades(true, walls.facades.buildings, walls.facades.shifts, walls.facades.vertex_errors))
    rng = np.random.default_rng(5)
    pose = np.array([1.0, 0.5, 0.3])
    points, _ = points_on(true, facing(exact, pose), pose, rng, error=0.0)
    start = Bounds.around(pose + np.array([1.0, -0.5, 0.02]), 3.0, np.radians(3.0))
    settings = FacadeSettings(least_squares=LeastSquaresSettings(tolerance=1e-9, most_doubt=0.02))
    step = localize_scan(points, exact, start, settings=settings)
    np.testing.assert_allclose(step.estimate.pose, pose, atol=5e-3)
    assert step.estimate.stop.converged


def test_doubtful_lines_move_no_estimate_away_from_what_is_known(street):
    walls, true = street
    rng = np.random.default_rng(6)
    pose = np.array([0.3, 0.1, -0.2])
    points, _ = points_on(true, facing(walls, pose), pose, rng)
    start = Bounds.around(pose, 3.0, np.radians(3.0))
    found = find_correspondences(points, walls, start)
    doubtful = replace(found, found=tuple(replace(one, doubt=0.4) for one in found.found))
    known = pose + np.array([1.0, -1.0, 0.01])
    prior = PosePrior.from_sigmas(known, 0.5, 0.02)
    held = estimate_in_bounds(points, doubtful, walls, known, start, prior=prior)
    np.testing.assert_allclose(held.pose, known, atol=1e-6)
    # Without anything else, even doubtful lines are better than the guess.
    free = estimate_in_bounds(points, doubtful, walls, known, start)
    assert np.hypot(*(free.pose - pose)[:2]) < 0.5


def test_propagation_loses_no_pose():
    rng = np.random.default_rng(7)
    bounds = Bounds((2.9, 3.3), (np.array([[0.0, 0.0], [2.0, 0.5], [1.5, 3.0], [0.2, 2.0]]),))
    motion, errors = np.array([1.5, 0.2, 0.1]), np.array([0.05, 0.03, 0.01])
    after = propagate(bounds, motion, errors)
    weights = rng.dirichlet(np.ones(4) * 0.3, 20_000)
    poses = np.column_stack([weights @ bounds.polygons[0], rng.uniform(*bounds.orientation, 20_000)])
    moved = se2.compose(poses, motion + rng.uniform(-1, 1, (20_000, 3)) * errors)
    assert all(after.contains(pose) for pose in moved)


def test_a_set_with_twin_corners_tells_inside_from_outside():
    square = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]])
    # The second corner again, moved by less than rounding away from the origin of a map would tell.
    origin = np.array([500.0, 900.0])
    twins = np.insert(square, 2, square[1] - 1e-13, axis=0) + origin
    polygon = without_twins(twins)
    assert np.hypot(*(np.roll(polygon, -1, 0) - polygon).T).min() > 1e-7
    rng = np.random.default_rng(1)
    for point in rng.uniform([-1.0, -1.0], [5.0, 4.0], (500, 2)):
        inside = bool(((point >= 0) & (point <= [4.0, 3.0])).all())
        assert Bounds((0.0, 1.0), (polygon,)).contains([*(point + origin), 0.5]) == inside


def test_sets_that_are_only_carried_along_keep_few_corners():
    rng = np.random.default_rng(8)
    bounds = Bounds((0.1, 0.3), (np.array([[0.0, 0.0], [2.0, 0.5], [1.5, 3.0], [0.2, 2.0]]),))
    poses = np.array([[1.0, 1.5, 0.2], [0.2, 0.1, 0.11], [1.4, 2.8, 0.29]])
    for _ in range(40):
        motion = rng.normal(0, [1.0, 0.2, 0.1])
        bounds = widen(propagate(bounds, motion, [0.05, 0.03, 0.005]), 0.05, 0.001)
        poses = se2.compose(poses, motion + rng.uniform(-1, 1, (3, 3)) * [0.05, 0.03, 0.005])
        assert all(bounds.contains(pose) for pose in poses)
        assert len(bounds.polygons[0]) <= 64


def test_tracking_keeps_the_truth_and_says_where_it_could_not(street):
    walls, true = street
    rng = np.random.default_rng(9)
    truth = np.array([[-6.0 + 0.8 * k, 0.4 * np.sin(0.3 * k), 0.05 * np.sin(0.5 * k)] for k in range(15)])
    odometry = OdometryBounds()
    motions = se2.between(truth[:-1], truth[1:])
    motions = np.array([motion + rng.uniform(-1, 1, 3) * odometry.errors(motion) for motion in motions])
    scans = [points_on(true, facing(walls, pose), pose, rng)[0] for pose in truth]
    # In the middle of the drive the scan is of another place.
    scans[7] = points_on(true, facing(walls, truth[7]), truth[7] + np.array([0.0, 6.0, 0.0]), rng)[0]
    start = Bounds.around(truth[0] + np.array([3.0, -2.0, 0.05]), 5.0, np.radians(5.0))
    done = []
    track = track_facades(scans, np.arange(15.0), motions, walls, start, progress=done.append)
    coverage = bound_coverage(track.result.bounds, truth)
    assert coverage.share == 1.0
    assert done == list(range(1, 16))
    poses = track.result.trajectory.poses
    assert all(bounds.contains(pose, 1e-9) for bounds, pose in zip(track.result.bounds, poses, strict=True))
    assert np.hypot(*(poses - truth)[:, :2].T).max() < 1.5
    assert track.result.rejected["scans whose assumptions are violated"] == track.violated.sum()


def test_a_start_that_is_too_wide_is_carried_along_and_a_wide_one_is_asked_in_pieces(street):
    walls, true = street
    rng = np.random.default_rng(3)
    pose = np.array([0.5, -0.5, 0.1])
    points = points_on(true, facing(walls, pose), pose, rng)[0]
    after = se2.compose(pose, [1.0, 0.0, 0.0])
    lost = Bounds.around(np.zeros(3), 40.0, np.radians(40.0))
    track = track_facades([points, points], [0.0, 1.0], [[1.0, 0.0, 0.0]], walls, lost)
    assert not track.violated.any()
    assert [len(step.correspondences.found) for step in track.steps] == [0, 0]
    assert track.result.bounds[1].contains(after)
    # Twice as wide in heading as one scan is asked for at a time.
    wide = Bounds.around(np.array([2.0, 1.0, 0.0]), 7.0, np.radians(40.0))
    track = track_facades([points], [0.0], [], walls, wide)
    assert len(track.steps[0].correspondences.found) > 0
    assert track.result.bounds[0].contains(pose)
    assert bound_radii(track.result.bounds[0])[2] < np.radians(10.0)


def test_radii_are_half_sides_and_empty_sets_count_as_failures():
    tilted = Bounds((0.0, 0.2), (np.array([[2.0, 0.0], [0.0, 2.0], [-1.0, 1.0], [1.0, -1.0]]),))
    small, large, angle = bound_radii(tilted)
    np.testing.assert_allclose([small, large, angle], [np.sqrt(2) / 2, np.sqrt(2), 0.1])
    coverage = bound_coverage([tilted, Bounds((0.0, 1.0), ())], [[0.5, 0.5, 0.1], [0.0, 0.0, 0.5]])
    assert coverage.share == 0.5
    assert coverage.empty == 0.5


def test_headings_are_compared_across_turns():
    bounds = Bounds((3.0, 3.4), (np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]),))
    assert bounds.contains([0.2, 0.2, 3.2 - 2 * np.pi])
    assert not bounds.contains([0.2, 0.2, 2.9])
    assert not bounds.contains([0.9, 0.9, 3.2])
    assert bounds.contains(bounds.nearest([5.0, 5.0, -2.0]))


def test_picture_accumulator_is_that_of_the_search(street):
    walls = street[0]
    _, points, _, start = scene(street, 11)
    found = find_correspondences(points, walls, start)
    one = found.found[0]
    row = int(np.flatnonzero(found.asked == one.facade)[0])
    accumulator = accumulator_of(points, found.associated[row], walls, one.facade, start)
    peak = accumulator.peak()
    assert peak.votes == one.votes
    spare = CorrespondenceSettings().spare_turn
    np.testing.assert_allclose([peak.alpha.lo - spare, peak.d.hi], [one.alpha.lo, one.d.hi], atol=1e-9)


def test_a_start_that_is_too_wide_or_empty_gets_one_line(street):
    _, points, _, _ = scene(street, 12)
    with pytest.raises(GeometryError, match="60"):
        find_correspondences(points, street[0], Bounds((0.0, 2.0), Bounds.around(np.zeros(3), 1.0, 1.0).polygons))
    with pytest.raises(GeometryError, match="no position"):
        find_correspondences(points, street[0], Bounds((0.0, 0.1), ()))
