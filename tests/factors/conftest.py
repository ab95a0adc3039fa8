"""A small map and rays around it, for all tests of the room."""

from collections.abc import Callable

import numpy as np
import pytest
import shapely
from loose_rays import BLURS, LooseRays, draw_rays

from factorloc.factors import DecayRateTerm, DistanceFieldTerm, EndPointLevels, EndPointTerm, PosteriorTerm
from factorloc.factors.grid_scan_term import GridScanTerm
from factorloc.mapping import BlurPyramid, RayStatistics
from factorloc.mapping.end_point import EndPointModel
from factorloc.mapping.posterior_pyramid import PosteriorPyramid
from factorloc.scan import Scan
from factorloc.simulation import FloorPlan, Foliage, PlanarLidar


@pytest.fixture(scope="session")
def plan() -> FloorPlan:
    """A room, turned by 10 degrees, with a column and a plant."""
    walls = shapely.affinity.rotate(shapely.box(0, 0, 6, 4), 10, origin=(0, 0)).exterior
    column, plant = shapely.Point(3.6, 2.9).buffer(0.3), shapely.box(1.6, 2.4, 2.4, 3.0)
    return FloorPlan((walls, column), (Foliage(plant, 1.5),))


@pytest.fixture(scope="session")
def drawn(plan: FloorPlan) -> tuple[list[Scan], np.ndarray]:
    """Scans with a mounted lidar at 50 places, and their poses."""
    rng = np.random.default_rng(7)
    poses = np.column_stack([rng.uniform(0.6, 4.8, 50), rng.uniform(1.3, 2.2, 50), rng.uniform(-np.pi, np.pi, 50)])
    lidar = PlanarLidar(beams=91, range_limits=(0.1, 5.0), range_sigma=0.02, T_body_sensor=(0.1, 0.05, 0.3))
    return lidar.cast_many(plan, poses, rng), poses


@pytest.fixture(scope="session")
def statistics(drawn: tuple[list[Scan], np.ndarray]) -> RayStatistics:
    scans, poses = drawn
    return RayStatistics.from_scans(scans[:40], poses[:40], resolution=0.1)


@pytest.fixture(scope="session")
def make_term(statistics: RayStatistics) -> Callable[..., GridScanTerm]:
    """Terms of rays or scans by the name of their model."""
    pyramid = BlurPyramid.from_statistics(statistics, BLURS)
    posterior = PosteriorPyramid.from_statistics(statistics, BLURS)
    ends = EndPointLevels.of(EndPointModel.from_statistics(statistics, 0.15), BLURS)

    def make(model, scans, information=1.0):
        if model == "decay-rate":
            return DecayRateTerm(pyramid, scans, information)
        if model == "decay-rate-posterior":
            return PosteriorTerm(posterior, scans, information)
        if model == "end-point":
            return EndPointTerm(ends, scans, information, 5.0)
        return DistanceFieldTerm(statistics, scans, information, blurs=BLURS)

    return make


@pytest.fixture(scope="session")
def loose(statistics: RayStatistics) -> LooseRays:
    return draw_rays(statistics.grid, 600, seed=11)
