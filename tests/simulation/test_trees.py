import numpy as np
import pytest
import shapely

from factorloc.errors import SimulationError
from factorloc.simulation import MeshWorld, Surface
from factorloc.simulation.trees import Hedge, Tree, leaf_share


def test_leaves_come_in_spring_and_fall_in_autumn():
    months = np.linspace(0, 12, 241)
    leaves = np.array([leaf_share(m) for m in months])
    assert leaves.min() == 0
    assert leaves.max() == 1
    assert leaf_share(1) == 0
    assert leaf_share(6.5) == leaf_share(18.5) == 1
    assert 0 < leaf_share(3.7) < 1
    assert 0 < leaf_share(9.7) < 1
    assert abs(np.diff(leaves)).max() < 0.06
    assert (np.diff(leaves[months < 8]) >= 0).all()
    assert (np.diff(leaves[months > 8]) <= 0).all()


def test_a_season_scales_rate_and_size_and_leaves_the_trunk():
    tree = Tree.drawn(0, (0, 0), 0, np.random.default_rng(5))
    (summer,), (winter,) = tree.at(6.5).canopies, tree.at(1).canopies
    assert summer.rate == tree.rate
    assert winter.rate < 0.2 * summer.rate
    assert winter.mesh.volume < 0.7 * summer.mesh.volume
    assert tree.at(1).trunk == tree.trunk
    assert np.array_equal(tree.at(1).solids[0].mesh.vertices, tree.solids[0].mesh.vertices)


def test_rays_end_in_a_crown_by_an_exponential_law():
    tree = Tree.drawn(0, (0, 0), 0, np.random.default_rng(5))
    (crown,) = tree.canopies
    z = tree.trunk.top + tree.crown_height / 2
    world = MeshWorld((), (crown,))
    origin = np.array([-10.0, 0.4, z])
    n = 20_000
    hits = world.cast(np.tile(origin, (n, 1)), [1.0, 0, 0], np.random.default_rng(0))
    ended = hits.surfaces == Surface.FOLIAGE
    # The share that passes tells the length of the way through; the free path within it is exponential.
    way = -np.log(1 - ended.mean()) / crown.rate
    assert 0.7 * tree.crown_width < way < 1.2 * tree.crown_width
    depths = hits.ranges[ended] - hits.ranges[ended].min()
    decay = crown.rate * way
    assert depths.mean() == pytest.approx(1 / crown.rate - way / np.expm1(decay), rel=0.03)


def test_a_hedge_is_opaque_behind_its_skin():
    hedge = Hedge(3, 4, 0.1, 0.5, length=5)
    (core,), (skin,) = hedge.solids, hedge.canopies
    assert core.surface is Surface.HEDGE
    assert skin.mesh.volume == pytest.approx(5 * 0.7 * 1.2)
    assert hedge.footprint.area == pytest.approx(3.5)
    assert hedge.footprint.buffer(-0.11).covers(shapely.MultiPoint(np.asarray(core.mesh.vertices)[:, :2]))
    assert hedge.at(1).canopies[0].rate < skin.rate
    with pytest.raises(SimulationError, match="hedge"):
        Hedge(0, 0, width=0.2)
    with pytest.raises(SimulationError, match="leaves"):
        Hedge(0, 0, leaves=1.2)
