import dataclasses

import numpy as np
import pytest
import trimesh

from factorloc.errors import SimulationError
from factorloc.geometry import se3
from factorloc.simulation import Canopy, Gnss, MeshWorld, Solid, Surface
from factorloc.trajectory import Trajectory


def block(size, centre, surface=Surface.FACADE):
    mesh = trimesh.creation.box(size)
    mesh.apply_translation(centre)
    return Solid(mesh, surface)


FIELD = MeshWorld([block((900, 900, 1), (0, 0, -0.5), Surface.GROUND)])
HALF = MeshWorld([block((2, 4e5, 1e5), (6, 0, 0))])  # hides one half of the sky
STANDING = Trajectory(np.array([0.0, 20_000.0]), np.stack([se3.identity(), se3.identity()]))


def rng(seed=4):
    return np.random.default_rng(seed)


def test_shares_of_blocked_sky():
    receiver = Gnss(sky_rays=400)
    assert receiver.blocked_share(FIELD, [[0, 0, 2.0], [50, 3, 1.0]]).tolist() == [0, 0]
    assert receiver.blocked_share(HALF, [0.0, 0, 2]) == pytest.approx(0.5, abs=0.02)
    # A disc overhead, out to 60 degrees from the zenith, fills one half of the hemisphere.
    disc = trimesh.creation.cylinder(radius=10 * np.tan(np.pi / 3), height=0.01, sections=200)
    disc.apply_translation((0, 0, 10))
    roof = MeshWorld([Solid(disc, Surface.FACADE)])
    assert dataclasses.replace(receiver, mask=0.0).blocked_share(roof, [0, 0, 0]) == pytest.approx(0.5, abs=0.01)


def test_canopies_let_signals_pass():
    tree = trimesh.creation.icosphere(radius=4)
    assert Gnss().blocked_share(MeshWorld([], [Canopy(tree, 5.0)]), [0, 0, 0]) == 0


def test_under_an_open_sky_the_error_is_white():
    receiver = Gnss(sigma=0.4, vertical_factor=2.5, antenna=(1.0, 0.0, 1.5))
    fixes = receiver.sample(FIELD, STANDING, rng())
    errors = fixes.positions - [1.0, 0, 1.5]
    assert len(fixes) == 20_001
    assert fixes.outages == 0
    assert errors.std(axis=0) == pytest.approx([0.4, 0.4, 1.0], rel=0.03)
    assert np.corrcoef(errors[:-1, 0], errors[1:, 0])[0, 1] == pytest.approx(0, abs=0.03)
    assert fixes.covariances[0] == pytest.approx(np.diag([0.4, 0.4, 1.0]) ** 2)


def test_between_facades_the_error_is_large_and_slow():
    receiver = Gnss(sigma=0.0, multipath_sigma=8.0, correlation_time=5.0, sky_rays=100)
    fixes = receiver.sample(HALF, STANDING, rng())
    errors = fixes.positions[:, 0]
    share = fixes.blocked[0]
    assert errors.std() == pytest.approx(8 * share, rel=0.08)
    for lag in (1, 5):
        assert np.corrcoef(errors[:-lag], errors[lag:])[0, 1] == pytest.approx(np.exp(-lag / 5), abs=0.05)
    assert fixes.covariances[0, 0, 0] == pytest.approx((8 * share) ** 2)


def test_outages_leave_gaps_and_are_counted():
    half = Gnss(outage_share=0.3).sample(HALF, STANDING, rng())
    assert (len(half), half.outages) == (0, 20_001)
    some = Gnss(dropout=0.25).sample(FIELD, STANDING, rng())
    assert some.outages / 20_001 == pytest.approx(0.25, abs=0.02)
    assert len(some) + some.outages == 20_001
    # Lost fixes do not shift the noise of the others.
    all_of_them = Gnss().sample(FIELD, STANDING, rng())
    assert (some.positions == all_of_them.positions[np.isin(all_of_them.stamps, some.stamps)]).all()


def test_fixes_follow_a_moving_antenna():
    motion = Trajectory(np.array([-0.5, 9.5]), se3.exp([[0, 0, 0, 0, 0, 0], [0, 0, 0, 50.0, 0, 2.0]]))
    fixes = Gnss(sigma=0.0, antenna=(0.0, 0.0, 1.0)).sample(FIELD, motion, rng(), start=0.0)
    assert fixes.stamps == pytest.approx(np.arange(10))
    assert fixes.positions[:, 0] == pytest.approx(5 * (fixes.stamps + 0.5))


@pytest.mark.parametrize(
    "setting",
    [
        {"period": 0.0},
        {"sigma": -1.0},
        {"multipath_sigma": np.inf},
        {"correlation_time": 0.0},
        {"vertical_factor": 0.0},
        {"outage_share": 2.0},
        {"dropout": -0.1},
        {"sky_rays": 0},
        {"mask": 2.0},
        {"antenna": (0.0, 0.0)},
    ],
)
def test_bad_settings_are_refused(setting):
    with pytest.raises(SimulationError, match=f"gnss {next(iter(setting))}"):
        Gnss(**setting)
