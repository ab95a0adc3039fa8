"""Scan terms as a whole: batches, threads, mounts, bounds, and what they refuse."""

from dataclasses import replace

import numpy as np
import pytest
from loose_rays import BLURS, MODELS

from factorloc import _jit
from factorloc.errors import GeometryError, MapError
from factorloc.factors import DistanceFieldTerm, ScanTerm
from factorloc.factors._scan_kernels import scan_batch
from factorloc.factors.scan_term import ScanCosts
from factorloc.geometry import se2
from factorloc.mapping import BlurPyramid, Grid, RayStatistics
from factorloc.rays import pack
from factorloc.scan import RayStatus, Scan

models = pytest.mark.parametrize("model", MODELS)
ARRAYS = ("cost", "gradient", "hessian")


@pytest.fixture(scope="module")
def scans(drawn) -> list[Scan]:
    return drawn[0][40:]


@pytest.fixture(scope="module")
def poses(drawn) -> np.ndarray:
    rng = np.random.default_rng(5)
    return drawn[1][40:] + rng.normal(0, [0.05, 0.05, 0.03], (10, 3))


def assert_close(costs: ScanCosts, other: ScanCosts, tolerance: float) -> None:
    for name in ARRAYS:
        a, b = getattr(costs, name), getattr(other, name)
        assert (np.abs(a - b) <= tolerance * np.abs(b).max()).all(), name


@models
@pytest.mark.parametrize("level", [0, 1, 2, -1])
def test_a_batch_is_its_poses_one_by_one_and_its_cost_that_of_cost(make_term, scans, poses, model, level) -> None:
    term = make_term(model, scans, 0.2)
    assert isinstance(term, ScanTerm)
    assert (term.scans, term.blurs) == (10, BLURS)
    costs = term.batch(poses, level)
    assert (costs.cost.shape, costs.gradient.shape, costs.hessian.shape) == ((10,), (10, 3), (10, 3, 3))
    each = [term.batch(pose[None], level, [k]) for k, pose in enumerate(poses)]
    assert_close(costs, ScanCosts(*(np.concatenate([getattr(c, name) for c in each]) for name in ARRAYS)), 1e-12)
    assert term.cost(poses, level) == pytest.approx(costs.cost, rel=1e-12)
    alone = [make_term(model, [scan], 0.2).cost(pose[None], level)[0] for scan, pose in zip(scans, poses, strict=True)]
    assert costs.cost == pytest.approx(np.array(alone), rel=1e-12)
    assert (costs.cost >= term.least_cost(level)).all()


@models
def test_neither_threads_nor_their_number_change_anything(make_term, scans, poses, model) -> None:
    many = np.tile(poses, (40, 1))  # enough work to be dealt to threads
    index = np.tile(np.arange(10), 40)
    term = make_term(model, scans, 0.2)
    most = _jit.set_threads(None)
    try:
        parallel = term.batch(many, -1, index)
        _jit.set_threads(1)
        single = term.batch(many, -1, index)
    finally:
        assert _jit.set_threads(None) == most
    for name in ARRAYS:
        assert (getattr(parallel, name) == getattr(single, name)).all()
    n = len(many)
    serial = ScanCosts(np.empty(n), np.empty((n, 3)), np.empty((n, 3, 3)))
    rays, tertiary = term.rays, None if term.tertiary is None else term.tertiary[-1]
    scan_batch(
        term.model, many, index, rays.origins, rays.directions, rays.ranges, rays.offsets, term.primary[-1],
        term.secondary[-1], tertiary, term.numbers[-1], *term.layout, 1.0, True, serial.cost, serial.gradient,
        serial.hessian,
    )  # fmt: skip
    assert_close(parallel, ScanCosts(*(0.2 * getattr(serial, name) for name in ARRAYS)), 1e-12)
    assert_close(parallel, ScanCosts(*(np.concatenate([part] * 40) for part in _parts(term.batch(poses)))), 1e-12)


def _parts(costs: ScanCosts) -> list[np.ndarray]:
    return [getattr(costs, name) for name in ARRAYS]


@models
def test_any_scan_can_be_tried_at_any_pose(make_term, scans, poses, model) -> None:
    term = make_term(model, scans)
    index = np.array([7, 7, 0, 3])
    mixed = term.batch(poses[[1, 7, 0, 2]], 0, index)
    for row, (pose, scan) in enumerate(zip(poses[[1, 7, 0, 2]], index, strict=True)):
        assert mixed.cost[row] == pytest.approx(make_term(model, [scans[scan]]).cost(pose[None], 0)[0], rel=1e-12)


@models
def test_information_scales_costs_and_derivatives(make_term, scans, poses, model) -> None:
    full, fifth = make_term(model, scans), make_term(model, scans, 0.2)
    for a, b in zip(_parts(full.batch(poses)), _parts(fifth.batch(poses)), strict=True):
        assert b == pytest.approx(0.2 * a, rel=1e-12)
    assert fifth.least_cost() == pytest.approx(0.2 * full.least_cost())


