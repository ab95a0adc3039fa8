import numpy as np
import pytest
import shapely

from factorloc.errors import SimulationError
from factorloc.simulation import primitives
from factorloc.simulation.ground import Ground
from factorloc.simulation.world import Surface

GROUND = Ground(
    shapely.box(-10, -10, 50, 10), (shapely.box(0, 4, 40, 8), shapely.box(0, -8, 40, -4)), 0.15, (0.02, -0.01)
)


def test_its_elevation_is_its_mesh():
    solid = GROUND.solid
    assert solid.surface is Surface.GROUND
    rng = np.random.default_rng(0)
    points = rng.uniform((-10, -10), (50, 10), (50, 2))
    origins = np.column_stack([points, np.full(50, 20.0)])
    hits, rays, _ = solid.mesh.ray.intersects_location(origins, np.tile([0.0, 0, -1], (50, 1)))
    tops = [hits[rays == k, 2].max() for k in range(50)]
    assert tops == pytest.approx(GROUND.elevation(points), abs=1e-3)
    raised = (abs(points[:, 1]) > 4) & (abs(points[:, 1]) < 8) & (points[:, 0] > 0) & (points[:, 0] < 40)
    assert 5 < raised.sum() < 45
    assert GROUND.elevation(points) == pytest.approx(points @ (0.02, -0.01) + 0.15 * raised)


def test_what_follows_the_slope_stays_upright_and_closed():
    box = GROUND.tilted(primitives.box((4, 2, 1), (10, 5, 3)), (10, 5))
    assert box.is_watertight
    assert box.volume == pytest.approx(8)
    low = box.vertices[box.vertices[:, 2] < 3.5]
    assert low[:, 2] == pytest.approx(3 + (low[:, :2] - (10, 5)) @ (0.02, -0.01))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((shapely.Polygon(),), "area"),
        ((shapely.box(0, 0, 1, 1), (shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)]),)), "pavement"),
        ((shapely.box(0, 0, 1, 1), (), 0.0), "kerb"),
        ((shapely.box(0, 0, 1, 1), (), 0.1, (np.nan, 0)), "slope"),
    ],
)
def test_what_is_no_ground_is_refused(arguments, message):
    with pytest.raises(SimulationError, match=message):
        Ground(*arguments)
