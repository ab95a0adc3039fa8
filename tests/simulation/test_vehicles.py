import numpy as np
import pytest
import shapely

from factorloc.errors import SimulationError
from factorloc.simulation.vehicles import VEHICLE_MODELS, Pedestrian, Vehicle
from factorloc.simulation.world import Surface


@pytest.mark.parametrize("model", VEHICLE_MODELS)
def test_a_car_fills_its_footprint_and_stands_on_the_road(model):
    car = Vehicle(model, 10, -4, 0.3, yaw=0.7, scale=0.97)
    (solid,) = car.solids
    assert solid.surface is Surface.VEHICLE
    assert solid.mesh.is_watertight
    assert solid.mesh.is_winding_consistent
    seen = shapely.MultiPoint(np.asarray(solid.mesh.vertices)[:, :2]).convex_hull
    assert car.footprint.buffer(1e-9).covers(seen)
    assert seen.area > 0.93 * car.footprint.area
    assert car.footprint.area == pytest.approx(car.size[0] * car.size[1])
    assert solid.mesh.bounds[:, 2] == pytest.approx([0.3, 0.3 + car.size[2]], abs=1e-9)
    # It is no box: there is air under the body, before the windscreen and beside the cabin.
    assert 0.5 < solid.mesh.convex_hull.volume / np.prod(car.size) < 0.9


def test_a_car_drives_where_it_heads():
    car = Vehicle("van", 0, 0, yaw=np.pi / 2, speed=7)
    assert car.solids[0].velocity == pytest.approx((0, 7, 0))
    assert not Vehicle("van", 0, 0).solids[0].moves
    # The bonnet is in front: behind, the van is as high as it is.
    vertices = np.asarray(car.solids[0].mesh.vertices)
    assert vertices[vertices[:, 1] > 2.4][:, 2].max() < 0.7 * vertices[vertices[:, 1] < -2.4][:, 2].max()


def test_a_pedestrian_is_closed_and_as_tall_as_told():
    walker = Pedestrian(1, 2, 0.1, 0.4, height=1.9, speed=1.4)
    (solid,) = walker.solids
    assert solid.surface is Surface.PEDESTRIAN
    assert solid.mesh.is_watertight
    assert solid.mesh.bounds[:, 2] == pytest.approx([0.1, 2.0], abs=0.02)
    assert walker.footprint.buffer(0.05).covers(shapely.MultiPoint(np.asarray(solid.mesh.vertices)[:, :2]))
    assert np.hypot(*solid.velocity[:2]) == pytest.approx(1.4)


@pytest.mark.parametrize(("arguments", "message"), [(("tank", 0, 0), "saloon"), (("van", 0, 0, 0, 0, 0.0), "scale")])
def test_what_is_no_car_is_refused(arguments, message):
    with pytest.raises(SimulationError, match=message):
        Vehicle(*arguments)
