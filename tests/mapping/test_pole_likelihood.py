"""The likelihood of detected poles against a tree of the map, and what it refuses."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from factorloc.errors import MapError
from factorloc.geometry import se2
from factorloc.mapping import SensorModel
from factorloc.mapping.point_cells import PointCells
from factorloc.mapping.pole_likelihood import PoleLikelihood, clutter_density, pole_scan
from factorloc.mapping.poles import Poles


@pytest.fixture(scope="module")
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


@pytest.fixture(scope="module")
def landmarks(rng) -> np.ndarray:
    return rng.uniform([-700.0, 4000.0], [-600.0, 4090.0], (150, 2))


@pytest.fixture(scope="module")
def poses(rng) -> np.ndarray:
    return np.column_stack([rng.uniform(-720, -580, 300), rng.uniform(3980, 4110, 300), rng.uniform(-3, 3, 300)])


def naive(model: PoleLikelihood, points: np.ndarray, poses: np.ndarray) -> np.ndarray:
    placed = np.stack([se2.transform(pose, points) for pose in poses])
    distances, _ = cKDTree(model.positions).query(placed)
    return model.log_score(distances).sum(1)


def test_without_a_table_it_is_that_of_a_tree(landmarks, poses, rng) -> None:
    points = rng.uniform(-25, 25, (30, 2))
    model = PoleLikelihood(landmarks, 0.5, 0.05, 2.0, None)
    assert isinstance(model, SensorModel)
    found = model.scan_log_likelihoods(pole_scan(points), poses)
    assert found == pytest.approx(naive(model, points, poses), abs=1e-9)
    each = model.log_likelihood(pole_scan(points), poses[0])
    assert each.sum() == pytest.approx(found[0])


def test_a_finer_table_is_nearer_to_it(landmarks, poses, rng) -> None:
    points = rng.uniform(-25, 25, (30, 2))
    errors = []
    for resolution in (0.5, 0.1):
        model = PoleLikelihood(landmarks, 0.5, 0.05, 2.0, resolution)
        errors.append(np.abs(model.scan_log_likelihoods(pole_scan(points), poses) - naive(model, points, poses)).max())
    assert errors[1] < 0.3
    assert errors[1] < 0.5 * errors[0]


def test_far_from_the_map_a_detection_says_nothing(landmarks) -> None:
    for resolution in (None, 0.25):
        model = PoleLikelihood(landmarks, resolution=resolution)
        far = np.array([[-1000.0, 4400.0, 0.3], [-400.0, 3700.0, 1.0]])
        found = model.scan_log_likelihoods(pole_scan([[3.0, 1.0], [0.0, 0.0]]), far)
        assert found == pytest.approx(2 * float(model.log_score(model.gate)), abs=1e-5)


def test_no_detections_are_no_information(landmarks, poses) -> None:
    assert not PoleLikelihood(landmarks).scan_log_likelihoods(pole_scan(Poles.none()), poses).any()


def test_a_scan_keeps_where_the_poles_are(rng) -> None:
    points = np.vstack([rng.uniform(-20, 20, (20, 2)), np.zeros((1, 2))])
    assert pole_scan(points, 3.5).points() == pytest.approx(points)


def test_cells_hold_every_point_once(landmarks) -> None:
    cells = PointCells.of(landmarks, 3.0)
    assert cells.points == pytest.approx(landmarks[cells.order])
    assert sorted(cells.order.tolist()) == list(range(len(landmarks)))
    assert cells.starts[-1] == len(landmarks)


def test_the_published_clutter_is_that_of_a_fifth_without_a_pole() -> None:
    assert clutter_density(79, 20, 2.7) == pytest.approx(0.1, abs=0.005)
    assert clutter_density(0, 0, 2.0) > 0
    with pytest.raises(MapError, match="counts"):
        clutter_density(-1, 2, 1.0)


@pytest.mark.parametrize(
    ("positions", "options", "line"),
    [
        (np.zeros((0, 2)), {}, "at least one row"),
        ([[0.0, np.nan]], {}, "not finite"),
        ([[0.0, 0.0]], {"sigma": 0.0}, "sigma: 0.0"),
        ([[0.0, 0.0], [4.4e5, 5.4e6]], {}, "another coordinate system"),
    ],
)
def test_what_is_no_map_is_refused(positions, options, line) -> None:
    with pytest.raises(MapError, match=line):
        PoleLikelihood(np.asarray(positions), **options)
