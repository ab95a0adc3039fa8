import numpy as np
import pytest
import shapely

from factorloc.errors import ConfigError, SimulationError
from factorloc.simulation.buildings import building
from factorloc.simulation.facades import FacadeSettings
from factorloc.simulation.world import Surface

SKEW = shapely.Polygon([(0, 0), (14, 1), (14.5, 12), (7, 11), (7, 9), (3, 9), (3, 12), (0, 12)])
PLAIN = FacadeSettings(balcony_share=0, cornice_depth=0, plinth_depth=0)


def raise_house(polygon=SKEW, height=12.9, settings=None, seed=0, **options):
    return building(polygon, height, np.random.default_rng(seed), settings, **options)


@pytest.mark.parametrize("polygon", [SKEW, SKEW.reverse(), SKEW.buffer(20).difference(SKEW.buffer(6))])
def test_it_is_closed_and_loses_its_windows(polygon):
    house = raise_house(polygon, settings=FacadeSettings(balcony_share=1))
    assert house.mesh.is_watertight
    assert house.mesh.is_winding_consistent
    assert house.solids[0].surface is Surface.FACADE
    blind = raise_house(polygon, open_space=shapely.Polygon())
    assert blind.mesh.volume == pytest.approx(polygon.area * 13.9)  # 1 m of it is below the ground
    assert blind.facades == ()
    bare = raise_house(shapely.box(0, 0, 10, 8), settings=PLAIN, open_space=shapely.box(0, -5, 10, 0))
    columns, storeys = 4, 4
    # A door in place of one window; sills stand out 9 cm and are embedded by 2.
    lost = 0.18 * (1.2 * 1.5 * (columns * storeys - 1) + 1.1 * 2.18)
    sills = (columns * storeys - 1) * 1.3 * 0.06 * 0.11
    string_course = 10 * 0.18 * 0.10
    assert bare.mesh.volume == pytest.approx(10 * 8 * 13.9 - lost + sills + string_course)


def test_its_facades_are_exactly_planar():
    house = raise_house(settings=PLAIN)
    triangles, areas = np.asarray(house.mesh.triangles), np.asarray(house.mesh.area_faces)
    for facade in house.facades:
        out = (triangles[..., :2] - facade.start) @ facade.normal
        # Ends of what is mounted on the next wall may lie in the plane too, but look the other way.
        ahead = np.asarray(house.mesh.face_normals)[:, :2] @ facade.normal > 0
        flat = (abs(out).max(axis=1) < 1e-12) & ahead
        normals = np.asarray(house.mesh.face_normals)[flat]
        assert normals == pytest.approx(np.tile([*facade.normal, 0], (flat.sum(), 1)), abs=1e-12)
        whole = facade.length * (facade.top - facade.bottom)
        assert 0.6 * whole < areas[flat].sum() <= whole + 1e-9


def test_windows_are_recessed_by_what_the_settings_say():
    house = raise_house(
        shapely.box(0, 0, 30, 10), settings=PLAIN.replaced(recess=0.25), open_space=shapely.box(0, -9, 30, 0)
    )
    (facade,) = house.facades
    assert (facade.start, facade.end) == ((0, 0), (30, 0))
    depths = np.asarray(house.mesh.triangles)[..., 1]
    panes = (abs(depths - 0.25) < 1e-12).all(axis=1)
    storeys, columns = 4, 12
    assert house.mesh.area_faces[panes].sum() == pytest.approx((storeys * columns - 1) * 1.8 + 1.1 * 2.18)


def test_only_walls_that_are_seen_have_windows():
    house = raise_house(shapely.box(0, 0, 12, 10), open_space=shapely.box(-10, -10, 22, 0))
    assert [(f.start, f.end) for f in house.facades] == [((0, 0), (12, 0))]
    assert len(raise_house(shapely.box(0, 0, 12, 10)).facades) == 4
    assert house.footprint.equals(shapely.box(0, 0, 12, 10))


def test_balconies_stand_out_and_cornices_cap_the_wall():
    rows = {"balcony_share": 1, "balcony_depth": 1.3, "cornice_depth": 0.4}
    house = raise_house(
        shapely.box(0, 0, 12, 10), settings=FacadeSettings(**rows), open_space=shapely.box(0, -9, 12, 0)
    )
    vertices = np.asarray(house.mesh.vertices)
    assert vertices[:, 1].min() == pytest.approx(-1.3)
    assert vertices[vertices[:, 1] < -0.5][:, 2].min() == pytest.approx(3.1 - 0.12)
    assert vertices[vertices[:, 2] > 12.8][:, 1].min() == pytest.approx(-0.4)


@pytest.mark.parametrize("height", [1.0, 2.5, 3.0])
def test_a_low_shed_is_closed_too(height):
    shed = raise_house(shapely.box(0, 0, 4, 1.5), height, bottom=5)
    assert shed.mesh.is_watertight
    assert shed.mesh.bounds[:, 2] == pytest.approx([4, 5 + height])


def test_the_generator_alone_decides():
    a, b, c = (raise_house(seed=seed).mesh.vertices for seed in (0, 0, 1))
    assert np.array_equal(a, b)
    assert a.shape != c.shape or not np.array_equal(a, c)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"window_pitch": 1.0}, "windows overlap"),
        ({"window_height": 2.5}, "next storey"),
        ({"recess": 0.7}, "corner"),
    ],
)
def test_windows_that_do_not_fit_are_refused(setting, message):
    with pytest.raises(ConfigError, match=message):
        FacadeSettings(**setting)


def test_a_building_without_height_or_outline_is_refused():
    with pytest.raises(SimulationError, match="height"):
        raise_house(height=0)
    with pytest.raises(SimulationError, match="polygon"):
        raise_house(shapely.Polygon())
