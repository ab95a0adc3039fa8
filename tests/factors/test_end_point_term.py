"""The end-point term against the model it is made of."""

import numpy as np
import pytest
from hypothesis import given
from strategies import floats

from factorloc.errors import MapError
from factorloc.factors import EndPointLevels, EndPointTerm, SpatialEndPointTerm
from factorloc.factors._scan_kernels import mixture_loss
from factorloc.mapping import Grid
from factorloc.mapping.distance_transform import DistanceField
from factorloc.mapping.end_point import EndPointModel
from factorloc.rays import pack
from factorloc.scan import RayStatus, Scan

GRID = Grid((0.0, 0.0), 0.1, (40, 40))
SPACE = Grid((0.0, 0.0, 0.0), 0.1, (40, 40, 20))


@pytest.fixture(scope="module")
def model() -> EndPointModel:
    occupied = np.zeros(GRID.shape, bool)
    occupied[30, 5:35] = occupied[8, 12] = True
    return EndPointModel(DistanceField.from_occupied(GRID, occupied, 1.2), 0.2, hit=0.8, random=0.3)


@pytest.fixture(scope="module")
def spatial() -> EndPointModel:
    occupied = np.zeros(SPACE.shape, bool)
    occupied[30, 5:35, 3:9] = occupied[:, :, 0] = True
    return EndPointModel(DistanceField.from_occupied(SPACE, occupied, 1.2), 0.2, hit=0.8, random=0.3)


def test_at_the_centres_of_cells_it_is_the_log_score(model) -> None:
    rng = np.random.default_rng(3)
    cells = rng.integers(0, 40, (200, 2))
    ends = (cells + 0.5) * 0.1
    scan = Scan.from_points(ends - [2.0, 1.0], (0.0, 9.0))
    term = EndPointTerm(EndPointLevels.of(model, (0.0,)), [scan])
    pose = np.array([2.0, 1.0, 0.0])
    assert term.cost(pose[None])[0] == pytest.approx(-model.log_likelihood(scan, pose).sum(), rel=1e-9)


def test_in_space_as_well(spatial) -> None:
    rng = np.random.default_rng(3)
    ends = (rng.integers(0, SPACE.shape, (200, 3)) + 0.5) * 0.1
    scan = Scan.from_points(ends - [2.0, 1.0, 0.5], (0.0, 9.0))
    pose = np.eye(4)
    pose[:3, 3] = [2.0, 1.0, 0.5]
    term = SpatialEndPointTerm(EndPointLevels.of(spatial, (0.4, 0.0)), [scan])
    assert term.cost(pose[None])[0] == pytest.approx(-spatial.log_likelihood(scan, pose).sum(), rel=1e-5)


def test_a_wider_level_is_the_model_with_more_variance(model, drawn) -> None:
    scan = Scan.from_points(np.array([[1.0, 0.3], [0.2, 1.1], [-0.5, 0.4]]), (0.0, 5.0))
    pose = np.array([[2.1, 1.3, 0.2]])
    levels = EndPointLevels.of(model, (0.4, 0.0))
    wide = EndPointModel(model.distances, float(np.hypot(0.4, 0.2)), hit=0.8, random=0.3)
    alone = EndPointTerm(EndPointLevels.of(wide, (0.0,)), [scan])
    term = EndPointTerm(levels, [scan])
    assert term.cost(pose, 0) == pytest.approx(alone.cost(pose))
    assert term.cost(pose, 1) != pytest.approx(alone.cost(pose))
    assert term.least_cost(0) == pytest.approx(alone.least_cost())


@given(floats(0, 8), floats(1e-9, 1))
def test_the_mixture_is_a_loss_that_lets_go(residual, floor) -> None:
    value, slope = mixture_loss(residual, floor, 0.7)
    assert value == pytest.approx(-0.7 - np.log(np.exp(-(residual**2) / 2) + floor), rel=1e-12, abs=1e-12)
    step = 1e-5
    ahead, behind = (mixture_loss(residual + s, floor, 0.7)[0] for s in (step, -step))
    assert slope == pytest.approx((ahead - behind) / (2 * step), abs=1e-6)
    least = -0.7 - np.log1p(floor)
    # Gauss and Newton's quadratic lies below the loss: w r^2 / 2 is never more than what is above the least.
    assert value - least >= 0.5 * slope * residual - 1e-12


def test_the_maximum_range_is_that_of_the_scans_or_given(model) -> None:
    levels = EndPointLevels.of(model, (0.0,))
    points = np.array([[1.0, 0.3], [0.2, 1.1]])
    near, far = (Scan.from_points(points, (0.0, limit)) for limit in (5.0, 20.0))
    poses = np.array([[2.0, 1.0, 0.1]] * 2)
    both = EndPointTerm(levels, [near, far])
    assert both.cost(poses) == pytest.approx(EndPointTerm(levels, pack([near, far]), 1.0, 20.0).cost(poses))
    with pytest.raises(MapError, match="give maximum_range"):
        EndPointTerm(levels, pack([near]))
    with pytest.raises(MapError, match="needs the sensor's"):
        EndPointTerm(levels, [Scan.from_points(points, (0.0, np.inf))])


def test_models_and_terms_of_different_dimension_do_not_fit(model, spatial) -> None:
    flat = Scan.from_points(np.array([[1.0, 0.3]]), (0.0, 5.0))
    solid = Scan.from_points(np.array([[1.0, 0.3, 0.2]]), (0.0, 5.0))
    for term, levels, scan in [
        (EndPointTerm, spatial, solid),
        (SpatialEndPointTerm, model, flat),
        (EndPointTerm, model, solid),
        (SpatialEndPointTerm, spatial, flat),
    ]:
        with pytest.raises(MapError):
            term(EndPointLevels.of(levels, (0.0,)), [scan])
    with pytest.raises(MapError, match="decreasing"):
        EndPointLevels.of(model, (0.0, 0.5))


def test_rays_without_return_do_not_take_part(spatial) -> None:
    points = np.array([[1.0, 0.3, 0.2], [1.5, 0.1, 0.4]])
    scan = Scan.from_points(points, (0.0, 5.0))
    blind = Scan(scan.directions, scan.ranges, np.array([RayStatus.RETURN, RayStatus.NO_RETURN], np.uint8), (0.0, 5.0))
    levels = EndPointLevels.of(spatial, (0.0,))
    pose = np.eye(4)[None] + 0.0
    one = SpatialEndPointTerm(levels, [scan.select(np.array([True, False]))])
    assert SpatialEndPointTerm(levels, [blind]).cost(pose) == pytest.approx(one.cost(pose))
