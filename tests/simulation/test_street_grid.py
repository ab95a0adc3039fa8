import numpy as np
import pytest
import shapely

from factorloc.errors import ConfigError, SimulationError
from factorloc.simulation.frontage import Frontage, RowSettings
from factorloc.simulation.street_grid import StreetGrid

GRID = StreetGrid((0, 100), (0, 80), (-30, -30, 130, 110))


def test_streets_and_blocks_share_the_ground():
    whole = shapely.box(*GRID.bounds).area
    assert len(GRID.blocks) == 9
    assert GRID.open_space.area + sum(block.area for block in GRID.blocks) == pytest.approx(whole)
    assert GRID.open_space.covers(GRID.lanes)
    pavements = shapely.union_all(GRID.ground.pavements)
    assert pavements.area - sum(block.area for block in GRID.blocks) > 0
    assert pavements.distance(GRID.lanes) == pytest.approx(GRID.profile.parking_width)


def test_a_frontage_has_houses_on_its_left_and_a_street_on_its_right():
    assert len(GRID.frontages) == 4 * 9 - 12
    blocks = shapely.union_all(GRID.blocks)
    for frontage in GRID.frontages:
        left, right = frontage.points(frontage.length / 2, [-1.0, 1.0])
        assert blocks.contains(shapely.Point(left))
        assert GRID.open_space.contains(shapely.Point(right))
        if frontage.street is not None:
            a, b = frontage.street
            assert b in GRID.neighbours(a)
            road = shapely.LineString([GRID.position(a), GRID.position(b)])
            middle = shapely.Point(frontage.points(frontage.length / 2, 8.7))
            assert road.distance(middle) < 1e-9


def test_plots_fill_a_frontage_and_do_not_overlap():
    settings = RowSettings()
    for k, frontage in enumerate(GRID.frontages):
        plots = frontage.plots(settings, np.random.default_rng(k))
        outlines = [plot.outline for plot in plots]
        assert shapely.union_all(outlines).area == pytest.approx(sum(p.area for p in outlines))
        assert all(p.is_valid for p in outlines)
        inset = settings.house_depth + 0.5
        room = frontage.length - inset * sum(frontage.cut)
        front = frontage.rectangle(0, frontage.length, -settings.house_depth, 0)
        assert front.buffer(1e-9).covers(shapely.union_all(outlines))
        covered = sum(p.area for plot in plots if plot.storeys for p in [plot.outline.envelope])
        gaps = settings.gap_width * sum(plot.storeys == 0 for plot in plots)
        if plots:
            assert covered > (room - gaps - 6) * (settings.house_depth - 1.3)
        assert all(settings.storeys[0] <= plot.storeys <= settings.storeys[1] for plot in plots if plot.storeys)


def test_a_route_keeps_to_the_right_and_in_the_lanes():
    route = GRID.route([(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)])
    poses = route.poses_at(np.arange(0, route.length, 0.5))
    body = shapely.LineString(poses[:, :2]).buffer(route.body_radius)
    corners = shapely.union_all([shapely.Point(GRID.position(n)).buffer(9) for n in GRID.nodes])
    assert GRID.lanes.covers(body.difference(corners))
    right = np.column_stack([np.sin(poses[:, 2]), -np.cos(poses[:, 2])])
    straight = [k for k, p in enumerate(poses) if not corners.contains(shapely.Point(p[:2]))]
    for k in straight:
        beyond = shapely.Point(poses[k, :2] + 2.0 * right[k])
        assert not GRID.lanes.contains(beyond)
    assert not shapely.union_all(GRID.ground.pavements).intersects(body)


@pytest.mark.parametrize(
    ("nodes", "message"),
    [([(0, 0)], "neighbour"), ([(0, 0), (1, 1)], "neighbour"), ([(0, 0), (1, 0), (0, 0)], "turns back")],
)
def test_what_is_no_path_is_refused(nodes, message):
    with pytest.raises(SimulationError, match=message):
        GRID.route(nodes)


def test_what_is_no_grid_is_refused():
    with pytest.raises(SimulationError, match="at least one"):
        StreetGrid((), (0,), (-30, -30, 30, 30))
    with pytest.raises(SimulationError, match="across y"):
        StreetGrid((0,), (0, 15), (-30, -30, 30, 40))
    with pytest.raises(ConfigError, match="house_width"):
        RowSettings(house_width=(12, 8))


def test_points_of_a_frontage_are_measured_along_it():
    frontage = Frontage((2, 3), np.pi / 2, 10)
    assert frontage.points([0, 4], [0, 1]) == pytest.approx(np.array([[2, 3], [3, 7]]))
    assert frontage.rectangle(1, 3, -2, 0).bounds == pytest.approx((0, 4, 2, 6))