@models
def test_a_mounted_sensor_is_moved_to_the_body(make_term, scans, poses, model) -> None:
    mount = np.array([0.8, -0.4, 2.1])
    mounted = [replace(scan, T_body_sensor=mount) for scan in scans]
    bare = [replace(scan, T_body_sensor=se2.identity()) for scan in scans]
    body, sensor = make_term(model, mounted).batch(poses), make_term(model, bare).batch(se2.compose(poses, mount))
    # T_body exp(xi) T_mount = T_body T_mount exp(Ad(T_mount^-1) xi)
    Ad = se2.adjoint(se2.inverse(mount))
    carried = ScanCosts(sensor.cost, sensor.gradient @ Ad, Ad.T @ sensor.hessian @ Ad)
    assert_close(body, carried, 1e-6)


@models
def test_rays_without_return_do_not_take_part(make_term, scans, poses, model) -> None:
    status = [np.where(np.arange(len(scan)) % 3 == 0, RayStatus.NO_RETURN, scan.status) for scan in scans]
    status[4][:] = RayStatus.BELOW_MINIMUM
    marked = [replace(scan, status=s) for scan, s in zip(scans, status, strict=True)]
    fewer = [scan.select(scan.is_return) for scan in marked]
    costs = make_term(model, marked).batch(poses)
    assert_close(costs, make_term(model, fewer).batch(poses), 1e-12)
    assert costs.cost[4] == 0
    assert (costs.hessian[4] == 0).all()
    assert make_term(model, marked).least_cost()[4] == 0
    assert_close(costs, make_term(model, pack(marked)).batch(poses), 0)


@models
def test_the_true_pose_is_cheaper_than_its_surroundings(make_term, scans, drawn, model) -> None:
    truth = drawn[1][40:]
    term = make_term(model, scans)
    for level in range(len(BLURS)):
        here = term.cost(truth, level).sum()
        for offset in np.array([[0.3, 0, 0], [-0.3, 0, 0], [0, 0.3, 0], [0, -0.3, 0], [0, 0, 0.2], [0, 0, -0.2]]):
            assert here < term.cost(se2.compose(truth, offset), level).sum()


@pytest.mark.parametrize(
    ("poses", "index", "line"),
    [
        (np.zeros((9, 3)), None, "9 for 10 scans"),
        (np.zeros((10, 2)), None, r"shape \(10, 2\)"),
        (np.zeros(3), None, r"shape \(3,\)"),
        (np.full((10, 3), np.nan), None, "finite"),
        (np.zeros((2, 3)), [0, 10], "indices below 10"),
        (np.zeros((2, 3)), [-1, 0], "indices below 10"),
        (np.zeros((2, 3)), [0], "2 indices"),
    ],
)
def test_poses_that_do_not_fit_are_refused(make_term, scans, poses, index, line) -> None:
    term = make_term("decay-rate", scans)
    for call in (term.batch, term.cost):
        with pytest.raises(GeometryError, match=line):
            call(poses, -1, index)


def test_no_pose_at_all_costs_nothing(make_term, scans) -> None:
    costs = make_term("decay-rate", scans).batch(np.zeros((0, 3)), -1, [])
    assert costs.hessian.shape == (0, 3, 3)


@models
def test_spatial_scans_do_not_fit_a_planar_map(make_term, model) -> None:
    scan = Scan(np.array([[1.0, 0, 0]]), np.ones(1), np.zeros(1, np.uint8), (0.0, 5.0))
    with pytest.raises(MapError, match="3 dimensions"):
        make_term(model, [scan])


def test_a_map_without_reflecting_cells_has_no_distances(scans, statistics) -> None:
    with pytest.raises(MapError, match="lower least_rate"):
        DistanceFieldTerm(statistics, scans, least_rate=1e12)
    with pytest.raises(MapError, match="no cell"):
        DistanceFieldTerm(RayStatistics.empty(Grid((0, 0), 0.1, (9, 9))), scans)


@pytest.mark.parametrize("blurs", [(), (0.5, 0.5), (0.1, 0.5), (0.5, -0.1)])
def test_blurs_must_decrease_for_either_model(scans, statistics, blurs) -> None:
    with pytest.raises(MapError, match="decreasing"):
        BlurPyramid.from_statistics(statistics, blurs)
    with pytest.raises(MapError, match="decreasing"):
        DistanceFieldTerm(statistics, scans, blurs=blurs)


def test_distances_are_those_to_reflecting_cells_cut_at_the_farthest(scans, statistics) -> None:
    term = DistanceFieldTerm(statistics, scans, farthest=0.6, least_rate=3.0, blurs=(0.0,))
    grid = statistics.grid
    field = term.primary[0].reshape(grid.shape[0] + 2, -1)
    reflecting = np.argwhere(statistics.hits > 3.0 * statistics.path_lengths)
    rng = np.random.default_rng(2)
    for i, j in rng.integers(0, grid.shape, (200, 2)):
        distance = grid.resolution * np.hypot(*(reflecting - [i, j]).T).min()
        assert field[i + 1, j + 1] == pytest.approx(min(distance, 0.6))
    assert (field[[0, -1]] == 0.6).all()
    assert (field[:, [0, -1]] == 0.6).all()
    assert term.numbers.tolist() == [[0.6, 0.05, 2.0]]


def test_a_blurred_level_is_as_wide_as_its_blur(scans, statistics) -> None:
    term = DistanceFieldTerm(statistics, scans, sigma=0.03, blurs=(0.4, 0.0))
    assert term.numbers[:, 1] == pytest.approx([np.hypot(0.03, 0.4), 0.03])
