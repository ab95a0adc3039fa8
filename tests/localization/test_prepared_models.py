"""Every model that has a factor, chosen by name, goes through tracker and smoother."""

import numpy as np
import pytest
from spatial_room import room

from factorloc.config import read_config
from factorloc.errors import ConfigError, MapError
from factorloc.factors import EndPointTerm, PosteriorTerm, SpatialEndPointTerm, SpatialScanTerm
from factorloc.geometry import se3
from factorloc.localization import LocalizationSettings, MeasurementSettings, PreparedMap, localize, register
from factorloc.localization.registration import register_many

PLANAR = {"decay-rate-posterior": (PosteriorTerm, 0.03), "end-point": (EndPointTerm, 0.06)}


@pytest.mark.parametrize("model", PLANAR)
def test_a_drive_is_localized_by_every_model(office, model) -> None:
    n = 30
    settings = LocalizationSettings(model=model)
    prepared = PreparedMap.of(office.statistics, settings)
    term_type, bound = PLANAR[model]
    term = prepared.term(office.drive.scans[:n])
    assert isinstance(term, term_type)
    assert (term.information, term.blurs) == (0.2, (1.0, 0.5, 0.25, 0.1, 0.0))
    run = localize(
        prepared, office.drive.scans[:n], office.drive.odometry[: n - 1], office.prior.pose, settings=settings
    )
    for result in (run.tracked, run.smoothed):
        errors = np.hypot(*(result.trajectory.poses - office.truth[:n])[:, :2].T)
        assert np.sqrt((errors**2).mean()) < bound
    # Half a cell of bias is not in the covariance of an end-point model.
    factor = 1 if model == "decay-rate-posterior" else 5
    xi = run.smoothed.trajectory.poses[:, :2] - office.truth[:n, :2]
    sigmas = np.sqrt(np.trace(run.smoothed.trajectory.covariances[:, :2, :2], axis1=1, axis2=2))
    assert (np.hypot(*xi.T) < 5 * factor * sigmas).all()


@pytest.mark.parametrize("model", PLANAR)
def test_many_guesses_come_to_where_the_term_is_least(office, model) -> None:
    term = PreparedMap.of(office.statistics, MeasurementSettings(model=model)).term(office.drive.scans[3:4])
    rng = np.random.default_rng(3)
    starts = office.truth[3] + rng.uniform(-1, 1, (12, 3)) * [0.5, 0.5, np.radians(8)]
    found = register_many(term, starts)
    near = np.hypot(*(found.poses - office.truth[3])[:, :2].T) < 0.1
    assert near.mean() > 0.9
    best = found.best
    costs = term.batch(found.poses[best : best + 1])
    assert found.costs[best] == pytest.approx(costs.cost[0], rel=1e-12)
    assert found.hessians[best] == pytest.approx(costs.hessian[0], rel=1e-12)
    # A registration ends where the cost no longer falls.
    step = 0.01 * np.eye(3)
    around = term.cost(np.concatenate([found.poses[best] + step, found.poses[best] - step]), -1, np.zeros(6, int))
    assert (around > found.costs[best] - 0.05 * abs(found.costs[best])).all()


@pytest.mark.parametrize("model", ["decay-rate-posterior", "end-point"])
def test_a_spatial_scan_is_registered_by_every_model(model) -> None:
    here = room()
    prepared = PreparedMap.of(here.statistics, MeasurementSettings(model=model))
    term = prepared.term(here.scans[:2])
    assert isinstance(term, SpatialEndPointTerm if model == "end-point" else SpatialScanTerm)
    assert (term.tables.tertiary is None) == (model == "end-point")
    assert term.information == 0.5
    for k in (0, 5, 9):
        guess = se3.compose(here.truth[k], se3.exp(np.array([0.01, -0.01, 0.05, 0.3, -0.25, 0.05])))
        result = register(here.scans[k], prepared, guess)
        error = se3.log(se3.between(here.truth[k], result.trajectory.poses[0]))
        assert np.linalg.norm(error[3:]) < (0.06 if model == "decay-rate-posterior" else 0.15)
        assert np.linalg.norm(error[:3]) < np.radians(1.0)
        assert np.linalg.eigvalsh(result.trajectory.covariances[0]).min() > 0


@pytest.mark.parametrize("model", ["decay-rate-posterior", "end-point"])
def test_a_spatial_drive_is_localized_by_every_model(model) -> None:
    here, n = room(), 5
    run = localize(
        here.statistics, here.scans[:n], here.odometry[: n - 1], here.prior, covariances=here.covariances[: n - 1],
        settings=LocalizationSettings(model=model),
    )  # fmt: skip
    errors = np.linalg.norm(run.smoothed.trajectory.poses[:, :3, 3] - here.truth[:n, :3, 3], axis=1)
    assert errors.max() < (0.06 if model == "decay-rate-posterior" else 0.15)


@pytest.mark.parametrize("name", ["reflection", "reflection-posterior"])
def test_a_model_without_gradient_is_refused_with_a_way_out(tmp_path, name) -> None:
    for block in (MeasurementSettings, LocalizationSettings):
        with pytest.raises(ConfigError, match=rf"model: '{name}' .* no gradient .*--method mcl"):
            block(model=name)
    file = tmp_path / "settings.toml"
    file.write_text(f'model = "{name}"\n')
    with pytest.raises(ConfigError, match=r"--method mcl"):
        read_config(file, LocalizationSettings)


def test_other_names_are_refused_as_ever() -> None:
    with pytest.raises(ConfigError, match="decay-rate-posterior"):
        MeasurementSettings(model="likelihood")
    with pytest.raises(ConfigError, match="model"):
        MeasurementSettings(model=3)
    with pytest.raises(MapError, match="planar maps"):
        PreparedMap.of(room().statistics, MeasurementSettings(model="distance-field"))


def test_blurs_reach_every_model(office) -> None:
    for model in PLANAR:
        settings = MeasurementSettings(model=model, blurs=(0.4, 0.1), information=0.3)
        term = PreparedMap.of(office.statistics, settings).term(office.drive.scans[:1])
        assert (term.blurs, term.information) == ((0.4, 0.1), 0.3)
        with pytest.raises(MapError, match="decreasing"):
            PreparedMap.of(office.statistics, settings.replaced(blurs=(0.1, 0.4)))
