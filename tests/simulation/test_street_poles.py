import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from factorloc.errors import SimulationError
from factorloc.simulation.barrels import barrel_row, moved
from factorloc.simulation.poles import Pole, PoleKind
from factorloc.simulation.trees import Tree
from factorloc.simulation.world import Surface

STANDING = [kind for kind in PoleKind if kind not in (PoleKind.TRUNK, PoleKind.BARREL)]


def section(mesh, pole, z):
    """Outline of a horizontal section: corners where edges cross the height, about the pole's axis."""
    ends = np.asarray(mesh.vertices)[np.asarray(mesh.edges_unique)]
    low, high = ends[..., 2].min(1), ends[..., 2].max(1)
    crossing = ends[(low < z) & (high > z)]
    share = (z - crossing[:, 0, 2]) / (crossing[:, 1, 2] - crossing[:, 0, 2])
    points = crossing[:, 0, :2] + share[:, None] * (crossing[:, 1, :2] - crossing[:, 0, :2])
    return shapely.MultiPoint(points).convex_hull


def assert_true(mesh, pole):
    """All along its span the mesh is a shaft of the pole's width about its axis, and nothing else."""
    assert mesh.is_watertight
    for z in np.linspace(pole.bottom, pole.top, 7)[1:-1] + 1e-4:
        outline = section(mesh, pole, z)
        assert outline.length / np.pi == pytest.approx(pole.width)
        assert (outline.centroid.x, outline.centroid.y) == pytest.approx((pole.x, pole.y))


@settings(max_examples=30)
@given(st.sampled_from(STANDING), st.floats(-4, 4), st.integers(0, 99))
def test_the_truth_of_a_pole_is_its_mesh(kind, yaw, seed):
    pole = Pole.drawn(7, kind, (12.5, -3.25), 0.4, yaw, np.random.default_rng(seed))
    (solid,) = pole.solids
    assert solid.surface is Surface.POLE
    assert 0.06 <= pole.width <= 0.40
    assert (pole.id, pole.kind, pole.bottom) == (7, kind, 0.4)
    assert_true(solid.mesh, pole)
    assert solid.mesh.bounds[0, 2] < pole.bottom
    assert solid.mesh.bounds[1, 2] >= pole.top


@settings(max_examples=10)
@given(st.integers(0, 99))
def test_the_truth_of_a_trunk_is_its_mesh(seed):
    tree = Tree.drawn(3, (1, 2), 0.2, np.random.default_rng(seed))
    (solid,) = tree.solids
    assert solid.surface is Surface.TRUNK
    assert_true(solid.mesh, tree.trunk)
    assert tree.trunk.solids == ()
    (crown,) = tree.canopies
    assert crown.mesh.bounds[0, 2] >= tree.trunk.top - 1e-9


def test_a_row_of_barrels_is_moved_as_one():
    points = np.column_stack([np.arange(0, 63, 3.0), np.full(21, 2.0)])
    row = barrel_row(points, np.full(21, 0.12), first_id=40)
    after = moved(row, (0, -3, -0.12))
    assert [b.id for b in row] == [b.id for b in after] == list(range(40, 61))
    shifts = {tuple(round(v, 12) for v in (b.x - a.x, b.y - a.y, b.z - a.z)) for a, b in zip(row, after, strict=True)}
    assert shifts == {(0, -3, -0.12)}
    for barrel in (row[0], after[-1]):
        (solid,) = barrel.solids
        assert solid.surface is Surface.BARREL
        assert_true(solid.mesh, barrel.pole)
        assert barrel.pole.kind is PoleKind.BARREL
        assert barrel.footprint.contains(barrel.pole.footprint)


@pytest.mark.parametrize("sizes", [(0, 0, 2), (0.1, 2, 2), (np.inf, 0, 2)])
def test_a_pole_without_size_is_refused(sizes):
    with pytest.raises(SimulationError, match="pole 1"):
        Pole(1, PoleKind.POST, 0, 0, *sizes)


def test_a_trunk_is_not_set_up_like_a_pole():
    with pytest.raises(SimulationError, match="belongs to its tree"):
        Pole.drawn(1, PoleKind.TRUNK, (0, 0), 0, 0, np.random.default_rng(0))
    with pytest.raises(SimulationError, match="stands on a post"):
        Tree(Pole(1, PoleKind.POST, 0, 0, 0.1, 0, 2), 3, 3, 1)
    with pytest.raises(SimulationError, match="expected"):
        barrel_row(np.zeros((3, 2)), np.zeros(2))
